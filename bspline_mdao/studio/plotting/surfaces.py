"""Drawable surfaces: the pieces of the boundary of a grid and the faces of a control mesh, with values on them.

They are plain arrays. `.plot` draws them, and other code may do so too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...core.model.model import Model
from ...flow.euler.fields import field_values
from ...flow.euler.gas import N_STATES
from ...grids.cells.cell_fields import cell_fields, cell_middle, face_layer
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.grid import Grid
from ...grids.topology.index_space import Window
from ...grids.topology.topology import Topology

__all__ = [
    "AnySheet",
    "FacetSheet",
    "Sheet",
    "control_sheets",
    "flow_sheets",
    "grid_sheets",
    "joined_sheets",
    "values_behind",
    "worst_cells",
]


@dataclass(frozen=True, eq=False)
class Sheet:
    """A structured piece of surface."""

    name: str  # of the patch
    kind: str  # of the patch, or ``"control mesh"``
    points: np.ndarray  # (n, m, 3) (m)
    window: Window  # face window of a block of the grid
    values: Mapping[str, np.ndarray] = field(default_factory=dict)  # fields on its faces, (n - 1, m - 1)

    def __repr__(self) -> str:
        n, m = self.points.shape[:2]
        return f"Sheet({self.name!r}, {self.kind}, {n} x {m} points, values: {', '.join(self.values) or 'none'})"

    @property
    def corners(self) -> np.ndarray:
        """Its points (m), shape (n m, 3)."""
        return self.points.reshape(-1, 3)

    @property
    def quads(self) -> np.ndarray:
        """Numbers of the corners of its faces, in order around each, shape (n_faces, 4)."""
        ids = np.arange(self.points.size // 3).reshape(self.points.shape[:2])
        return np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)


@dataclass(frozen=True, eq=False)
class FacetSheet:
    """A piece of surface of unstructured triangles and quads."""

    name: str  # of the patch
    kind: str  # of the patch, ``"control mesh"``, or ``"slice"``
    corners: np.ndarray  # (n, 3), its points (m)
    quads: np.ndarray  # int (m, 4), corners of its faces; triangles repeat their last corner
    values: Mapping[str, np.ndarray] = field(default_factory=dict)  # fields on its faces, (m,)

    def __repr__(self) -> str:
        values = ", ".join(self.values) or "none"
        return f"FacetSheet({self.name!r}, {self.kind}, {len(self.quads)} faces, values: {values})"


AnySheet = Sheet | FacetSheet


def joined_sheets(sheets: Sequence[AnySheet]) -> tuple[np.ndarray, np.ndarray]:
    """Join sheets into one list of quadrilaterals."""
    # returns points (n, 3): all of their points (m)
    # returns quads int (m, 4): corners of their faces, in order around each, sheet by sheet
    starts = np.cumsum([0, *(len(sheet.corners) for sheet in sheets)])
    quads = [sheet.quads + start for sheet, start in zip(sheets, starts.tolist())]
    return np.concatenate([sheet.corners for sheet in sheets]), np.concatenate(quads)


def grid_sheets(grid: Grid, fields: bool = False, topology: Topology | None = None) -> list[Sheet]:
    """Cut the boundary of a grid into sheets; without patches, faces without a neighbour are of the kind ``other``.

    A block that is one node deep is a sheet itself, as if it were a plane of symmetry. With ``fields`` the faces have
    the values of the cells behind them, see `bspline_mdao.grids.cells.cell_fields`. With a topology the sheets are its
    boundary, in its order.
    """
    found = cell_fields(grid) if fields else {}
    sheets = []
    for name, kind, window in _windows(grid, topology):
        net = _net(grid.blocks[window.block].nodes[window.slices])
        if net is not None:
            sheets.append(Sheet(name, kind, net, window, values_behind(found, grid, window)))
    return sheets


def _windows(grid: Grid, topology: Topology | None) -> Iterator[tuple[str, str, Window]]:
    """Name, kind and window of every sheet of a grid."""
    if topology is None and not grid.patches:
        from ...grids.topology.detection import (
            find_topology,  # it searches for all neighbours: only if nothing is declared
        )

        topology = find_topology(grid)
    if topology is None:
        for patch in grid.patches:
            yield from ((patch.name, patch.kind, window) for window in patch.windows)
    else:
        for face in topology.boundary:
            yield face.patch or "boundary", face.kind or "other", face.window
    for number, block in enumerate(grid.blocks):
        if 1 in block.shape:
            yield block.name, "symmetry", Window.whole(number, block.shape)


def _net(nodes: np.ndarray) -> np.ndarray | None:
    """Points of a window that is a surface, without its flat direction; None for a line or a point."""
    long = [n for n in nodes.shape[:3] if n > 1]
    return nodes.reshape(*long, 3) if len(long) == 2 else None


def values_behind(fields: Mapping[str, Sequence[np.ndarray]], grid: Grid, window: Window) -> dict[str, np.ndarray]:
    """Values of the cells behind a window, on its faces."""
    shape = grid.shapes[window.block]
    size = tuple(n - 1 for n in window.shape if n > 1)
    return {name: face_layer(arrays[window.block], window, shape).reshape(size) for name, arrays in fields.items()}


def control_sheets(
    model: Model, control_points: np.ndarray | None = None, kinds: Sequence[str] = ("wall",)
) -> list[Sheet]:
    """Cut the faces of the control mesh, fitted or moved, on patches of some kinds into sheets.

    All are of the kind ``control mesh``; their windows are of the control points of a segment.
    """
    points = np.reshape(model.control_points if control_points is None else control_points, (-1, 3))
    sheets = []
    for face in model.topology.boundary:
        if face.kind in kinds:
            for ids, segment in zip(model.mesh.control_ids, model.topology.segments):
                part = _on_face(ids, segment, face.window)
                if part is not None:
                    sheets.append(Sheet(str(face.patch), "control mesh", points[part], face.window))
    return sheets


def _on_face(ids: np.ndarray, segment: Window, face: Window) -> np.ndarray | None:
    """Numbers of the control points of a segment on a face of the grid; None if it has no part of the face."""
    for d in range(3):
        side = int(face.lo[d] == segment.hi[d])
        is_end = face.lo[d] == face.hi[d] == (segment.hi[d] if side else segment.lo[d])
        if is_end and segment.lo[d] < segment.hi[d] and segment.face(2 * d + side).overlaps(face):
            part = np.take(ids, -side, axis=d)
            return part if min(part.shape) > 1 else None
    return None


def flow_sheets(
    model: Model,  # the fitted grid
    grid: Grid,  # with the nodes of the flow
    pressures: np.ndarray,  # (n_wall,), the output ``Cp`` of `EulerFlow`
    states: np.ndarray | None = None,  # (5 n_cells,) or (n_cells, 5), its states
    mach: float | None = None,  # of the free stream, with states
) -> list[Sheet]:
    """Give the sheets of a grid the fields of a flow: from the cells behind faces, ``Cp`` on walls from the faces."""
    fields: dict[str, list[np.ndarray]] = {}
    if states is not None and mach is not None:
        for name, values in field_values(np.reshape(states, (-1, N_STATES)), mach).items():
            if values.ndim == 1:
                fields[name] = grid.layout.cells.split(values)
    sheets = grid_sheets(grid, topology=model.topology)
    on_walls = iter(_on_wall_faces(sheets, np.ravel(pressures)))
    return [
        replace(
            sheet, values=values_behind(fields, grid, sheet.window) | (next(on_walls) if sheet.kind == "wall" else {})
        )
        for sheet in _patch_after_patch(sheets)
    ]


def _patch_after_patch(sheets: Sequence[Sheet]) -> list[Sheet]:
    """Sheets in the order in which a flow numbers their faces: all of a patch together."""
    names = {sheet.name: n for n, sheet in reversed(list(enumerate(sheets)))}
    return sorted(sheets, key=lambda sheet: names[sheet.name])


def _on_wall_faces(sheets: Sequence[Sheet], pressures: np.ndarray) -> Iterator[dict[str, np.ndarray]]:
    """Pressure coefficients of every wall, as fields."""
    walls = [sheet for sheet in _patch_after_patch(sheets) if sheet.kind == "wall"]
    for values in BlockLayout.of(sheet.points.shape[:2] for sheet in walls).cells.split(pressures):
        yield {"Cp": values}


def worst_cells(grid: Grid, n_cells: int = 10) -> np.ndarray:
    """Centres (n, 3) of the cells with the smallest corners (m), the worst first."""
    middles, corners = [], []
    for block, values in zip(grid.blocks, cell_fields(grid)["smallest_corner"]):
        ids = np.argsort(values, axis=None, kind="stable")[:n_cells]
        for index in zip(*np.unravel_index(ids, values.shape)):
            middles.append(cell_middle(block.nodes, index))
            corners.append(values[index])
    order = np.argsort(corners, kind="stable")[:n_cells]
    return np.array(middles).reshape(-1, 3)[order]
