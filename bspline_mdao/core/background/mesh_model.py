"""An unstructured mesh, ready to move: its walls, its end planes, and the lattice around it.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...base.checks import as_finite_points
from ...base.display import Plottable
from ...base.matching import MARKERS, matching_names
from ...errors import InputError
from ...grids.cells.cell_judge import CellJudge
from ...grids.cells.gathered_quality import GatheredQuality
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.cells.mixed_quality import MixedQuality
from ...grids.topology.node_partition import NodePartition
from ...grids.topology.partition import Subdomain
from ..design.deformation import Deformation
from ..fit.surface_fit import follower_of
from ..mesh.boundary import Selection, moving_mesh
from ..mesh.moving_mesh import MovingMesh
from ..mesh.surface import SurfaceGrid, surface_of
from ..mesh.surface_map import SurfaceMap, surface_map_of
from ..model.model_file import checksum_of
from ..model.movable import Movable
from ..movement.default_mover import default_mover
from ..riding.riding_walls import RidingWalls
from ..riding.wall_faces import WallFaces
from ..sliding.sliding_nodes import Slide, SlidingNodes
from ..splines.mesh import BSplineMesh
from ..walls.body_points import Body
from ..walls.wall_images import WallImages
from .background_lattice import BackgroundLattice
from .deformed_walls import deformed_walls, split_copies
from .end_planes import INNER, SLIDING, WALL, EndPlane, section_axis
from .lattice_settings import DEFAULTS, LatticeSettings
from .lattice_spans import MeshBox
from .mesh_file import arrays_of, document_of, read_mesh_model, write_mesh_model
from .mesh_map import MeshMap
from .mesh_nodes import map_of_nodes
from .mesh_points import MeshPoints
from .mesh_surface import map_to_surface, surface_of_faces
from .mesh_walls import FADE, faces_of_walls, following_walls, images_of_walls
from .periodic_sides import PeriodicSides, sides_of
from .points_to_move import points_to_move
from .refinement import refinements
from .sliding_markers import markers_that_slide, nodes_that_slide, with_sliding
from .thin_plate import ThinPlate
from .wall_follower import WallFollower

__all__ = ["MeshModel"]

OF_MESH = ("walls", "wall_rows", "rows_at_rest", "wall_images")
"""Attributes shared by models of the same mesh."""


@dataclass(frozen=True, eq=False)
class MeshModel(Plottable, Movable):
    """A mesh of tetrahedra, prisms and other cells, with its mover. Made by `MeshModel.of`, or by `fit_mesh`.

    Its control points are its wall nodes, followed by the control points of the lattice.

    Parameters
    ----------
    mesh : MixedMesh
        The mesh on the baseline.
    kinds : mapping of str to str
        Kinds of its markers: ``"wall"``, ``"symmetry"``, or another word for all others.
    settings : LatticeSettings
        Settings of the lattice.
    planes : tuple of EndPlane
        Planes in which the mesh ends, and in which their nodes stay.
    periodic : tuple of PeriodicSides
        Sides that are copies of each other by a shift or a rotation, whose nodes move equally.
    box : MeshBox
        The box and walls around which the lattice is laid.
    lattice : BackgroundLattice
        The lattice.
    mesh_file : str
        The mesh's own file, which receives moved nodes in place; empty if unknown.
    subdomain : Subdomain, optional
        Nodes of this model's process, see `part`; all by default.

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
    periodic: tuple[PeriodicSides, ...]
    box: MeshBox
    lattice: BackgroundLattice
    mesh_file: str = ""
    subdomain: Subdomain | None = None

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
            Kinds of the markers, see `marker_kinds`. Wall nodes move to their prescribed positions, and nodes of
            symmetry planes stay in these. Nodes inside the mesh or of no marker move with it. Nodes of periodic sides
            that are copies of each other by a shift or a rotation move equally. Nodes of kind ``"sliding"`` stay on
            their cylinder, cone, sphere or surface of revolution. All others stay.
        settings : LatticeSettings
            Settings of the lattice.
        mesh_file : path-like
            The mesh's own file.

        Returns
        -------
        MeshModel

        Raises
        ------
        InputError
            If a marker does not exist, none is a wall, a symmetry marker is not plane or not at an end of the mesh, or
            planes are not perpendicular.
        """
        faces = faces_of_walls(mesh, kinds)
        frame, planes, sides = sides_of(mesh, kinds, np.unique(faces))
        section, periods = section_axis(mesh.points, planes, frame.axes), {each.axis: each.period for each in sides}
        box = MeshBox.of(mesh.source, mesh.points, faces, frame, section, periods)
        return cls(mesh, dict(kinds), settings, planes, sides, box, box.lattice(settings), os.fspath(mesh_file))

    def save(self, path: str | os.PathLike, compress: bool = True) -> None:
        """Write the model to one HDF5 file, see `bspline_mdao.core.background.mesh_file`."""
        write_mesh_model(path, self.mesh, dict(self.kinds), self.settings, self.mesh_file, compress)
        self._note_file(path)

    @classmethod
    def load(cls, path: str | os.PathLike) -> MeshModel:
        """Read a model from a file; `InputError` if it is invalid."""
        model = cls.of(*read_mesh_model(path))
        model._note_file(path)
        return model

    def _note_file(self, path: str | os.PathLike) -> None:
        object.__setattr__(self, "_file", Path(path).absolute())

    @property
    def file(self) -> Path | None:
        """File that the model was last saved to or loaded from; None if neither."""
        return self.__dict__.get("_file")

    @cached_property
    def checksum(self) -> str:
        """Checksum of the whole model, by which case files identify it."""
        return checksum_of(document_of(self.mesh, dict(self.kinds), self.settings), arrays_of(self.mesh))

    def with_settings(self, settings: LatticeSettings) -> MeshModel:
        """Lay another lattice around the mesh."""
        other = replace(self, settings=settings, lattice=self.box.lattice(settings))
        names = (*OF_MESH, "following_walls")
        other.__dict__.update({name: self.__dict__[name] for name in names if name in self.__dict__})
        return other

    def refined_for(self, walls: Sequence[np.ndarray]) -> MeshModel:
        """Refine the lattice for known moves, such as the moves at the bounds of design variables.

        Its spans are halved where the remaining distance from the walls is more than the cells above them can absorb.
        Do this once, before a study or an optimisation, so all designs share one lattice. Of the lattices on the way
        that invert no more cells by any of the moves, the one that inverts the fewest is chosen, the finest of equals.

        Parameters
        ----------
        walls : sequence of ndarray, shape (n_walls, 3)
            Positions of the wall nodes after each move (m), in the order of ``wall_rows``.

        Returns
        -------
        MeshModel
            This model if the lattice is fine enough, or if finer ones invert more cells.
        """
        at = self.mesh.points[self.wall_rows]
        changes = [as_finite_points(each, len(at), f"{self.source}: nodes of walls") - at for each in walls]
        reach = FADE[1] * float(np.linalg.norm(np.ptp(at, axis=0)))
        laid = {self.settings: self}

        def mover_of(settings: LatticeSettings) -> ThinPlate:
            if settings not in laid:
                laid[settings] = self.with_settings(settings)
            return laid[settings].mover

        found = [laid[settings] for settings in refinements(mover_of, self.settings, changes, reach)]
        if len(found) == 1:
            return self
        counts = np.array([[model.n_inverted(each) for each in walls] for model in found])
        fit = np.flatnonzero((counts <= counts[0]).all(axis=1))[::-1]
        return found[fit[np.argmin(counts[fit].sum(axis=1))]]

    def n_inverted(self, walls: np.ndarray) -> int:
        """Count the cells that are inverted by moving the wall nodes to ``walls`` (m), shape (n_walls, 3)."""
        whole = self if self.subdomain is None else replace(self, subdomain=None)
        nodes = whole.node_map.at(whole.mover.move(whole.control_points, walls).points).nodes
        return int((self.mesh.quality(nodes).is_inverted & ~self.mesh.quality().is_inverted).sum())

    def deformed(self, deformation: Deformation) -> np.ndarray:
        """Positions (m) of the deformed wall nodes on the design surface, shape (n_surface, 3)."""
        return deformed_walls(deformation)

    def split_copies(self, deformation: Deformation) -> tuple[float, str]:
        """Largest difference (m) between a deformation of wall nodes and of their copies, and its location."""
        return split_copies(deformation)

    def wall_spacing(self) -> float:
        """Find the median height of the cells at the walls (m)."""
        walls = self.node_map.embedded.walls
        assert walls is not None
        return float(np.median(walls.heights(self.mesh.points)))

    @property
    def n_nodes(self) -> int:
        """Number of nodes of the mesh."""
        return self.mesh.n_points

    def with_nodes(self, nodes: np.ndarray) -> MixedMesh:
        """Mesh with other nodes."""
        return replace(self.mesh, points=nodes)

    @property
    def baseline(self) -> MixedMesh:
        """The mesh."""
        return self.mesh

    @cached_property
    def walls(self) -> WallFaces:
        """Faces of the walls."""
        markers = self.mesh.markers or {}
        names = tuple(name for name in markers if self.kinds.get(name) == WALL)
        faces = [self.mesh.into_fluid(markers[name]) for name in names]
        bare = next((name for name, part in zip(names, faces) if len(markers[name]) and not len(part)), None)
        if bare is not None:
            raise InputError(
                f"{self.source}: wall '{bare}' has cells on both sides, which share its nodes; give it another kind, "
                f"or write the mesh with its nodes doubled there (by Gmsh's plugin Crack)"
            )
        return WallFaces(names, np.concatenate(faces), np.repeat(np.arange(len(names)), [len(part) for part in faces]))

    @cached_property
    def wall_rows(self) -> np.ndarray:
        """Wall nodes, ascending: the first control points."""
        return np.unique(self.walls.faces)

    @cached_property
    def rows_at_rest(self) -> np.ndarray:
        """Fixed nodes, ascending: nodes of markers that are neither walls nor in planes."""
        markers = self.mesh.markers or {}
        in_planes = {name for plane in self.planes for name in plane.markers}
        in_planes |= {name for sides in self.periodic for name in sides.markers}
        parts = [
            faces.ravel()
            for name, faces in markers.items()
            if name not in self.walls.names and name not in in_planes and self.kinds.get(name) not in (INNER, SLIDING)
        ]
        resting = np.unique(np.concatenate([np.zeros(0, dtype=int), *parts]))
        return np.setdiff1d(resting, self.wall_rows)

    @cached_property
    def control_points(self) -> np.ndarray:  # type: ignore[override]
        """Wall nodes and control points of the lattice (m), shape (n_control_points, 3)."""
        return np.concatenate([self.mesh.points[self.wall_rows], self.lattice.control_points])

    @cached_property
    def moving_mesh(self) -> MovingMesh:
        """Control points with their constraints."""
        nodes = self.mesh, self.walls, self.wall_rows, self.control_points
        return points_to_move(*nodes, self.lattice, self.planes, self.periodic, self.control_ids, self.spline_names)

    def design_mesh(
        self,
        design: str | Sequence[str] | None = None,  # walls that are the design surface, by name or pattern
        fixed: Selection | Sequence[Selection] = (),
        released: str | Sequence[str] = (),
        sliding: str | Sequence[str] = (),
    ) -> MovingMesh:
        """Control points with some walls as the design surface, see `moving_mesh`; the others stay."""
        for what, asked in (("fixed", fixed), ("released", released), ("sliding", sliding)):
            if len(asked):
                raise InputError(
                    f"{self.source}: '{what}' is of grids of blocks; what the markers of a mesh do is up to their "
                    f"kinds, such as sliding"
                )
        if design is None:
            return self.moving_mesh
        mesh, faces = self.moving_mesh, self._faces_of(matching_names(self.walls.names, design, self.source, MARKERS))
        ids = np.searchsorted(self.wall_rows, np.unique(faces)).astype(np.int32)
        rows = np.full(len(self.wall_rows), -1)
        rows[ids] = np.arange(len(ids))
        kept = rows[mesh.in_plane_rows] >= 0
        copies = rows[mesh.copies]
        is_kept = (copies >= 0).all(axis=1)
        return replace(
            mesh,
            surface_ids=ids,
            in_plane_rows=rows[mesh.in_plane_rows[kept]],
            in_plane_normals=mesh.in_plane_normals[kept],
            surface_faces=rows[np.searchsorted(self.wall_rows, faces)],
            copies=copies[is_kept],
            copy_turns=None if mesh.copy_turns is None else mesh.copy_turns[is_kept],
        )

    def _faces_of(self, names: Collection[str]) -> np.ndarray:
        """Faces of some walls."""
        wanted = [number for number, name in enumerate(self.walls.names) if name in names]
        return self.walls.faces[np.isin(self.walls.marker, wanted)]

    def mover_of(self, mesh: MovingMesh) -> ThinPlate:
        """Mover of the control points with some of the walls, see `design_mesh`."""
        return self.mover if mesh is self.moving_mesh else replace(self.mover, mesh=mesh)

    @cached_property
    def mover(self) -> ThinPlate:
        """Mover of the lattice's control points with the walls."""
        return ThinPlate(self.moving_mesh, self.lattice, self.mesh.points[self.rows_at_rest], self.settings)

    def surface(self, patches: str | Sequence[str] | None = None) -> SurfaceGrid:
        """Wall nodes, or nodes of other markers by name or pattern, see `SurfaceGrid.of`."""
        markers = self.mesh.markers or {}
        wanted = self.walls.names if patches is None else matching_names(markers, patches, self.source, MARKERS)
        names = tuple(name for name in markers if name in wanted)
        faces = [self.mesh.into_fluid(markers[name]) for name in names]
        return surface_of_faces(self.mesh.points, dict(zip(names, faces)), self.planes)

    def surface_map(self, mesh: MovingMesh, surface: SurfaceGrid) -> SurfaceMap:
        """Map from wall nodes to surface nodes: the same nodes, and fixed ones."""
        walls = self.wall_rows[mesh.surface_ids]
        return map_to_surface(self.mesh, walls, np.concatenate([self.wall_rows, self.rows_at_rest]), surface)

    @property
    def length_unit(self) -> str:
        """Unit of its lengths: metres if no other is known."""
        return self.mesh.length_unit

    @property
    def source(self) -> str:
        """Where the mesh comes from."""
        return self.mesh.source

    @property
    def control_ids(self) -> tuple[np.ndarray, ...]:
        """Numbers of the lattice's control points, which follow the wall nodes."""
        ids = np.arange(self.lattice.n_control, dtype=np.int32).reshape(self.lattice.shape)
        return (len(self.wall_rows) + ids,)

    def splines_at(self, control_points: np.ndarray) -> tuple[BSplineMesh, np.ndarray]:
        """The lattice, and its control points among all control points."""
        return self.lattice.mesh, control_points[len(self.wall_rows) :]

    @property
    def spline_names(self) -> tuple[str, ...]:
        """Name of the lattice."""
        return ("the lattice",)

    @property
    def control_lines(self) -> Sequence[np.ndarray]:
        """The lattice, and the edges of the walls."""
        return self.moving_mesh.point_lines

    @property
    def is_linear(self) -> bool:
        """No: nodes next to walls rotate with them."""
        return False

    @property
    def is_linear_at_walls(self) -> bool:
        """Yes: wall nodes are at their prescribed positions."""
        return True

    @property
    def carries_all(self) -> bool:
        """No: nodes of a far field stay."""
        return not len(self.rows_at_rest)

    @property
    def why_no_fit(self) -> str:
        """Say what replaces a fit."""
        return "a lattice needs no fit: the nodes of the walls are the surface control points"

    @property
    def ownership(self) -> Subdomain | None:
        """Nodes of the process; None if it has all of them."""
        return self.subdomain

    def part(self, subdomain: Subdomain) -> MeshModel:
        """Take the part for a process with some nodes: these, and all of the walls and the lattice."""
        if subdomain.n_nodes_of_grid != self.n_nodes:
            raise InputError(
                f"{self.source}: a subdomain of {subdomain.n_nodes_of_grid} nodes, but the mesh has {self.n_nodes}; "
                f"make it of the nodes of this mesh"
            )
        return replace(self, subdomain=subdomain)

    def partition(self, n_ranks: int) -> NodePartition:
        """Distribute its nodes to processes, in the order of the file."""
        return NodePartition(self.n_nodes, n_ranks)

    def has_cells(self, subdomain: Subdomain | None) -> bool:
        """Yes: cells are judged with the nodes of all processes."""
        return True

    def map_meeting(self, rows: np.ndarray, whole: Any, slides: Sequence[Slide] = ()) -> MeshMap:
        """Return the map; control points already match the walls, and no markers slide on surfaces."""
        return self.node_map

    def follower(self, mesh: MovingMesh, surface: SurfaceGrid, numbers: np.ndarray) -> WallFollower:
        """Surface control points from some nodes of a surface."""
        ids = np.full(self.n_nodes, -1)
        ids[self.wall_rows] = np.arange(len(self.wall_rows))
        return WallFollower.of(mesh, ids[surface.rows[numbers]], surface.points[numbers])

    def embed_points(self, points: np.ndarray, tolerance: float | None = None) -> MeshPoints:
        """Embed points that are not nodes, in the lattice, or inside the body in its walls, see `MeshPoints`.

        Up to ``tolerance`` (m), 1e-9 of the mesh's size by default, a point counts as inside the mesh.
        """
        walls, rows = self.mesh.points[self.wall_rows], self.wall_rows
        near = 1e-9 * float(np.linalg.norm(np.ptp(self.mesh.points, axis=0))) if tolerance is None else tolerance
        return MeshPoints.of(self.lattice, Body(walls, np.searchsorted(rows, self.walls.faces)), rows, points, near)

    def nodes_on_planes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Nodes of the end planes of the mesh."""
        return [(plane.rows, plane.normal) for plane in self.planes]

    def judge(self, subdomain: Subdomain | None, comm: Any, **settings: Any) -> CellJudge:
        """Make the judge of the mesh's cells; ``p`` is for p-norms, which cells of mixed kinds do not have."""
        ranks = (0, 1) if subdomain is None else (comm.rank, comm.size)
        part = MixedQuality.of(self.mesh, self.walls.faces, settings["rho"], settings["rho_height"], *ranks)
        return part if subdomain is None else GatheredQuality.of(part, comm, subdomain.rows)

    @cached_property
    def following_walls(self) -> RidingWalls:
        """What follows the walls, independent of the lattice."""
        faces = self.walls if self.sliding_nodes is None else with_sliding(self.mesh, self.walls, self.slides)
        return following_walls(
            self.mesh, faces, self.nodes_on_planes(), self.rows_at_rest, self.nodes_here, self.wall_images
        )

    @cached_property
    def slides(self) -> dict[str, Slide]:
        """Surfaces of the sliding markers by name."""
        return markers_that_slide(self.mesh, self.kinds)

    @cached_property
    def sliding_nodes(self) -> SlidingNodes | None:
        """Nodes that slide on curved surfaces; None if there are none."""
        return nodes_that_slide(self.mesh, self.slides, self.planes, self.rows_at_rest)

    @cached_property
    def wall_images(self) -> WallImages | None:
        """Walls beyond periodic sides; None if there are none nearby."""
        return images_of_walls(self.mesh, self.walls, self.periodic)

    @cached_property
    def nodes_here(self) -> np.ndarray | None:
        """Nodes mapped here, ascending: of this process, of walls and of periodic sides; None if it has all."""
        asked = self.subdomain
        if asked is None:
            return None
        faces = [np.asarray((self.mesh.markers or {})[name]).ravel() for name in self.slides]
        return np.unique(np.concatenate([asked.rows, self.wall_rows, self._periodic_pairs.ravel(), *faces]))

    @property
    def _periodic_pairs(self) -> np.ndarray:
        """Nodes of periodic sides and their copies, shape (n_pairs, 2): nodes on an axis are their own copies."""
        on_axis = np.flatnonzero(self.lattice.frame.is_on_axis(self.mesh.points))
        return np.concatenate([np.stack([on_axis, on_axis], axis=1), *(each.pairs for each in self.periodic)])

    @cached_property
    def node_map(self) -> MeshMap:
        """Map from the control points to the nodes, or to this process's nodes."""
        asked = None if self.subdomain is None else self.subdomain.rows
        nodes = self.mesh, self.planes, self.rows_at_rest, self._periodic_pairs
        return map_of_nodes(
            *nodes,
            self.following_walls,
            self.lattice,
            asked,
            self.nodes_here,
            self.wall_images,
            wall_rows=self.wall_rows,
            nodes=self.sliding_nodes,
        )


moving_mesh.register(MeshModel, MeshModel.design_mesh)
surface_of.register(MeshModel, MeshModel.surface)
surface_map_of.register(MeshModel, MeshModel.surface_map)
default_mover.register(MeshModel, MeshModel.mover_of)
follower_of.register(MeshModel, MeshModel.follower)
