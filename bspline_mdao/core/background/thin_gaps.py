"""Gaps between walls not resolved by a lattice: walls that move relative to each other there may invert cells.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from .background_lattice import BackgroundLattice
from .wall_widths import bodies_of, gaps_between

__all__ = ["ThinGap", "thin_gaps"]


@dataclass(frozen=True, eq=False)
class ThinGap(OneLine):
    """A gap that is thinner than the spans of the lattice in it."""

    rows: tuple[int, int]  # a node of each of the two bodies, among all wall nodes
    width: float  # width of the gap (m)
    span: float  # span of the lattice across it (m)


def thin_gaps(
    lattice: BackgroundLattice,
    walls: np.ndarray,  # (n_wall, 3), nodes of walls (m)
    faces: np.ndarray,  # int (n_faces, 4), their faces
) -> tuple[ThinGap, ...]:
    """Find pairs of bodies whose gap is somewhere thinner than the lattice's spans across it, with the worst place."""
    local, found = lattice.frame.to_local(walls), []
    bodies = bodies_of(local, faces)
    for gap in gaps_between(local, bodies, [widest_span(lattice, body.low, body.high) for body in bodies]):
        widths = np.linalg.norm(gap.vectors, axis=1)
        inverse = np.zeros(len(widths))
        for axis, line in enumerate(lattice.lines):
            if not line.is_tied:
                spans = np.diff(line.breaks)[line.spans(gap.starts[:, axis] + 0.5 * gap.vectors[:, axis])]
                inverse += np.abs(gap.vectors[:, axis]) / widths / spans
        worst = int(np.argmin(widths * inverse))
        if widths[worst] * inverse[worst] < 1.0:
            found.append(ThinGap(tuple(gap.rows[worst]), float(widths[worst]), float(1.0 / inverse[worst])))
    return tuple(found)


def widest_span(lattice: BackgroundLattice, low: np.ndarray, high: np.ndarray) -> float:
    """Width of the widest span reached by a box (m)."""
    widest = 0.0
    for line, *ends in zip(lattice.lines, low, high):
        if not line.is_tied:
            first, last = (0, 0) if line.is_periodic else line.spans(np.array(ends))  # periodic spans are even
            widest = max(widest, float(np.diff(line.breaks)[first : last + 1].max()))
    return widest
