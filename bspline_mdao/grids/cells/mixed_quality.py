"""Quality of cells of mixed kinds as a function of the nodes: bounds with derivatives, and inverted cells.

The volumes of the pyramids between the centre of a cell and its faces (`.pyramids`), relative to the baseline, are
bounded from below: while they are positive, no cell is inverted. Heights of the nodes next to walls are bounded as well
(`.node_heights`). `.aggregates` has the table of bounds, and says which of them cells of mixed kinds have.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from .aggregates import AGGREGATES, KreisselmeierSteinhauser, Part
from .cell_range import CellRange
from .grid_quality import GridValues
from .mixed_cells import MixedMesh
from .node_heights import NodeHeights
from .quads import rings

__all__ = ["MixedQuality", "MixedReport", "NewlyInverted"]

FLAT = 1e-12
"""Fraction of its cell's volume that a pyramid must have on the baseline to count: less is rounding."""


@dataclass(frozen=True)
class MixedReport:
    """Quality of a mesh of mixed cells."""

    n_cells: int
    min_volume: float  # smallest volume of a cell (m^3)
    min_ratio: float  # smallest volume of a pyramid between the centre of a cell and a face, relative to the baseline
    n_inverted: int  # cells with a pyramid that is not positive
    n_newly_inverted: int  # inverted cells that were valid on the baseline
    heights: tuple[float, float]  # smallest and largest height of a node next to a wall, relative to the baseline

    @classmethod
    def joined(cls, parts: Sequence[MixedReport]) -> MixedReport:
        """Report on all cells from the reports on parts of them."""
        return cls(
            n_cells=sum(part.n_cells for part in parts),
            min_volume=min(part.min_volume for part in parts),
            min_ratio=min(part.min_ratio for part in parts),
            n_inverted=sum(part.n_inverted for part in parts),
            n_newly_inverted=sum(part.n_newly_inverted for part in parts),
            heights=(min(part.heights[0] for part in parts), max(part.heights[1] for part in parts)),
        )

    @property
    def summary(self) -> dict[str, float]:
        """Scalars to store for many meshes: of heights only if there are walls."""
        numbers = {name: getattr(self, name) for name in ("min_volume", "min_ratio", "n_inverted", "n_newly_inverted")}
        low, high = self.heights
        return numbers | ({"height_min": low, "height_max": high} if high else {})


class NewlyInverted(NamedTuple):
    """Newly inverted cells: their number, the worst of them, and its smallest pyramid relative to the baseline."""

    n: int
    ratio: float
    cell: int


@dataclass(frozen=True, eq=False)
class MixedQuality(OneLine):
    """Quality of the cells of a mesh, or of one process, whose baseline has decided which pyramids count; see `of`.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.grids.cells.mixed_cells import MixedMesh
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> quality = MixedQuality.of(MixedMesh(corners, {"tetra": np.array([[0, 1, 2, 3]])}), np.zeros((0, 4), dtype=int))
    >>> quality.evaluate(2.0 * corners, ["volume_ks"]).aggregates["volume_ks"] > 7.9
    True
    """

    mesh: MixedMesh
    cells: CellRange  # the cells that are judged here
    has_heights: bool  # whether the mesh has nodes next to walls
    counted: np.ndarray  # int (n,), pyramids that count: of cells that are valid on the baseline
    scales: np.ndarray  # (n,), their volumes on the baseline (m^3)
    was_inverted: np.ndarray  # bool (n,), cells that are inverted on the baseline
    heights: NodeHeights  # the heights that are judged here
    rho: float = 100.0  # sharpness of the bound of cells
    rho_height: float = 1000.0  # sharpness of the bounds of heights

    @classmethod
    def of(
        cls,
        mesh: MixedMesh,
        walls: np.ndarray,  # int (n_faces, 4), faces of the walls, around the normal into the mesh
        rho: float = 100.0,
        rho_height: float = 1000.0,
        rank: int = 0,  # number of this process among several, and how many there are
        n_ranks: int = 1,
    ) -> MixedQuality:
        """Decide about the cells of a baseline; each of several processes takes an equal share."""
        for sharpness in (rho, rho_height):
            KreisselmeierSteinhauser(sharpness)
        judged = CellRange.of(mesh, rank, n_ranks)
        volumes, quality, cells = judged.pyramids(mesh.points).volumes, judged.quality(mesh.points), judged.side_cells
        is_counted = ~quality.is_inverted[cells] & (volumes > FLAT * quality.volumes[cells])
        counted = np.flatnonzero(is_counted)
        heights = NodeHeights.of(mesh, walls)
        has_heights, part = len(heights.rows) > 0, heights.part(rank, n_ranks)
        inverted = quality.is_inverted
        return cls(mesh, judged, has_heights, counted, volumes[counted], inverted, part, rho, rho_height)

    @property
    def baseline(self) -> np.ndarray:
        """Nodes of the baseline (m), shape (n_points, 3)."""
        return self.mesh.points

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.mesh.n_cells

    @cached_property
    def lines(self) -> Sequence[np.ndarray]:
        """Nodes around the faces of all cells."""
        return (rings(self.mesh.cell_faces[0]),)

    @property
    def aggregates(self) -> tuple[str, ...]:
        """Names of the available aggregates: aggregates of heights only if the mesh has walls."""
        return tuple(n for n, a in AGGREGATES.items() if a.of_mixed and (self.has_heights or not a.is_of_heights))

    def require(self, names: Sequence[str], cells: bool = False) -> None:
        """Refuse names of aggregates that the mesh does not have, and Q of every cell."""
        if cells:
            raise InputError(
                f"{self.mesh.source}: Q of every cell, Eq. (9), is for hexahedra in blocks, which this mesh does not "
                f"have; leave 'cells' out"
            )
        missing = next((name for name in names if name not in self.aggregates), None)
        if missing is None:
            return
        if missing not in AGGREGATES:
            raise InputError(f"no aggregate '{missing}'; choose from {', '.join(self.aggregates)}")
        if AGGREGATES[missing].of_mixed:
            raise InputError(f"'{missing}': {self.mesh.source} has no nodes next to a wall to measure")
        raise InputError(
            f"'{missing}' is for hexahedra in blocks, and {self.mesh.source} has cells of mixed kinds; choose from "
            f"{', '.join(self.aggregates)}"
        )

    def evaluate(self, nodes: np.ndarray, names: Sequence[str] | None = None, cells: bool = False) -> GridValues:
        """Aggregate the quality of the mesh with nodes, shape (n_points, 3)."""
        names = self.aggregates if names is None else names
        self.require(names, cells)
        return self.joined([self.parts(nodes, names)])

    def parts(self, nodes: np.ndarray, names: Iterable[str]) -> dict[str, Part]:
        """Parts of aggregates, see `.aggregates`, of the cells and heights that are judged here."""
        return {name: self._rule(name).part(ratios) for name, ratios in self._ratios(nodes, names).items()}

    def joined(self, parts: Sequence[Mapping[str, Part]]) -> GridValues:
        """Aggregates from their parts."""
        bounds = {name: self._rule(name) for name in parts[0]}
        return GridValues(
            {name: _sign(name) * rule.value(rule.join([part[name] for part in parts])) for name, rule in bounds.items()}
        )

    def jvp(self, nodes: np.ndarray, d_nodes: np.ndarray, values: GridValues) -> GridValues:
        """Change of the aggregates with the nodes."""
        weights, changes = self._weights(nodes, values.aggregates), {}
        if any(not AGGREGATES[name].is_of_heights for name in weights):
            changes[False] = self.cells.pyramids(nodes).jvp(d_nodes)[self.counted] / self.scales
        if any(AGGREGATES[name].is_of_heights for name in weights):
            changes[True] = self.heights.jvp(nodes, d_nodes)
        found = {name: float(weight @ changes[AGGREGATES[name].is_of_heights]) for name, weight in weights.items()}
        return GridValues(found)

    def vjp(self, nodes: np.ndarray, values: GridValues, bar: GridValues) -> np.ndarray:
        """Adjoint of the nodes, shape (n_points, 3), from the adjoint of the aggregates."""
        asked = {name: values.aggregates[name] for name, seed in bar.aggregates.items() if seed}
        weights, nodes_bar = self._weights(nodes, asked), np.zeros_like(nodes)
        for name, weight in weights.items():
            seeded = bar.aggregates[name] * weight
            if AGGREGATES[name].is_of_heights:
                nodes_bar += self.heights.vjp(nodes, seeded)
            else:
                of_pyramids = np.zeros(len(self.cells.side_cells))
                of_pyramids[self.counted] = seeded / self.scales
                nodes_bar += self.cells.pyramids(nodes).vjp(of_pyramids)
        return nodes_bar

    def report(self, nodes: np.ndarray, n_bins: int = 50) -> MixedReport:
        """Report on the mesh with nodes, shape (n_points, 3); ``n_bins`` is unused, as there are no distributions."""
        quality, heights = self.cells.quality(nodes), self.heights.ratios(nodes)
        ratios = self.cells.pyramids(nodes).volumes[self.counted] / self.scales
        return MixedReport(
            n_cells=self.cells.n,
            min_volume=float(quality.volumes.min(initial=np.inf)),
            min_ratio=float(ratios.min(initial=np.inf)),
            n_inverted=int(np.count_nonzero(quality.is_inverted)),
            n_newly_inverted=int(np.count_nonzero(quality.is_inverted & ~self.was_inverted)),
            heights=(float(heights.min(initial=np.inf)), float(heights.max(initial=0.0))),
        )

    def summary(self, nodes: np.ndarray) -> dict[str, float]:
        """Scalars to store for many meshes, see `MixedReport.summary`."""
        return self.report(nodes).summary

    def cell_ratios(self, nodes: np.ndarray) -> np.ndarray:
        """Smallest pyramid of every cell relative to the baseline, shape (n,); infinite if none counts."""
        ratios = np.full(self.cells.n, np.inf)
        cells = self.cells.side_cells[self.counted]
        np.minimum.at(ratios, cells, self.cells.pyramids(nodes).volumes[self.counted] / self.scales)
        return ratios

    def newly_inverted(self, nodes: np.ndarray) -> str:
        """Name the worst cell that is inverted and was not on the baseline, and the marker next to it."""
        return self.named([self.worst_new(nodes)])

    def worst_new(self, nodes: np.ndarray) -> NewlyInverted:
        """Find the worst of the cells judged here that are inverted and were not on the baseline."""
        is_new = self.cells.quality(nodes).is_inverted & ~self.was_inverted
        if not is_new.any():
            return NewlyInverted(0, np.inf, -1)
        ratios = np.where(is_new, self.cell_ratios(nodes), np.inf)
        cell = int(np.argmin(ratios) if np.isfinite(ratios).any() else np.argmax(is_new))
        return NewlyInverted(int(np.count_nonzero(is_new)), float(ratios[cell]), self.cells.first + cell)

    def named(self, parts: Sequence[NewlyInverted]) -> str:
        """Name the worst newly inverted cell, from the worst of parts of the cells; empty if none is."""
        parts = [part for part in parts if part.n]
        if not parts:
            return ""
        n, worst = sum(part.n for part in parts), min(parts, key=lambda part: part.ratio)
        faces, cells = self.mesh.cell_faces
        middle = self.mesh.points[np.unique(faces[cells == worst.cell])].mean(axis=0)
        marker = self.marker_at(middle)
        others = f", and {n - 1:,} more are" if n > 1 else ""
        return (
            f"{self.mesh.cell_name(worst.cell)} at ({', '.join(f'{x:.4g}' for x in middle)})"
            f"{f', next to marker {marker!r},' if marker else ''} is inverted{others}"
        )

    def marker_at(self, place: np.ndarray) -> str:
        """Marker that has the nearest node; empty if there are none."""
        distances = {
            name: float(np.linalg.norm(self.mesh.points[faces].reshape(-1, 3) - place, axis=1).min(initial=np.inf))
            for name, faces in (self.mesh.markers or {}).items()
        }
        return min(distances, key=lambda name: distances[name]) if distances else ""

    def _ratios(self, nodes: np.ndarray, names: Iterable[str]) -> dict[str, np.ndarray]:
        """Numbers bounded by each aggregate; an upper bound takes the negative ones."""
        is_of_heights = {name: AGGREGATES[name].is_of_heights for name in names}
        found = {}
        if not all(is_of_heights.values()):
            found[False] = self.cells.pyramids(nodes).volumes[self.counted] / self.scales
        if any(is_of_heights.values()):
            found[True] = self.heights.ratios(nodes)
        return {name: _sign(name) * found[of_heights] for name, of_heights in is_of_heights.items()}

    def _weights(self, nodes: np.ndarray, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Derivatives of aggregates with respect to all numbers that each bounds."""
        ratios = self._ratios(nodes, values)
        return {name: self._rule(name).weights(ratios[name], _sign(name) * values[name]) for name in values}

    def _rule(self, name: str) -> KreisselmeierSteinhauser:
        return KreisselmeierSteinhauser(self.rho_height if AGGREGATES[name].is_of_heights else self.rho)


def _sign(name: str) -> float:
    """Sign of an aggregate: -1 for an upper bound, which is minus the lower bound of the negative numbers."""
    return -1.0 if AGGREGATES[name].is_upper else 1.0
