"""Pictures of an unstructured mesh: markers, the lattice, and slices through its cells.

A two-dimensional mesh is drawn thin and seen across its plane, whatever the width of its cells.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from ...core.background.mesh_model import MeshModel
from ...errors import InputError
from ...flow.om.snapshots import Snapshot
from ...grids.cells.mesh_fields import pyramid_ratios, wall_heights
from ...grids.cells.mesh_quality import mesh_quality
from ...grids.cells.mixed_cells import MixedMesh, face_keys
from ...grids.cells.mixed_quality import MixedQuality
from ...grids.io.marker_kinds import marker_kinds
from .field_styles import MESH_STYLES, FieldStyle
from .surfaces import AnySheet, FacetSheet
from .view import View, view_of

__all__ = ["MeshView"]

SLICE = re.compile(r"slice ([xyz]) *= *([-+0-9.eE]+)")
"""Syntax of a slice: its axis, and its coordinate (m)."""

THIN = 0.005
"""Drawn width of a two-dimensional mesh, relative to the size of its walls."""

NEAR_SPANS = 1.5
"""How far around the walls the lattice is drawn, in units of its narrowest spans."""


class MeshView(View):
    """A mesh, and the lattice that moves it."""

    styles = MESH_STYLES
    defaults = ("walls", "symmetry")

    def __init__(self, state: Snapshot):
        super().__init__(state)
        self.mesh: MixedMesh = state.grid
        self.model = state.model if isinstance(state.model, MeshModel) else None

    @cached_property
    def kinds(self) -> Mapping[str, str]:
        """Kinds from the model, or guesses."""
        if self.model is not None:
            return self.model.kinds
        return {name: guess.kind for name, guess in marker_kinds(self.mesh, None).items()}

    @property
    def is_planar(self) -> bool:
        """Whether it is two-dimensional."""
        return self.mesh.n_copies > 1

    @property
    def across(self) -> int | None:
        """Axis normal to its plane, if it is two-dimensional."""
        points = self.mesh.points
        return int(np.argmax(np.abs(points[self.mesh.n_stored] - points[0]))) if self.is_planar else None

    def knows(self, name: str) -> bool:
        """Slices have names."""
        return SLICE.fullmatch(name) is not None

    @cached_property
    def _judge(self) -> MixedQuality:
        """The quality measures of the cells, relative to the baseline."""
        before = self.mesh if self.model is None else self.model.mesh
        faces = [before.into_fluid(part) for name, part in (before.markers or {}).items() if self.kinds[name] == "wall"]
        return MixedQuality.of(before, np.concatenate([np.zeros((0, 4), dtype=int), *faces]))

    @cached_property
    def _points(self) -> np.ndarray:
        """Nodes as they are drawn."""
        points, mesh = self.mesh.points, self.mesh
        if not self.is_planar:
            return points
        across = points[mesh.n_stored] - points[0]
        walls = np.concatenate([part.ravel() for part in self._of_kind("wall")] or [np.arange(mesh.n_points)])
        size = float(np.ptp(points[walls[walls < mesh.n_stored]], axis=0).max())
        thin = points.copy()
        thin[mesh.n_stored :] -= (1.0 - THIN * size / np.linalg.norm(across)) * across
        return thin

    def _of_kind(self, kind: str) -> list[np.ndarray]:
        return [faces for name, faces in (self.mesh.markers or {}).items() if self.kinds[name] == kind]

    def sheets(self, surfaces: Sequence[str], look: FieldStyle | None) -> list[AnySheet]:
        """Markers, the plane of a two-dimensional mesh, slices and the lattice."""
        faces, cells = self.mesh.cell_faces
        parts = []
        for name, marked in (self.mesh.markers or {}).items():
            found = np.flatnonzero(np.isin(self._keys, face_keys(marked, self.mesh.n_points)))
            kind = self.kinds[name] if self.kinds[name] in ("wall", "symmetry", "farfield") else "other"
            parts.append((name, kind, found))
        if self.is_planar:
            parts.append(("plane", "symmetry", np.flatnonzero((faces >= self.mesh.n_stored).all(axis=1))))
        parts += [(name, "slice", self._slice(name)) for name in surfaces if self.knows(name)]
        every: list[AnySheet] = []
        for number, (name, kind, found) in enumerate(parts, start=1):
            used, corners = np.unique(faces[found], return_inverse=True)
            values = {} if look is None else self._values(look, number, faces[found], cells[found])
            every.append(FacetSheet(name, kind, self._points[used], corners.reshape(-1, 4), values))
        if {"control mesh", "lattice"} & {*surfaces}:
            every.append(self._lattice())
        return every

    @cached_property
    def _keys(self) -> np.ndarray:
        return face_keys(self.mesh.cell_faces[0], self.mesh.n_points)

    def _slice(self, name: str) -> np.ndarray:
        """Faces between cells whose centres are on either side of a plane, as oriented from the cells below it."""
        match = SLICE.fullmatch(name)
        assert match is not None  # `knows` has asked
        axis, place = "xyz".index(match[1]), float(match[2])
        faces, cells = self.mesh.cell_faces
        heights = self.mesh.points[:, axis][faces].mean(axis=1)
        middles = np.bincount(cells, heights, self.mesh.n_cells) / np.bincount(cells, minlength=self.mesh.n_cells)
        is_above = (middles > place)[cells]
        below = np.flatnonzero(~is_above)
        found = below[np.isin(self._keys[below], self._keys[is_above])]
        if not len(found):
            raise InputError(f"{self.title}: no cell is at '{name}'; give a place in the mesh")
        return found

    def _values(self, look: FieldStyle, number: int, faces: np.ndarray, cells: np.ndarray) -> dict[str, np.ndarray]:
        """Field of the cells behind faces, or of the faces."""
        if look.field == "patch":
            return {"patch": np.full(len(faces), float(number))}
        if look.field == "angle":
            return {"angle": self._angles[cells]}
        if look.field == "pyramid":
            return {"pyramid": self._pyramids[cells]}
        before = self.mesh.points if self.model is None else self.model.mesh.points
        if look.field == "displacement":
            return {"displacement": np.linalg.norm(self.mesh.points - before, axis=1)[faces].mean(axis=1)}
        return {"wall_height": self._heights[faces].mean(axis=1)}

    @cached_property
    def _angles(self) -> np.ndarray:
        return mesh_quality(self.mesh).cell_angles

    @cached_property
    def _pyramids(self) -> np.ndarray:
        return pyramid_ratios(self._judge, self.mesh.points)

    @cached_property
    def _heights(self) -> np.ndarray:
        return wall_heights(self._judge, self.mesh.points)

    def _lattice(self) -> FacetSheet:
        """Two families of layers of the lattice around the walls, which contain all of its edges."""
        if self.model is None or self.state.control_points is None:
            raise InputError(f"{self.title}: a mesh has no lattice; fit it first: fit_mesh(file).plot('lattice')")
        lattice = self.model.lattice
        walls = lattice.frame.to_local(self.model.mesh.points[self.model.wall_rows])
        near = []
        for axis, line in enumerate(lattice.lines):
            x, beyond = line.control_coordinates, NEAR_SPANS * lattice.spacing
            is_near = (x >= walls[:, axis].min() - beyond) & (x <= walls[:, axis].max() + beyond)
            near.append(np.array([0]) if line.is_tied else np.flatnonzero(is_near))
        ids = np.arange(lattice.n_control).reshape(lattice.shape)[np.ix_(*near)]
        quads = [np.zeros((0, 4), dtype=int)]
        for layers in (ids, np.swapaxes(ids, 0, 1), np.moveaxis(ids, 2, 0)):
            around = layers[:, :-1, :-1], layers[:, 1:, :-1], layers[:, 1:, 1:], layers[:, :-1, 1:]
            quads.append(np.stack(around, axis=-1).reshape(-1, 4))
        points = self.model.splines_at(self.state.control_points)[1]
        used, corners = np.unique(np.concatenate(quads), return_inverse=True)
        return FacetSheet("lattice", "control mesh", points[used], corners.reshape(-1, 4))

    def marks(self, look: FieldStyle | None, most: int) -> np.ndarray:
        """The worst cells, in pictures of their quality."""
        if look is None or look.field not in ("angle", "pyramid") or not most:
            return np.zeros((0, 3))
        values = -self._angles if look.field == "angle" else self._pyramids
        faces, cells = self.mesh.cell_faces
        worst = np.argsort(values, kind="stable")[:most]
        is_of = np.isin(cells, worst)
        middles = self._points[faces[is_of]].mean(axis=1)
        sums = np.stack([np.bincount(cells[is_of], part, self.mesh.n_cells)[worst] for part in middles.T], axis=1)
        return sums / np.bincount(cells[is_of], minlength=self.mesh.n_cells)[worst][:, None]


@view_of.register
def _of_mesh(grid: MixedMesh, state: Snapshot) -> MeshView:
    return MeshView(state)
