"""A mesh in the format of SU2: cells and markers once, nodes again for each design.

SU2's numbers of nodes are as in the mesh, or in the two-dimensional file from which it was read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...core.background.mesh_model import MeshModel
from ...core.model.fitted_model import FittedModel
from ...core.model.movable import Movable
from ...errors import InputError
from ...grids.cells.grid_mesh import grid_mesh
from ...grids.cells.mixed_cells import MixedMesh
from .frame import Su2Frame

__all__ = ["MeshToFly", "Su2Mesh"]

CELLS = {"tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14}
PLANE_CELLS = {"wedge": 5, "hexahedron": 9}
LINE, TRIANGLE, QUAD = 3, 5, 9
"""VTK's numbers of cells, of cells of a two-dimensional layer, and of faces."""

UNDECLARED = "other"
"""Kind of undeclared boundaries, and the marker of unnamed ones."""


@dataclass(frozen=True, eq=False)
class MeshToFly(OneLine):
    """The mesh of a model, and the kinds of its markers."""

    mesh: MixedMesh
    kinds: Mapping[str, str]  # by names of the markers
    rows: np.ndarray  # (n_file,), rows of the model's nodes for SU2's nodes

    @classmethod
    def of(cls, model: Movable) -> MeshToFly:
        """Take the mesh of a model, or the cells of a grid of blocks."""
        if isinstance(model, MeshModel):
            mesh, kinds = model.mesh, dict(model.kinds)
        elif isinstance(model, FittedModel):
            boundary = model.topology.boundary
            names = {face.window: face.patch or face.kind or UNDECLARED for face in boundary}
            kinds = {names[face.window]: face.kind or UNDECLARED for face in boundary}
            mesh = grid_mesh(model.regenerate(), model.topology, names)
        else:
            raise InputError("SU2 has all of the mesh; give the whole model of a grid or of a mesh")
        if mesh.polyhedra is not None and len(mesh.polyhedra[0]):
            raise InputError(
                f"{mesh.source}: has polyhedra, or cells that are collapsed, which SU2 cannot read; give tetrahedra, "
                f"pyramids, wedges and hexahedra"
            )
        markers = mesh.markers or {}
        missing = [name for name in markers if name not in kinds]
        if missing:
            raise InputError(f"{mesh.source}: nothing says what marker '{missing[0]}' is; declare its kind")
        rows = np.arange(mesh.n_stored)
        if mesh.numbers is not None and isinstance(model, FittedModel):
            _, rows = np.unique(mesh.numbers, return_index=True)  # for nodes that blocks share, the first counts
        return cls(mesh, {name: kinds[name] for name in markers if len(markers[name])}, rows)

    def on_mesh(self, nodes: np.ndarray) -> np.ndarray:
        """Nodes of the mesh, shape (n_points, 3), from nodes of the model."""
        return nodes if len(nodes) == self.mesh.n_points else nodes[self.rows]

    @property
    def walls(self) -> list[str]:
        """Names of the walls."""
        return [name for name, kind in self.kinds.items() if kind == "wall"]

    @property
    def across(self) -> int | None:
        """Axis normal to the plane of a two-dimensional mesh; None in three dimensions."""
        if self.mesh.n_copies == 1:
            return None
        low, high = np.split(self.mesh.points, 2)
        return int(np.argmax(np.abs(high - low).max(axis=0)))


@dataclass(frozen=True, eq=False)
class Su2Mesh(OneLine):
    """Text of the cells and markers, and the frame for the nodes."""

    head: str  # cells, before the nodes
    tail: str  # markers, which SU2 only accepts after them
    frame: Su2Frame

    @classmethod
    def of(cls, flown: MeshToFly, frame: Su2Frame) -> Su2Mesh:
        """Format cells and markers."""
        mesh, is_plane = flown.mesh, frame.n_axes == 2
        numbers = PLANE_CELLS if is_plane else CELLS
        parts = [f"NDIME= {frame.n_axes}", f"NELEM= {sum(map(len, mesh.cells.values()))}"]
        for kind, corners in mesh.cells.items():
            parts += _elements(numbers[kind], corners[:, : corners.shape[1] // 2] if is_plane else corners)
        markers = {name: faces for name, faces in (mesh.markers or {}).items() if len(faces)}
        ends = [f"NMARK= {len(markers)}"]
        for name, faces in markers.items():
            ends += [f"MARKER_TAG= {name}", f"MARKER_ELEMS= {len(faces)}"]
            if is_plane:
                ends += _elements(LINE, faces[:, :2])
            else:
                is_triangle = faces[:, 2] == faces[:, 3]
                ends += _elements(TRIANGLE, faces[is_triangle, :3]) + _elements(QUAD, faces[~is_triangle])
        return cls("\n".join([*parts, ""]), "\n".join([*ends, ""]), frame)

    def text(self, nodes: np.ndarray) -> str:
        """Text with nodes, shape (n_file, 3), in the grid's axes."""
        points = nodes @ self.frame.rows.T
        form = " ".join(["%.17g"] * points.shape[1])
        lines = "\n".join(form % tuple(point) for point in points.tolist())
        return f"{self.head}NPOIN= {len(points)}\n{lines}\n{self.tail}"


def _elements(number: int, corners: np.ndarray) -> list[str]:
    """Lines of elements of one kind."""
    return [f"{number} {' '.join(map(str, row))}" for row in corners.tolist()]
