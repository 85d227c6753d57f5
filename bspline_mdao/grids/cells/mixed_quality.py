"""Quality of cells of mixed kinds as a function of the nodes: bounds with derivatives, and which cells are inverted.

Bounded from below are the volumes of the pyramids between the middle of a cell and its faces (`.pyramids`), over those
of the baseline: while they are positive, no cell is inverted. Heights of the nodes next to walls are beside them
(`.node_heights`). `.aggregates` has the table of bounds, and says which of them cells of mixed kinds have.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from .aggregates import AGGREGATES, KreisselmeierSteinhauser
from .grid_quality import GridValues
from .mixed_cells import MixedMesh
from .node_heights import NodeHeights
from .quads import rings

__all__ = ["MixedQuality", "MixedReport"]

FLAT = 1e-12
"""Part of the volume of its cell that a pyramid has to have on the baseline to count: less is rounding."""


@dataclass(frozen=True)
class MixedReport:
    """Quality of a mesh of mixed cells."""

    n_cells: int
    min_volume: float  # smallest volume of a cell (m^3)
    min_ratio: float  # smallest volume of a pyramid between the middle of a cell and a face, over the baseline's
    n_inverted: int  # cells with a pyramid that is not positive
    n_newly_inverted: int  # those of them that were valid on the baseline
    heights: tuple[float, float]  # least and largest height of a node next to a wall, over the baseline's


@dataclass(frozen=True, eq=False)
class MixedQuality(OneLine):
    """Quality of the cells of a mesh whose baseline has decided which pyramids count; made by `of`.

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
    counted: np.ndarray  # int (n,), pyramids that count: those of cells that are valid on the baseline
    scales: np.ndarray  # (n,), their volumes on the baseline (m^3)
    was_inverted: np.ndarray  # bool (n_cells,), cells that are inverted on the baseline
    heights: NodeHeights
    rho: float = 100.0  # sharpness of the bound of cells
    rho_height: float = 1000.0  # sharpness of the bounds of heights

    @classmethod
    def of(
        cls,
        mesh: MixedMesh,
        walls: np.ndarray,  # int (n_faces, 4), faces of the walls, around the normal into the mesh
        rho: float = 100.0,
        rho_height: float = 1000.0,
    ) -> MixedQuality:
        """Decide about the cells of a baseline."""
        for sharpness in (rho, rho_height):
            KreisselmeierSteinhauser(sharpness)
        volumes, quality, (_, cells) = mesh.pyramids().volumes, mesh.quality(), mesh.sides
        is_counted = ~quality.is_inverted[cells] & (volumes > FLAT * quality.volumes[cells])
        counted = np.flatnonzero(is_counted)
        heights = NodeHeights.of(mesh, walls)
        return cls(mesh, counted, volumes[counted], quality.is_inverted, heights, rho, rho_height)

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
        """Names of the aggregates that the mesh has: those of heights only where it has walls."""
        has_heights = len(self.heights.rows) > 0
        return tuple(name for name, a in AGGREGATES.items() if a.of_mixed and (has_heights or not a.is_of_heights))

    def require(self, names: Sequence[str], cells: bool = False) -> None:
        """Refuse names of aggregates that the mesh has not, and Q of every cell."""
        if cells:
            raise InputError(
                f"{self.mesh.source}: Q of every cell, Eq. (9), is of hexahedra in blocks, and cells of this mesh have "
                f"none; leave 'cells' out"
            )
        missing = next((name for name in names if name not in self.aggregates), None)
        if missing is None:
            return
        if missing not in AGGREGATES:
            raise InputError(f"no aggregate '{missing}'; choose from {', '.join(self.aggregates)}")
        if AGGREGATES[missing].of_mixed:
            raise InputError(f"'{missing}': {self.mesh.source} has no nodes next to a wall to measure")
        raise InputError(
            f"'{missing}' is of hexahedra in blocks, and {self.mesh.source} has cells of mixed kinds; choose from "
            f"{', '.join(self.aggregates)}"
        )

    def evaluate(self, nodes: np.ndarray, names: Sequence[str] | None = None, cells: bool = False) -> GridValues:
        """Aggregate the quality of the mesh with nodes, shape (n_points, 3)."""
        names = self.aggregates if names is None else names
        self.require(names, cells)
        ratios = self._ratios(nodes, names)
        return GridValues({name: _sign(name) * self._bound(name, ratios[name]) for name in names})

    def jvp(self, nodes: np.ndarray, d_nodes: np.ndarray, values: GridValues) -> GridValues:
        """Change of the aggregates with the nodes."""
        weights, changes = self._weights(nodes, values.aggregates), {}
        if any(not AGGREGATES[name].is_of_heights for name in weights):
            changes[False] = self.mesh.pyramids(nodes).jvp(d_nodes)[self.counted] / self.scales
        if any(AGGREGATES[name].is_of_heights for name in weights):
            changes[True] = self.heights.jvp(nodes, d_nodes)
        found = {name: float(weight @ changes[AGGREGATES[name].is_of_heights]) for name, weight in weights.items()}
        return GridValues(found)

    def vjp(self, nodes: np.ndarray, values: GridValues, bar: GridValues) -> np.ndarray:
        """Adjoint of the nodes, shape (n_points, 3), from that of the aggregates."""
        asked = {name: values.aggregates[name] for name, seed in bar.aggregates.items() if seed}
        weights, nodes_bar = self._weights(nodes, asked), np.zeros_like(nodes)
        for name, weight in weights.items():
            seeded = bar.aggregates[name] * weight
            if AGGREGATES[name].is_of_heights:
                nodes_bar += self.heights.vjp(nodes, seeded)
            else:
                of_pyramids = np.zeros(len(self.mesh.sides[1]))
                of_pyramids[self.counted] = seeded / self.scales
                nodes_bar += self.mesh.pyramids(nodes).vjp(of_pyramids)
        return nodes_bar

    def report(self, nodes: np.ndarray, n_bins: int = 50) -> MixedReport:
        """Report on the mesh with nodes, shape (n_points, 3); ``n_bins`` is of distributions, which there are not."""
        quality, heights = self.mesh.quality(nodes), self.heights.ratios(nodes)
        ratios = self.mesh.pyramids(nodes).volumes[self.counted] / self.scales
        return MixedReport(
            n_cells=self.n_cells,
            min_volume=float(quality.volumes.min()),
            min_ratio=float(ratios.min(initial=np.inf)),
            n_inverted=int(np.count_nonzero(quality.is_inverted)),
            n_newly_inverted=int(np.count_nonzero(quality.is_inverted & ~self.was_inverted)),
            heights=(float(heights.min(initial=np.inf)), float(heights.max(initial=0.0))),
        )

    def cell_ratios(self, nodes: np.ndarray) -> np.ndarray:
        """Least of the pyramids of every cell by that before, shape (n_cells,); infinite where none counts."""
        ratios = np.full(self.n_cells, np.inf)
        cells = self.mesh.sides[1][self.counted]
        np.minimum.at(ratios, cells, self.mesh.pyramids(nodes).volumes[self.counted] / self.scales)
        return ratios

    def newly_inverted(self, nodes: np.ndarray) -> str:
        """Name the worst cell that is inverted and was not on the baseline, and the marker next to it."""
        is_new = self.mesh.quality(nodes).is_inverted & ~self.was_inverted
        if not is_new.any():
            return ""
        faces, cells = self.mesh.cell_faces
        ratios = np.where(is_new, self.cell_ratios(nodes), np.inf)
        cell = int(np.argmin(ratios) if np.isfinite(ratios).any() else np.argmax(is_new))
        middle = self.mesh.points[np.unique(faces[cells == cell])].mean(axis=0)
        marker = self.marker_at(middle)
        n = int(np.count_nonzero(is_new))
        others = f", and {n - 1:,} more are" if n > 1 else ""
        return (
            f"{self.mesh.cell_name(cell)} at ({', '.join(f'{x:.4g}' for x in middle)})"
            f"{f', next to marker {marker!r},' if marker else ''} is inverted{others}"
        )

    def marker_at(self, place: np.ndarray) -> str:
        """Marker that has the nearest node; empty where there are none."""
        distances = {
            name: float(np.linalg.norm(self.mesh.points[faces].reshape(-1, 3) - place, axis=1).min(initial=np.inf))
            for name, faces in (self.mesh.markers or {}).items()
        }
        return min(distances, key=lambda name: distances[name]) if distances else ""

    def _ratios(self, nodes: np.ndarray, names: Iterable[str]) -> dict[str, np.ndarray]:
        """Numbers that each aggregate bounds; an upper bound takes the negative ones."""
        is_of_heights = {name: AGGREGATES[name].is_of_heights for name in names}
        found = {}
        if not all(is_of_heights.values()):
            found[False] = self.mesh.pyramids(nodes).volumes[self.counted] / self.scales
        if any(is_of_heights.values()):
            found[True] = self.heights.ratios(nodes)
        return {name: _sign(name) * found[of_heights] for name, of_heights in is_of_heights.items()}

    def _weights(self, nodes: np.ndarray, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Derivatives of aggregates with respect to all that each bounds."""
        ratios = self._ratios(nodes, values)
        return {name: self._rule(name).weights(ratios[name], _sign(name) * values[name]) for name in values}

    def _bound(self, name: str, ratios: np.ndarray) -> float:
        rule = self._rule(name)
        return rule.value(rule.part(ratios))

    def _rule(self, name: str) -> KreisselmeierSteinhauser:
        return KreisselmeierSteinhauser(self.rho_height if AGGREGATES[name].is_of_heights else self.rho)


def _sign(name: str) -> float:
    """Sign of an aggregate: -1 of an upper bound, which is minus the lower bound of the negative numbers."""
    return -1.0 if AGGREGATES[name].is_upper else 1.0
