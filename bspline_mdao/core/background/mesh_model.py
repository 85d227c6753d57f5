"""A mesh without structure, ready to move: its walls, the planes that it ends in, and the lattice around it.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array, diags_array

from ...base.display import OneLine
from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ..design.deformation import Deformation
from ..mesh.boundary import matching_names
from ..mesh.moving_mesh import MovingMesh
from ..model.model_file import checksum_of
from ..riding.riding_mesh import EmbeddedMesh, RidingWalls
from ..riding.wall_faces import WallFaces
from ..walls.embedded_points import ON_PLANE
from .background_lattice import DEFAULTS, BackgroundLattice, LatticeSettings
from .end_planes import INNER, WALL, EndPlane, find_end_planes, lattice_axes
from .mesh_file import arrays_of, document_of, read_mesh_model, write_mesh_model
from .mesh_map import MeshMap
from .thin_plate import ThinPlate

__all__ = ["MeshModel"]

FADE = 8.0, 0.03
"""As that of meshes that ride along in a fitted grid: lattices miss less of the walls, so that less reach serves."""


@dataclass(frozen=True, eq=False)
class MeshModel(OneLine):
    """A mesh of tetrahedra, prisms and others, with what moves it. Made by `MeshModel.of`, or by `fit_mesh`.

    Its control points are the nodes of its walls and, after them, those of the lattice.

    Parameters
    ----------
    mesh : MixedMesh
        The mesh on the baseline.
    kinds : mapping of str to str
        Kinds of its markers: ``"wall"``, ``"symmetry"``, or anything else for the others.
    settings : LatticeSettings
        What the lattice is like.
    planes : tuple of EndPlane
        Planes that the mesh ends in, whose nodes stay in them.
    lattice : BackgroundLattice
        The lattice.
    mesh_file : str
        The mesh's own file, in whose bytes moved nodes are written; empty where it is not known.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.meshes import MeshModel, MixedMesh
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    >>> tetrahedra, floor = np.array([[0, 1, 2, 3], [1, 4, 2, 3]]), np.array([[0, 1, 2, 2]])
    >>> model = MeshModel.of(MixedMesh(corners, {"tetra": tetrahedra}, {"floor": floor}), {"floor": "wall"})
    >>> walls = corners[model.wall_rows] + [0.1, 0.0, 0.0]
    >>> moved = model.mover.move(model.control_points, walls)
    >>> model.node_map.at(moved.points).nodes[0].round(6)
    array([0.1, 0. , 0. ])
    """

    mesh: MixedMesh
    kinds: Mapping[str, str]
    settings: LatticeSettings
    planes: tuple[EndPlane, ...]
    lattice: BackgroundLattice
    mesh_file: str = ""

    @classmethod
    def of(
        cls,
        mesh: MixedMesh,
        kinds: Mapping[str, str],
        settings: LatticeSettings = DEFAULTS,
        mesh_file: str | os.PathLike = "",
    ) -> MeshModel:
        """Lay a lattice around a mesh.

        Parameters
        ----------
        mesh : MixedMesh
            The mesh on the baseline, with markers of its boundary.
        kinds : mapping of str to str
            Kinds of the markers, see `marker_kinds`: nodes of walls go where they are asked to, those of planes of
            symmetry stay in these, those inside the mesh move along, and all others stay.
        settings : LatticeSettings
            What the lattice is like.
        mesh_file : path-like
            The mesh's own file.

        Returns
        -------
        MeshModel

        Raises
        ------
        InputError
            If a marker does not exist, none is a wall, a marker of symmetry is not plane or not at an end of the mesh,
            or planes are not at right angles.
        """
        markers = mesh.markers or {}
        unknown = [name for name in kinds if name not in markers]
        if unknown:
            raise InputError(
                f"{mesh.source}: no marker is '{unknown[0]}'; its markers are {', '.join(markers) or 'none'}"
            )
        walls = [name for name in markers if kinds.get(name) == WALL]
        if not walls:
            raise InputError(f"{mesh.source}: no marker is a wall, so that nothing moves; say which are")
        wall_rows = np.unique(np.concatenate([markers[name] for name in walls]))
        planes = find_end_planes(mesh, kinds, wall_rows)
        axes, planes = lattice_axes(mesh.source, planes)
        section = _section_axis(mesh.points, planes, axes)
        lattice = BackgroundLattice.around(mesh.points, mesh.points[wall_rows], axes, section, settings)
        return cls(mesh, dict(kinds), settings, planes, lattice, os.fspath(mesh_file))

    def save(self, path: str | os.PathLike, compress: bool = True) -> None:
        """Write the model to one HDF5 file, see `bspline_mdao.core.background.mesh_file`."""
        write_mesh_model(path, self.mesh, dict(self.kinds), self.settings, self.mesh_file, compress)
        self._note_file(path)

    @classmethod
    def load(cls, path: str | os.PathLike) -> MeshModel:
        """Read a model from a file; `InputError` if it cannot be used."""
        model = cls.of(*read_mesh_model(path))
        model._note_file(path)
        return model

    def _note_file(self, path: str | os.PathLike) -> None:
        object.__setattr__(self, "_file", Path(path).absolute())

    @property
    def file(self) -> Path | None:
        """File that the model was saved to or loaded from last; None where it was neither."""
        return self.__dict__.get("_file")

    @cached_property
    def checksum(self) -> str:
        """Checksum of all that the model is, by which case files know their model."""
        return checksum_of(document_of(self.mesh, dict(self.kinds), self.settings), arrays_of(self.mesh))

    def with_settings(self, settings: LatticeSettings) -> MeshModel:
        """Lay another lattice around the mesh."""
        return MeshModel.of(self.mesh, self.kinds, settings, self.mesh_file)

    def design(self, markers: Sequence[str] = ()) -> np.ndarray:
        """Numbers of the nodes of some walls, by names or patterns of markers, among all of walls; all by default."""
        wanted = matching_names(self.walls.names, markers, self.mesh.source) if markers else set(self.walls.names)
        names = np.array(self.walls.names)[self.walls.marker]
        return np.flatnonzero(np.isin(self.wall_rows, self.walls.faces[np.isin(names, list(wanted))]))

    def design_mesh(self, numbers: np.ndarray) -> MovingMesh:
        """Control points with some nodes of walls, by `design`, as the surface that is deformed."""
        mesh = self.moving_mesh
        is_kept = np.isin(mesh.in_plane_rows, numbers)
        rows = np.searchsorted(numbers, mesh.in_plane_rows[is_kept])
        normals = mesh.in_plane_normals[is_kept]
        return replace(mesh, surface_ids=mesh.surface_ids[numbers], in_plane_rows=rows, in_plane_normals=normals)

    def deformed_walls(self, deformation: Deformation, numbers: np.ndarray) -> np.ndarray:
        """Where a deformation puts nodes of walls, by `design`; the others stay: shape (n_walls, 3), in metres."""
        walls = self.mesh.points[self.wall_rows]
        planes = []
        for plane in self.planes:
            ids = np.flatnonzero(np.isin(self.wall_rows[numbers], plane.rows))
            planes.append((ids, plane.normal))
        walls[numbers] = deformation.apply_to_nodes(walls[numbers], planes)
        if self.mesh.n_copies > 1:  # the copies of a mesh of two dimensions move as its nodes do
            change = walls - self.mesh.points[self.wall_rows]
            n = len(self.wall_rows) // 2
            walls[n:] += change[:n] - change[n:]
        return walls

    def wall_spacing(self) -> float:
        """Find the median height of the cells at the walls (m)."""
        walls = self.node_map.embedded.walls
        assert walls is not None
        return float(np.median(walls.heights(self.mesh.points)))

    @property
    def n_nodes(self) -> int:
        """Number of nodes of the mesh."""
        return self.mesh.n_points

    @cached_property
    def walls(self) -> WallFaces:
        """Faces of the walls."""
        markers = self.mesh.markers or {}
        names = tuple(name for name in markers if self.kinds.get(name) == WALL)
        faces = [self.mesh.into_fluid(markers[name]) for name in names]
        return WallFaces(names, np.concatenate(faces), np.repeat(np.arange(len(names)), [len(part) for part in faces]))

    @cached_property
    def wall_rows(self) -> np.ndarray:
        """Nodes of the walls, ascending: the first control points."""
        return np.unique(self.walls.faces)

    @cached_property
    def rows_at_rest(self) -> np.ndarray:
        """Nodes of markers that are neither walls nor in planes, ascending: they stay."""
        markers = self.mesh.markers or {}
        in_planes = {name for plane in self.planes for name in plane.markers}
        parts = [
            faces.ravel()
            for name, faces in markers.items()
            if name not in self.walls.names and name not in in_planes and self.kinds.get(name) != INNER
        ]
        resting = np.unique(np.concatenate([np.zeros(0, dtype=int), *parts]))
        return np.setdiff1d(resting, self.wall_rows)

    @cached_property
    def control_points(self) -> np.ndarray:
        """Nodes of the walls and control points of the lattice (m), shape (n_control_points, 3)."""
        return np.concatenate([self.mesh.points[self.wall_rows], self.lattice.control_points])

    @cached_property
    def moving_mesh(self) -> MovingMesh:
        """Control points, and what each may do."""
        n, lattice = len(self.wall_rows), self.lattice
        is_free = np.ones((*lattice.shape, 3), dtype=bool)
        closed = {(plane.axis, plane.end) for plane in self.planes}
        for axis in range(3):
            for end in (0, -1):
                side = np.moveaxis(is_free, axis, 0)[end]
                if (axis, end) in closed:
                    side[..., axis] = False
                else:
                    side[...] = False
        all_free = np.concatenate([np.zeros((n, 3), dtype=bool), is_free.reshape(-1, 3)])
        frames = None
        if not np.array_equal(lattice.axes, np.eye(3)):
            frames = np.broadcast_to(lattice.axes, (len(all_free), 3, 3))
        on_walls = [np.flatnonzero(np.isin(self.wall_rows, plane.rows)) for plane in self.planes]
        normals = [np.tile(plane.normal, (len(ids), 1)) for plane, ids in zip(self.planes, on_walls)]
        return MovingMesh(
            blocks=(n + np.arange(lattice.n_control, dtype=np.int32).reshape(lattice.shape),),
            names=("the lattice",),
            points=self.control_points,
            surface_ids=np.arange(n, dtype=np.int32),
            is_free=all_free,
            frames=frames,
            in_plane_rows=np.concatenate([np.zeros(0, dtype=int), *on_walls]),
            in_plane_normals=np.concatenate([np.zeros((0, 3)), *normals]),
            volumes=lattice.mesh.volumes,
        )

    @cached_property
    def mover(self) -> ThinPlate:
        """What moves the control points of the lattice behind the walls."""
        return ThinPlate(self.moving_mesh, self.lattice, self.mesh.points[self.rows_at_rest], self.settings)

    @cached_property
    def node_map(self) -> MeshMap:
        """Map from the control points to the nodes."""
        mesh, resting, lattice = self.mesh, self.rows_at_rest, self.lattice
        moving = np.setdiff1d(np.arange(mesh.n_points), resting)
        ends = [(np.searchsorted(moving, np.setdiff1d(plane.rows, resting)), plane) for plane in self.planes]
        evaluator = lattice.evaluator(mesh.points[moving], [(ids, plane.axis, plane.end) for ids, plane in ends])
        planes = [(plane.rows, plane.normal) for plane in self.planes]
        walls = RidingWalls.of(mesh, self.walls, planes, resting, np.zeros_like(mesh.points), FADE)
        walls = replace(walls, fading=_without_rows(walls.fading, resting))
        none, n = np.zeros(0, dtype=int), mesh.n_points
        embedded = EmbeddedMesh(
            mesh, lattice.control_points, evaluator, moving, none, None, np.zeros(n), walls, mesh.points
        )
        return MeshMap(embedded.with_baseline(), len(self.wall_rows))


def _without_rows(matrix: csr_array, rows: np.ndarray) -> csr_array:
    """Matrix with no entries in some rows."""
    kept = np.ones(matrix.shape[0])
    kept[rows] = 0.0
    matrix = csr_array(diags_array(kept) @ matrix)
    matrix.eliminate_zeros()
    return matrix


def _section_axis(points: np.ndarray, planes: tuple[EndPlane, ...], axes: np.ndarray) -> int | None:
    """Direction of the lattice across a section, whose nodes are all in the two planes across it."""
    for axis in range(3):
        pair = [plane for plane in planes if plane.axis == axis]
        if len(pair) == 2:
            across = points @ axes[axis]
            low, high = across.min(), across.max()
            if (np.minimum(across - low, high - across) <= ON_PLANE * np.linalg.norm(np.ptp(points, axis=0))).all():
                return axis
    return None
