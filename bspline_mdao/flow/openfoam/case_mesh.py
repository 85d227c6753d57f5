"""The mesh of a case for the nodes of a model: blocks, a ``polyMesh`` as it was read, or any other mesh."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.display import OneLine
from ...core.background.mesh_model import MeshModel
from ...core.model.model import Model
from ...core.model.movable import Movable
from ...errors import InputError, MovementError
from ...grids.cells.cell_faces import BoundaryFaces, CellFaces
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.io.formats import POLYMESH
from ...grids.io.mesh_polymesh import polymesh_of
from ...grids.io.meshes.polymesh import PolyMeshFolder, read_polymesh
from ...grids.io.openfoam import Planes, PolyMesh
from .wall_loads import CaseWalls

__all__ = ["CaseMesh"]

PLACE = f"constant/{POLYMESH}"
"""Place of the mesh of a case."""


@dataclass(frozen=True, eq=False)
class CaseMesh(OneLine):
    """The mesh that is written for the nodes of a model."""

    # the mesh on the baseline, in OpenFOAM's order; or the folder from which it was read, of which all but the points
    # is copied
    faces: PolyMesh | PolyMeshFolder
    cells: CellFaces | MixedMesh  # judges its cells
    boundary: tuple[BoundaryFaces, ...]  # the patches, with their names in OpenFOAM
    baseline: np.ndarray  # (n_nodes, 3), nodes of the model (m)

    @classmethod
    def of(cls, model: Movable) -> CaseMesh:
        """Find the mesh of a model; `InputError` if no patch is a wall."""
        if isinstance(model, Model):
            nodes = model.local_nodes()
            faces = PolyMesh.of(model.topology, nodes)
            found = cls(faces, CellFaces.of(model.topology, nodes), faces.boundary, nodes)
        elif isinstance(model, MeshModel):
            found = cls._of_mesh(model)
        else:
            raise InputError(f"{model.source}: a case of OpenFOAM needs a fitted grid or a mesh; give one of these")
        if not found.walls:
            raise InputError(f"{model.source}: no patch is of kind wall; declare patches")
        return found

    @classmethod
    def _of_mesh(cls, model: MeshModel) -> CaseMesh:
        """Find the mesh for an unstructured mesh."""
        path = Path(model.mesh_file)
        if path.name == POLYMESH and path.is_dir():
            folder = read_polymesh(path)
            if np.shape(folder.mesh.points) != np.shape(model.mesh.points):
                raise InputError(f"{path}: is not the mesh of the model; fit it again")
            kinds = (BoundaryFaces(name, model.kinds.get(name), 0, 0) for name in folder.mesh.markers or {})
            return cls(folder, model.mesh, tuple(kinds), model.mesh.points)
        faces = polymesh_of(model.mesh, model.kinds)
        return cls(faces, model.mesh, faces.boundary, model.mesh.points)

    @property
    def walls(self) -> list[str]:
        """Names of the patches that are walls."""
        return [patch.name for patch in self.boundary if patch.kind == "wall"]

    @property
    def digest(self) -> str:
        """Digest of the connectivity of its cells, which a solution must match."""
        if isinstance(self.faces, PolyMesh):
            parts = [self.faces.owner, self.faces.neighbour]
        else:
            parts = list(self.faces.mesh.cell_faces)
        found = hashlib.blake2b(digest_size=16)
        for part in parts:
            found.update(np.ascontiguousarray(part).tobytes())
        return found.hexdigest()

    def points(self, nodes: np.ndarray) -> np.ndarray:
        """Points of the case at nodes of the model, shape (n_nodes, 3)."""
        return nodes[self.faces.rows] if isinstance(self.faces, PolyMesh) else nodes

    def write(self, case: Path, nodes: np.ndarray, planes: Planes) -> None:
        """Write the mesh with other nodes, shape (n_nodes, 3); `MovementError` if cells are inside out."""
        self._require_volumes(nodes)
        place = case / PLACE
        if isinstance(self.faces, PolyMesh):
            faces = self.faces.at(nodes)
            faces.require_depth(planes)
            faces.write(place, planes)
        else:
            self.faces.write(place, nodes)

    def patches_of(self, kind: str) -> CaseWalls:
        """Faces of the patches of a kind, on the baseline."""
        chosen = [patch for patch in self.boundary if patch.kind == kind]
        if not isinstance(self.faces, PolyMesh):
            return CaseWalls.of(self.faces.file.path.parent, [patch.name for patch in chosen])
        faces, ranges = self.faces, [np.arange(patch.start, patch.stop) for patch in chosen]
        rows = np.concatenate([np.zeros(0, dtype=int), *ranges])
        ends = np.cumsum([0, *map(len, ranges)]).tolist()
        is_corner = faces.is_corner[rows]
        return CaseWalls(
            patches={patch.name: slice(start, stop) for patch, start, stop in zip(chosen, ends, ends[1:])},
            corners=faces.corners[rows][is_corner],
            sizes=is_corner.sum(axis=1),
            cells=faces.owner[rows],
            n_cells=int(faces.owner.max()) + 1,
            points=faces.points,
        )

    def _require_volumes(self, nodes: np.ndarray) -> None:
        if isinstance(self.cells, CellFaces):
            try:
                self.cells.require_volumes(nodes)
            except InputError as error:
                raise MovementError(str(error)) from error
        else:
            n_negative = int(np.count_nonzero(self.cells.quality(nodes).volumes <= 0.0))
            if n_negative:
                raise MovementError(
                    f"{self.cells.source}: {n_negative} cells have no positive volume; take a smaller step"
                )
