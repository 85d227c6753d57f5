"""Vectors at the nodes of a grid that turn with their neighbourhood, such as the residual of a fit: ``T(b) r``.

A vector that stays constant while the grid turns about it shears the cells there, and after a rigid motion it points
the wrong way. So it is multiplied by a rotation: `LocalRotations` of the corners of the spans, which are points of the
mapping itself, interpolated trilinearly within every span. The weights are positive and sum to one, so a rigid motion
of the control points turns every vector by its own rotation, to round-off. Where vectors are long compared with the
spans, the rotations are smoothed over their length first (`.rotation_filter`): otherwise they would fold cells there.

- Corners on walls see only the wall, so vectors on it depend only on the control points of the surface. Corners on
  other boundary faces see only these, so nothing turns where they are fixed. Corners in planes of symmetry, and in
  planes that walls end on and that slide in the same way, see the plane. All others see their neighbours. Smoothing
  joins corners of one kind. It takes the rotations of walls as given in planes, and the rotations of all faces as given
  inside.
- On planar boundary faces that are not walls, the part of a vector along the normal follows the face's mean normal, and
  the rest stays in the plane: nodes do not leave a plane if its control points do not. Where corners see only the plane
  this holds anyway. Where they also see a wall or another face, the part along the normal is replaced.

Rotations are exact functions of the control points; the places of nodes and corners in their spans are fixed.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.sparse import coo_array, csr_array, eye_array

from ...base.numerics.threads import run_tasks, thread_count
from ...errors import InputError
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.node_numbering import NodeNumbering, each_once
from ...grids.topology.periodic_ties import Ties, control_ties
from ..evaluation.evaluator import Evaluator
from ..splines.mesh import BSplineMesh
from .boundary_faces import BoundaryFace, boundary_faces
from .node_vectors import FaceNodes, SpanNodes, Vectors, transposed
from .planes import PlaneNormal
from .residual_lengths import corner_numbers
from .rotation_filter import RotationFilter
from .rotations import LocalRotations, Rotations

__all__ = ["RotationMap", "RotationState"]

ROTATION_INPUTS = ("control_points", "control_points_initial")
"""Inputs of the rotations."""


@dataclass(frozen=True, eq=False)
class RotationMap:
    """The map from control points to the rotations of vectors at the nodes. Made by `RotationMap.of`."""

    corners: Evaluator  # from control points to the corners of all spans, shared ones once
    points: np.ndarray  # (n_corners, 3), the corners on the baseline (m)
    groups: tuple[CornerGroup, ...]  # corners that see each other
    planes: tuple[PlaneNormal, ...]  # planes of boundary faces
    faces: tuple[BoundaryFace, ...]  # the boundary faces in them
    plane_of_corner: np.ndarray  # (n_corners,) of int, the plane that is all a corner sees; -1 for none
    cells: tuple[SpanNodes, ...]  # the nodes of every volume
    evaluator: Evaluator  # of the nodes; it defines the pieces of work and the number of threads
    flat: FaceNodes  # the nodes in planes
    flat_copies: np.ndarray  # (n_copies, 2) of int, rows that are copies of these, and the rows that they copy

    @classmethod
    def of(
        cls,
        numbering: NodeNumbering,  # the nodes; their topology has segments, links, and the kinds of boundary faces
        mesh: BSplineMesh,  # one volume per segment
        # each (n_v, 3), parameters of the nodes that each segment evaluates
        parameters: Sequence[np.ndarray],
        control_points: np.ndarray,  # (n_control_points, 3), control points of the baseline (m)
        # (n_corners,), largest vector around every corner (m), by `.residual_lengths.residual_lengths`
        lengths: np.ndarray,
        evaluator: Evaluator,  # evaluation of the nodes, by `Evaluator.of_nodes`
    ) -> RotationMap:
        """Find the corners, groups and planes that the vectors of nodes turn with."""
        places, ids = corner_numbers(numbering.topology, mesh)
        corners = _corner_evaluator(mesh, places, ids, evaluator.n_threads)
        points = corners.forward(control_points)
        if lengths.shape != (len(points),):
            raise InputError(
                f"grid: lengths of the residual of shape {lengths.shape}, and its spans have {len(points)} corners; "
                f"fit the grid again"
            )
        faces = boundary_faces(numbering, ids, points)
        groups, plane = _groups(faces, ids, points, lengths, control_ties(numbering.topology, ids))
        planes = [face for face in faces if face.plane is not None]
        quads = [
            np.concatenate([f.quads for f in planes if f.plane == k]) for k in range(len({f.plane for f in planes}))
        ]
        cells = _cells(mesh, ids, evaluator, parameters, numbering)
        rows = each_once(np.concatenate([np.zeros(0, dtype=int), *(face.rows for face in planes)]))
        flat = _face_nodes(rows, cells, planes, plane, evaluator.n_rows)
        flat = flat.part(np.flatnonzero((flat.planes >= 0).any(axis=1)))
        copies = numbering.copies[np.isin(numbering.copies[:, 1], flat.rows)]
        normals = tuple(map(PlaneNormal.of_quads, quads))
        return cls(corners, points, groups, normals, tuple(planes), plane, cells, evaluator, flat, copies)

    @property
    def n_bytes(self) -> int:
        """Memory in addition to the evaluator's (B)."""
        arrays = [array for cell in self.cells for array in (cell.corners, cell.fractions)]
        arrays += [self.flat.rows, self.flat.corners, self.flat.weights]
        return sum(array.nbytes for array in arrays) + int(self.corners.bytes_per_node * self.corners.n_rows)

    def vectors(self, vectors: np.ndarray) -> Vectors:
        """Sort vectors of all nodes, shape (n_nodes, 3), for turning."""
        inner = vectors.copy()
        inner[self.flat.rows] = 0.0
        return Vectors(tuple(cell.pack(inner) for cell in self.cells), vectors[self.flat.rows])

    def at(self, control_points: np.ndarray, initial: np.ndarray | None = None) -> RotationState:
        """Rotations at control points, shape (n_control_points, 3), from initial ones, by default the baseline's."""
        moved = self.corners.forward(control_points)
        initial = self.points if initial is None else self.corners.forward(initial)
        matrices = np.tile(np.eye(3).ravel(), (self.corners.n_rows, 1))
        rotations, normals = [], np.empty((2, len(self.planes), 3))
        for group in self.groups:
            rotations.append(group.at(initial, moved, matrices))
        for k, plane in enumerate(self.planes):
            normals[:, k] = plane.normal(moved), plane.normal(initial)
        return RotationState(self, initial, moved, tuple(rotations), matrices, normals)

    def of_rows(self, rows: FaceNodes) -> RotationMap:
        """The part of the map that the rotations of these nodes need."""
        needed, _ = self._dependencies(rows)
        return replace(self, groups=tuple(g for g in self.groups if needed[g.ids[g.belongs]].any()))

    def seen_by(self, rows: FaceNodes) -> np.ndarray:
        """Corners that the rotations of these nodes depend on."""
        return self._dependencies(rows)[1]

    def _dependencies(self, rows: FaceNodes) -> tuple[np.ndarray, np.ndarray]:
        """Corners whose rotations these nodes need, as a mask, and the corners that these see."""
        needed = np.zeros(len(self.points), dtype=bool)
        needed[rows.corners[rows.weights > 0.0]] = True
        seen = [group.add_dependencies(needed) for group in reversed(self.groups)]
        return needed, np.unique(np.concatenate(seen))

    def rows(self, rows: np.ndarray) -> FaceNodes:
        """Weights and planes of nodes on boundary faces by their rows, ascending and evaluated."""
        return _face_nodes(rows, self.cells, self.faces, self.plane_of_corner, self.evaluator.n_rows)


@dataclass(frozen=True, eq=False)
class RotationState:
    """Rotations at one set of control points."""

    of: RotationMap  # the map
    # initial, moved: (n_corners, 3), corners of the spans initially and now (m)
    initial: np.ndarray
    moved: np.ndarray
    rotations: tuple[Rotations, ...]  # of every group
    matrices: np.ndarray  # (n_corners, 9), rotation of every corner
    normals: np.ndarray  # (2, n_planes, 3), normals of all planes, now and initially

    def evaluate(self, control_points: np.ndarray, vectors: Vectors) -> np.ndarray:
        """Nodes ``A b + T v``, shape (n_nodes, 3)."""
        flat = self.of.flat
        return self._forward(
            control_points, self.matrices, vectors, flat.turned(self.matrices, self.normals, vectors.flat)
        )

    def change(self, d_control_points: np.ndarray, d_initial: np.ndarray | None = None) -> RotationState.Change:
        """Differentiate the rotations along a direction in the control points, and in the initial ones."""
        d_moved = self.of.corners.forward(d_control_points)
        d_first = None if d_initial is None else self.of.corners.forward(d_initial)
        d_matrices = np.zeros_like(self.matrices)
        for group, rotations in zip(self.of.groups, self.rotations):
            group.jvp(rotations, d_first, d_moved, d_matrices)
        d_normals = np.zeros_like(self.normals)
        for k, faces in enumerate(self.of.planes):
            d_normals[0, k] = faces.normal_jvp(self.moved, d_moved)
            d_normals[1, k] = 0.0 if d_first is None else faces.normal_jvp(self.initial, d_first)
        return RotationState.Change(d_matrices, d_normals)

    @dataclass(frozen=True, eq=False)
    class Change:
        """Changes of the rotations of all corners, and of the normals of all planes, now and initially."""

        matrices: np.ndarray
        normals: np.ndarray

    def jvp(
        self,
        d_control_points: np.ndarray,
        change: RotationState.Change,
        vectors: Vectors,
        d_vectors: Vectors | None = None,
    ) -> np.ndarray:
        """Change of `evaluate`, shape (n_nodes, 3), with changes of the rotations, see `change`, and vectors."""
        d_flat = None if d_vectors is None else d_vectors.flat
        flat = self.of.flat.jvp(self.matrices, self.normals, vectors.flat, change.matrices, change.normals, d_flat)
        out = self._forward(d_control_points, change.matrices, vectors, flat)
        if d_vectors is not None:
            out += self._forward(np.zeros_like(d_control_points), self.matrices, d_vectors, np.zeros_like(flat))
        return out

    def vjp(
        self,
        vectors: Vectors,  # the vectors
        # (n_nodes, 3), derivative of a scalar with respect to the nodes, zero in copies if derivatives with respect to
        # vectors are requested
        bar: np.ndarray,
        # which derivatives: ``points``, the control points of A b; ``control_points`` and ``control_points_initial``,
        # the control points that T turns with, now and initially, all of shape (n_control_points, 3); and ``vectors``,
        # shape (n_nodes, 3), ignoring copies
        wrt: Collection[str],
    ) -> dict[str, np.ndarray]:
        """Transpose of `jvp` with `change`, in what nodes ``A b + T v`` depend on."""
        points_bar, flat_bar, change = self._bars(vectors, bar)
        bars = {"points": points_bar} | self.change_vjp(change, [name for name in wrt if name in ROTATION_INPUTS])
        if "vectors" in wrt:
            packed, none = self.of.vectors(bar), np.zeros((len(self.of.flat.rows), 3))
            bars["vectors"] = self._forward(np.zeros_like(points_bar), transposed(self.matrices), packed, none)
            bars["vectors"][self.of.flat.rows] = flat_bar
        return {name: bars[name] for name in wrt}

    def change_vjp(self, bar: RotationState.Change, wrt: Collection[str] = ROTATION_INPUTS) -> dict[str, np.ndarray]:
        """Transpose of `change`, by the names of `vjp`; the bar of the matrices is overwritten."""
        moved_bar, initial_bar = np.zeros_like(self.moved), np.zeros_like(self.initial)
        is_live = "control_points_initial" in wrt
        names = ("initial", "moved") if is_live else ("moved",)
        for group, rotations in zip(reversed(self.of.groups), reversed(self.rotations)):
            bars = rotations.vjp(group.pull(bar.matrices), names)  # smoothed towards the groups before it
            moved_bar[group.ids] += bars["moved"]
            if is_live:
                initial_bar[group.ids] += bars["initial"]
        for faces, now, first in zip(self.of.planes, *bar.normals):
            faces.add_normal_vjp(self.moved, now, moved_bar)
            if is_live:
                faces.add_normal_vjp(self.initial, first, initial_bar)
        parts = {"control_points": moved_bar, "control_points_initial": initial_bar}
        return {name: self.of.corners.adjoint(parts[name]) for name in wrt}

    def _forward(
        self, control_points: np.ndarray, matrices: np.ndarray, vectors: Vectors, flat: np.ndarray
    ) -> np.ndarray:
        """Evaluate and turn all nodes; vectors of nodes in planes are already turned."""
        cells = self.of.cells
        turned = [(cell.fractions, packed, cell.corners, matrices) for cell, packed in zip(cells, vectors.packed)]
        out = self.of.evaluator.forward(control_points, turned=turned)
        _add_rows(self.of.flat.rows, flat, self.of.flat_copies, out)
        return out

    def _bars(self, vectors: Vectors, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, RotationState.Change]:
        """Derivatives with respect to the control points of A b, vectors in planes, and rotations."""
        of = self.of
        turns = [np.empty((len(cell.corners), 8, 9)) for cell in of.cells]
        turned = [(cell.fractions, packed, part) for cell, packed, part in zip(of.cells, vectors.packed, turns)]
        points_bar, matrices_bar = of.evaluator.adjoint(bar, turned=turned), np.zeros_like(self.matrices)
        for cell, part in zip(of.cells, turns):
            _gather(cell.corners, part, matrices_bar)
        flat_bar = bar[of.flat.rows]
        np.add.at(flat_bar, np.searchsorted(of.flat.rows, of.flat_copies[:, 1]), bar[of.flat_copies[:, 0]])
        normals_bar, flat_bar = of.flat.vjp(self.matrices, self.normals, vectors.flat, flat_bar, matrices_bar)
        return points_bar, flat_bar, RotationState.Change(matrices_bar, normals_bar)


@dataclass(frozen=True, eq=False)
class CornerGroup:
    """Corners that see each other: their numbers, and which take their rotation from here, smoothed or not."""

    ids: np.ndarray
    belongs: np.ndarray
    rotations: LocalRotations
    in_sight: csr_array
    filter: RotationFilter | None

    @classmethod
    def of(
        cls,
        points: np.ndarray,
        lengths: np.ndarray,
        ids: np.ndarray,
        belongs: np.ndarray,
        is_apart: bool,
        ties: Ties | None = None,
        edges: np.ndarray | None = None,
        quads: np.ndarray | None = None,
    ) -> CornerGroup:
        """Gather a group; a separate one is not smoothed towards the corners of others."""
        place = np.full(len(points), -1)
        place[ids] = np.arange(len(ids))
        edges, quads = (None if numbers is None else place[numbers] for numbers in (edges, quads))
        ties = None if ties is None else ties.numbered(place)
        rotations = LocalRotations.of(points[ids], edges, quads, fixed=np.flatnonzero(~belongs), ties=ties)
        pairs = [eye_array(len(ids), format="coo").coords]
        pairs += [] if edges is None else [edges.T]
        pairs += [] if quads is None else [quads[:, [m, n]].T for m in range(4) for n in range(m)]
        first, second = np.concatenate(pairs, axis=1)
        in_sight = coo_array((np.ones(len(first)), (first, second)), shape=(len(ids), len(ids))).tocsr()
        in_sight = csr_array(in_sight + in_sight.T)
        if ties is not None:  # from what its copies see
            groups = np.arange(len(ids))
            groups[ties.copies] = ties.originals
            alike = coo_array((np.ones(len(ids)), (np.arange(len(ids)), groups)), shape=in_sight.shape).tocsr()
            in_sight = csr_array(alike @ (alike.T @ in_sight @ alike) @ alike.T)
        scales = rotations.scales * belongs[rotations.neighbours] if is_apart else rotations.scales
        smoothing = RotationFilter.of(rotations.starts, rotations.neighbours, scales, lengths[ids], belongs)
        in_sight = in_sight if rotations.mix is None else csr_array(in_sight @ in_sight)
        return cls(ids, belongs, rotations, in_sight, smoothing)

    def at(self, initial: np.ndarray, moved: np.ndarray, matrices: np.ndarray) -> Rotations:
        """Write the rotations of a move; exactly the identity where no visible point has moved."""
        rotations = self.rotations.at(initial[self.ids], moved[self.ids])
        is_still = self.in_sight @ (initial != moved).any(axis=1)[self.ids].astype(float) == 0.0
        belongs = np.where(is_still[:, None, None], np.eye(3), rotations.matrices)[self.belongs]
        matrices[self.ids[self.belongs]] = belongs.reshape(-1, 9)
        self._smooth(matrices, np.eye(3).ravel())
        return rotations

    def jvp(
        self, rotations: Rotations, d_initial: np.ndarray | None, d_moved: np.ndarray, d_matrices: np.ndarray
    ) -> None:
        """Write the change of the rotations with changes of all corners, initial (or None) and current."""
        ids = self.ids
        change = rotations.jvp(None if d_initial is None else d_initial[ids], d_moved[ids])
        d_matrices[ids[self.belongs]] = change[self.belongs].reshape(-1, 9)
        self._smooth(d_matrices, np.zeros(9))

    def _smooth(self, matrices: np.ndarray, rest: np.ndarray) -> None:
        """Smooth rotations, or changes of them, in place; rotations at rest stay exactly."""
        if self.filter is not None:
            free, given = self.ids[self.filter.free], self.ids[self.filter.given]
            matrices[free] = rest + self.filter.forward(matrices[free] - rest, matrices[given] - rest)

    def pull(
        self,
        # (n_corners, 9), groups come in reverse order; the derivatives that smoothing passes to corners of earlier
        # groups are added
        bar: np.ndarray,
    ) -> np.ndarray:
        """Derivatives with respect to the group's rotations before smoothing, from those with respect to all."""
        if self.filter is not None:
            free, given = self.ids[self.filter.free], self.ids[self.filter.given]
            bar[free], given_bar = self.filter.transpose(bar[free])
            bar[given] += given_bar
        return np.where(self.belongs[:, None], bar[self.ids], 0.0).reshape(-1, 3, 3)

    def add_dependencies(self, needed: np.ndarray) -> np.ndarray:
        """Add to a mask of corners the ones joined to them by smoothing; return the corners that all these see."""
        wanted = self.belongs & needed[self.ids]
        if self.filter is not None and wanted.any():
            free, given = self.filter.joined(wanted)
            wanted[free] = True
            needed[self.ids[given]] = True
        return self.ids[self.in_sight[np.flatnonzero(wanted)].indices]


def _corner_evaluator(
    mesh: BSplineMesh, places: Sequence[np.ndarray], ids: Sequence[np.ndarray], n_threads: int | None
) -> Evaluator:
    """Evaluation of the corners of all spans, each in the first volume that has it."""
    layout = BlockLayout.of(map(np.shape, ids))
    flat = layout.join(ids)
    numbers, first = np.unique(flat, return_index=True)
    is_first = np.zeros(len(flat), dtype=bool)
    is_first[first] = True
    belongs = layout.split(is_first)
    parameters = [x[mask] for x, mask in zip(places, belongs)]
    rows = [part[mask] for part, mask in zip(ids, belongs)]
    return Evaluator.build(mesh, parameters, rows, len(numbers), n_threads=n_threads)


def _face_nodes(
    rows: np.ndarray,
    cells: Sequence[SpanNodes],
    faces: Sequence[BoundaryFace],
    plane_of_corner: np.ndarray,
    n_rows: int,
) -> FaceNodes:
    """Weights and planes of nodes by their rows; ``faces`` are the faces in planes."""
    places, found, place = [], [], np.full(n_rows, -1)
    place[rows] = np.arange(len(rows))
    for cell in cells:
        belongs = place[cell.nodes.rows[: cell.nodes.n_nodes]]
        nodes = np.flatnonzero(belongs >= 0)
        places.append(belongs[nodes])
        found.append(cell.weights(nodes))
    order = np.argsort(np.concatenate(places))
    corners, weights = (np.concatenate(parts)[order] for parts in zip(*found))
    planes, count = np.full((len(rows), 3), -1), np.zeros(len(rows), dtype=int)
    for k in sorted({face.plane for face in faces if face.plane is not None}):
        of_plane, is_in = (
            place[np.concatenate([face.rows for face in faces if face.plane == k])],
            np.zeros(len(rows), bool),
        )
        is_in[of_plane[of_plane >= 0]] = True
        sees_more = ((plane_of_corner[corners] != k) & (weights > 0.0)).any(axis=1)
        at = np.flatnonzero(is_in & sees_more & (count < 3))
        planes[at, count[at]] = k
        count[at] += 1
    return FaceNodes(rows, corners, weights, planes)


def _groups(
    faces: list[BoundaryFace], ids: Sequence[np.ndarray], points: np.ndarray, lengths: np.ndarray, ties: Ties | None
) -> tuple[tuple[CornerGroup, ...], np.ndarray]:
    """Corners on walls, on other boundary faces, in sliding planes, and all; and the only plane that each sees."""
    pairs = [
        np.stack([n.take(range(n.shape[d] - 1), d), n.take(range(1, n.shape[d]), d)]) for n in ids for d in range(3)
    ]
    edges = np.concatenate([ends.reshape(2, -1).T for ends in pairs])
    rank, plane, groups = np.full(len(points), 3), np.full(len(points), -2), []
    for face in faces:
        rank[face.quads] = np.minimum(rank[face.quads], face.rank)
    for face in faces:
        belongs = np.unique(face.quads[rank[face.quads] == face.rank])
        number = -1 if face.plane is None else face.plane
        plane[belongs] = np.where(plane[belongs] == -2, number, np.where(plane[belongs] == number, number, -1))
    for k in range(3):
        quads = [face.quads for face in faces if face.rank == k]
        if quads:
            members, corners = np.unique(np.concatenate(quads)), np.concatenate(quads)
            group = CornerGroup.of(points, lengths, members, rank[members] == k, k < 2, ties, quads=corners)
            if group.filter is not None:  # smoothed corners also see corners of other planes and walls
                plane[members[group.filter.free]] = -1
            groups.append(group)
    groups.append(CornerGroup.of(points, lengths, np.arange(len(points)), rank == 3, False, ties, edges=edges))
    return tuple(groups), plane


def _cells(
    mesh: BSplineMesh,
    ids: Sequence[np.ndarray],
    evaluator: Evaluator,
    parameters: Sequence[np.ndarray],
    numbering: NodeNumbering,
) -> tuple[SpanNodes, ...]:
    """Place the nodes of all volumes in their spans."""
    place = np.empty(evaluator.n_rows, dtype=np.int64)
    for numbers in numbering.numbers:
        place[numbers] = np.arange(len(numbers))

    def cell(given: tuple) -> SpanNodes:
        volume, corners, nodes, x = given
        return SpanNodes.of(volume, corners, nodes, x[place[nodes.rows[: nodes.n_nodes]]])

    volumes = list(zip(mesh.volumes, ids, evaluator.nodes, parameters))
    return tuple(run_tasks(cell, volumes, thread_count(evaluator.n_threads)))


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(corners, sums, out):
    """Add the sums of the spans, shape (n_spans, 8, 9), to their corners."""
    for run in range(corners.shape[0]):
        for column in range(8):
            for e in range(9):
                out[corners[run, column], e] += sums[run, column, e]


@njit(cache=True, nogil=True, error_model="numpy")
def _add_rows(rows, vectors, copies, out):
    """Add vectors to rows, and copy some rows to others."""
    for n in range(rows.size):
        for d in range(3):
            out[rows[n], d] += vectors[n, d]
    for n in range(copies.shape[0]):
        for d in range(3):
            out[copies[n, 0], d] = out[copies[n, 1], d]
