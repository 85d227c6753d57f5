"""Spans of the lattice around a mesh: narrow at small bodies and in gaps, within the available memory.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...base.display import OneLine
from ...base.numerics.memory import available_bytes
from ...errors import InputError
from .background_lattice import BackgroundLattice
from .lattice_frame import LatticeFrame
from .lattice_line import LatticeLine
from .lattice_settings import LatticeSettings
from .wall_widths import THINNEST, Gap, Interval, WallBody, asked_in_gap, bodies_of, gaps_between, graded_breaks

__all__ = ["MeshBox", "factor_bytes"]

FAR = 10.0
"""Distance from the walls, relative to their size, beyond which spans grow faster: with 1, cells next to three elements
that rotate by 20 degrees lose half of their volume instead of a quarter."""

BYTES_A_POINT = 32.0
"""Bytes of a factor for each control point and each point of the lattice's smallest cross-section: 31 with 15 points in
each direction, 22 with 35."""

IN_ALL = 4.0
"""Memory for two factors and the factorizations, relative to one factor: 3.7 with 35 points in each direction."""

PART_OF_MEMORY = 0.8
"""Fraction of free memory that a lattice may use."""

WITHOUT_ASKING = 1e9
"""Bytes of a factor beyond which small bodies get wider spans than otherwise, unless a spacing is given."""

WIDER = 1.1
"""Ratio of successive spacings in the search for one that fits."""


@dataclass(frozen=True, eq=False)
class MeshBox(OneLine):
    """The box and walls of a mesh, around which lattices are laid."""

    source: str  # where the mesh comes from
    frame: LatticeFrame  # coordinates of the lattice
    section_axis: int | None  # direction across a section, whose nodes are all at its two ends
    low: np.ndarray  # (3,), corners of the box of the mesh, in these coordinates (m)
    high: np.ndarray
    walls: np.ndarray  # (n_wall, 3), nodes of walls, in these coordinates (m)
    faces: np.ndarray  # int (n_faces, 4), their faces
    periods: Mapping[int, float]  # lengths of periods (m), by periodic directions of the mesh

    @classmethod
    def of(
        cls,
        source: str,  # where the mesh comes from
        points: np.ndarray,  # (n, 3), nodes of the mesh (m)
        faces: np.ndarray,  # int (n_faces, 4), faces of its walls
        frame: LatticeFrame,  # coordinates of the lattice
        section_axis: int | None,  # direction across a section
        periods: Mapping[int, float],  # lengths of periods, by directions (m)
    ) -> MeshBox:
        """Measure a mesh."""
        rows, numbers = np.unique(faces, return_inverse=True)
        points = frame.to_local(points)
        low, high = points.min(axis=0), points.max(axis=0)
        return cls(source, frame, section_axis, low, high, points[rows], numbers.reshape(faces.shape), periods)

    def lattice(self, settings: LatticeSettings) -> BackgroundLattice:
        """Lay a lattice; `InputError` if its mover does not fit in memory."""
        gaps = () if settings.spacing else self.gaps(settings.spans)
        lattice = self._laid(settings, gaps)
        if settings.spacing is None and not settings.refined:
            width, narrowest = self.size / settings.spans, lattice.spacing
            while factor_bytes(lattice) > WITHOUT_ASKING and narrowest < width:
                narrowest = min(width, WIDER * narrowest)
                lattice = self._laid(settings, gaps, narrowest)
        self._require_memory(lattice, settings)
        return lattice

    @property
    def sides(self) -> list[int]:
        """Directions of the lattice except the one across a section."""
        return [d for d in range(3) if d != self.section_axis]

    @cached_property
    def size(self) -> float:
        """Longest side of the box of all walls (m)."""
        return float(np.ptp(self.walls, axis=0)[self.sides].max())

    @cached_property
    def bodies(self) -> tuple[WallBody, ...]:
        """Bodies, largest first."""
        return bodies_of(self.walls, self.faces)

    def gaps(self, spans: float) -> tuple[Gap, ...]:
        """Where bodies are within a span of each other, for a number of spans along the longest side."""
        return gaps_between(self.walls, self.bodies, [body.size(self.sides) / spans for body in self.bodies])

    def _laid(self, settings: LatticeSettings, gaps: Sequence[Gap], narrowest: float = 0.0) -> BackgroundLattice:
        """A lattice with spans no narrower than a width (m) except in refinements."""
        lines = []
        for d in range(3):
            box = float(self.low[d]), float(self.high[d])
            if d == self.section_axis:
                lines.append(LatticeLine(np.array(box), np.ones(1), is_tied=True))
                continue
            asked = self._around_bodies(d, settings)
            even = min(low for low, _, _ in asked), max(high for _, high, _ in asked)
            for gap in gaps:
                asked += asked_in_gap(gap, d, THINNEST * self.bodies[gap.bodies[0]].size(self.sides))
            asked = [(low, high, max(width, narrowest)) for low, high, width in asked]
            asked += [(low, high, width) for axis, low, high, width in settings.refined if axis == d]
            width = settings.spacing or self.size / settings.spans
            if d in self.periods:
                narrow = min(asked_width for _, _, asked_width in asked)
                lines.append(LatticeLine.periodic(box[0], self.periods[d], narrow, width))
                continue
            inner = graded_breaks(even, asked, settings.growth)
            lines.append(LatticeLine.between(box, inner, width, settings.growth, FAR * self.size))
        return BackgroundLattice((lines[0], lines[1], lines[2]), self.frame)

    def _around_bodies(self, axis: int, settings: LatticeSettings) -> list[Interval]:
        """Widths for bodies in one direction, in their boxes and slightly beyond; a single one for a spacing."""
        bodies = self.bodies
        if settings.spacing:
            bodies = (WallBody(np.zeros(0, dtype=int), self.walls.min(axis=0), self.walls.max(axis=0)),)
        found = []
        for body in bodies:
            size = body.size(self.sides)
            ends = body.low[axis] - settings.padding * size, body.high[axis] + settings.padding * size
            low, high = np.clip(ends, self.low[axis], self.high[axis])
            found.append((float(low), float(high), settings.spacing or size / settings.spans))
        return found

    def _require_memory(self, lattice: BackgroundLattice, settings: LatticeSettings) -> None:
        """Refuse a lattice that does not fit in memory, and suggest a spacing that does."""
        free = PART_OF_MEMORY * available_bytes()
        needed = IN_ALL * factor_bytes(lattice)
        if needed <= free:
            return
        spacing = settings.spacing or lattice.spacing
        while IN_ALL * factor_bytes(self._laid(replace(settings, spacing=spacing, refined=()), ())) > free:
            spacing *= WIDER
        raise InputError(
            f"{self.source}: a lattice of {lattice.n_control:,} control points takes {needed / 1e9:.3g} GB to move, "
            f"and {free / 1e9:.3g} GB are free; take --spacing {float(f'{WIDER * spacing:.2g}'):g} of 'fit'"
        )


def factor_bytes(lattice: BackgroundLattice) -> float:
    """Predict the bytes of the factor of a lattice's mover."""
    counts: Sequence[int] = sorted(line.n_unknowns for line in lattice.lines)
    return BYTES_A_POINT * np.prod(counts, dtype=float) * counts[0] * counts[1]
