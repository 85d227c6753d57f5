"""Which planes at the rim of a grid are planes of symmetry, by the surfaces that end in them.

A mirror image continues smoothly if a surface ends in the plane at a right angle. But duct walls also do so at an
inlet, and so does a wing at the floor of a tunnel: the places of planes and the cells next to them usually show which
is which.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..topology.grid import Grid
from ..topology.index_space import Window
from .boundary_planes import BoundaryPlane
from .patch_certainty import COARSE, FAR, FINE, FaceGuess

__all__ = ["Places", "doubtful_faces", "find_symmetry"]


@dataclass(frozen=True, eq=False)
class Places:
    """Planes of the boundary of a grid, and what is known about them and the other faces."""

    grid: Grid  # the grid
    planes: Sequence[BoundaryPlane]  # the planes
    distances: Sequence[float]  # distance of each from the middle of the grid, relative to the radius
    # height of the first cells at each relative to the mean of their grid lines, the median of its windows
    cells: Sequence[float | None]
    guesses: Mapping[Window, FaceGuess]  # guess at each face from its place and cells only

    @classmethod
    def of(
        cls,
        grid: Grid,
        planes: Sequence[BoundaryPlane],
        distances: Mapping[Window, float],
        cells: Mapping[Window, float | None],
        guesses: Mapping[Window, FaceGuess],
    ) -> Places:
        """Gather distances and cells of windows by planes; declared walls and far fields count as sure guesses."""
        far = [min(distances[window] for window in plane.windows) for plane in planes]
        known = [[height for window in plane.windows if (height := cells[window]) is not None] for plane in planes]
        parts = [float(np.median(values)) if values else None for values in known]
        declared = (
            FaceGuess(window, patch.name, patch.kind, "sure", "declared")
            for patch in grid.patches
            for window in patch.windows
            if patch.kind in ("wall", "farfield")
        )
        return cls(grid, planes, far, parts, {**guesses, **{guess.window: guess for guess in declared}})

    def is_thin(self, n: int) -> bool:
        """Whether all blocks are one cell deep at a plane."""
        ends = ((self.grid.shapes[w.block], w) for w in self.planes[n].windows)
        return all(any(k <= 2 and lo == hi for k, lo, hi in zip(shape, w.lo, w.hi)) for shape, w in ends)

    def is_fine(self, n: int) -> bool:
        """Whether the cells at a plane are like cells at walls."""
        part = self.cells[n]
        return part is not None and part < FINE

    def is_coarse(self, n: int) -> bool:
        """Whether the cells at a plane are like cells at far fields."""
        part = self.cells[n]
        return part is not None and part > COARSE

    def faces(self, kind: str | None = None, levels: Iterable[str] = ("sure", "likely", "unsure")) -> list[Window]:
        """Faces that look like a kind, any by default, with a given certainty."""
        return [g.window for g in self.guesses.values() if kind in (None, g.kind) and g.level in levels]

    def inside(self, windows: Sequence[Window]) -> list[Window]:
        """The faces that are in no plane at the rim."""
        at_rim = {window for plane in self.planes if plane.is_rim for window in plane.windows}
        return [window for window in windows if window not in at_rim]


def find_symmetry(places: Places) -> set[int]:
    """Find the planes of symmetry, by number; all of them are at the rim of the grid."""
    rim = [n for n, plane in enumerate(places.planes) if plane.is_rim]
    thin = {n for n in rim if places.is_thin(n)}
    thick = [n for n in rim if n not in thin]
    found = thin | {n for n in thick if _is_symmetry(places, n, thick)}
    taken = {window for n in found for window in places.planes[n].windows}
    plates = [window for window in _sure_walls(places) if window not in taken]
    return found | {
        n
        for n in thick
        if places.distances[n] <= FAR and not places.is_fine(n) and places.planes[n].ends_normally(places.grid, plates)
    }


def _sure_walls(places: Places) -> list[Window]:
    return places.faces("wall", ["sure"])


def _is_symmetry(places: Places, n: int, thick: Sequence[int]) -> bool:
    """Judge a plane at the rim by the surfaces that end in it; ``thick``: such planes of blocks of more than a cell."""
    grid, plane, walls = places.grid, places.planes[n], places.inside(_sure_walls(places))
    if places.distances[n] <= FAR:
        surfaces = walls if places.is_fine(n) else places.inside(places.faces())
        return plane.ends_normally(grid, walls) or plane.ends_normally(grid, surfaces)
    facing = [places.planes[m] for m in thick if plane.opposes(places.planes[m])]
    if not facing:  # far from nodes that crowd at walls around it: if the flow goes through two other planes
        is_flow = any(places.planes[m].opposes(places.planes[k]) for m, k in combinations(thick, 2))
        is_near = any(places.distances[m] <= FAR for m in thick)
        return is_flow and not is_near and not places.is_fine(n) and plane.ends_normally(grid, walls or places.faces())
    # a section between two walls that are far apart: the wall and the far field end in both
    far_fields = places.faces("farfield", ["sure", "likely"])
    return not places.is_coarse(n) and all(
        side.ends_normally(grid, walls, is_curved=True) and side.ends_normally(grid, far_fields)
        for side in (plane, facing[0])
    )


def doubtful_faces(places: Places) -> set[Window]:
    """Find the faces that are likely walls by their places, and planes that may be symmetry as well."""
    # At the rim this is where the cells are not like cells at walls; elsewhere where a sure wall ends in the plane,
    # except for faces that are themselves sure and not at the rim: the tip of a wing, a blunt trailing edge.
    found = set()
    for n, plane in enumerate(places.planes):
        ends = plane.ends(places.grid, places.inside(_sure_walls(places)))
        for window in plane.windows:
            is_sure = places.guesses[window].level == "sure"
            if (plane.is_rim and (ends or not places.is_fine(n))) or (ends and not is_sure):
                found.add(window)
    return {window for window in found if places.guesses[window].kind == "wall"}
