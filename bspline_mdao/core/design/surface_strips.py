"""Faces of blocks on the design surface, and the strips of faces that share the knots of one direction.

A knot inserted into a face runs through all faces that it meets across edges: knots belong to *strips*. The knots of a
strip are the mean over all its edges, so faces agree along shared edges even if the knots of the volumes are curved.
Theory: ``docs/theory/progressive.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ...base.display import OneLine
from ...base.numerics.vectors import unit_vectors
from ...errors import InputError
from ...grids.topology.sharing import boundary_sides
from ..mesh.boundary import require_mesh_of
from ..mesh.moving_mesh import MovingMesh
from ..model.fitted_model import FittedModel
from ..splines.knots import ConstantKnots
from ..splines.volume import Volume

__all__ = ["Face", "Strip", "SurfaceStrips", "face_edges", "in_one_direction"]


@dataclass(frozen=True, eq=False)
class Face(OneLine):
    """A face of a block on the design surface."""

    rows: np.ndarray  # int (n0, n1), its control points, rows of ``mesh.surface_ids``
    strips: tuple[int, int]  # strip of each direction
    is_reversed: tuple[bool, bool]  # whether the strip runs against the direction


@dataclass(frozen=True, eq=False)
class Strip(OneLine):
    """Directions of faces that have the same knots."""

    knots: ConstantKnots  # mean of the knots on all edges along the strip
    direction: np.ndarray  # (3,), mean direction of its edges in space, of length one
    # whether the strip returns to one of its own edges reversed: a change of a knot is then applied to its mirror image
    is_symmetric: bool

    @property
    def n_inner(self) -> int:
        """Number of inner knots."""
        return self.knots.n_control - self.knots.order


@dataclass(frozen=True, eq=False)
class SurfaceStrips(OneLine):
    """All faces of the design surface and their strips."""

    faces: tuple[Face, ...]
    strips: tuple[Strip, ...]
    n_surface: int  # number of surface control points

    @classmethod
    def of(cls, model: FittedModel, mesh: MovingMesh) -> SurfaceStrips:
        """Find the faces of a fitted grid on the design surface of its mesh."""
        # 1. Faces that share an edge have the same knots along it, and so do opposite edges of a face.
        # 2. Each direction of a face is a node, once forward and once reversed; shared edges join nodes.
        # 3. A connected component is a strip.
        require_mesh_of(model, mesh, "a coarse net: the mesh")
        found = []
        for face, number, side in boundary_sides(model.topology):
            rows = mesh.surface_rows[np.take(model.mesh.control_ids[number], -(side % 2), axis=side // 2)]
            if face.patch is not None and (rows >= 0).all():
                found.append((rows, *_face_knots(model.mesh.volumes[number], side)))
        labels = _labels([rows for rows, *_ in found])  # steps 1 and 2
        first = labels.min(axis=-1)
        _, numbers = np.unique(first, return_inverse=True)
        numbers = numbers.reshape(first.shape)  # step 3
        is_reversed, is_symmetric = labels[..., 0] != first, labels[..., 0] == labels[..., 1]
        faces = tuple(
            Face(rows, (int(n[0]), int(n[1])), (bool(r[0]), bool(r[1])))
            for (rows, *_), n, r in zip(found, numbers, is_reversed)
        )
        points, strips = mesh.points[mesh.surface_ids], []
        for strip in range(numbers.max() + 1):
            members = list(zip(*np.nonzero(numbers == strip)))
            knots = [in_one_direction(found[f][1 + d], is_reversed[f, d]) for f, d in members]
            if len({(k.order, k.n_control) for k in knots}) > 1:
                raise InputError(
                    f"{model.header.source}: a coarse net: faces that share an edge have other orders or other numbers "
                    f"of control points along it; fit the grid with the same for all"
                )
            mean = np.mean([k.knots for k in knots], axis=0)
            if is_symmetric[members[0]]:
                mean = 0.5 * (mean + 1.0 - mean[::-1])
            chords = [_chord(points[found[f][0]], d) * (-1.0 if is_reversed[f, d] else 1.0) for f, d in members]
            direction = unit_vectors(np.sum(chords, axis=0), np.zeros(3), 0.0)
            strips.append(Strip(ConstantKnots(mean, knots[0].order), direction, bool(is_symmetric[members[0]])))
        return cls(faces, tuple(strips), len(mesh.surface_ids))


def in_one_direction(knots: ConstantKnots, is_reversed: bool) -> ConstantKnots:
    """Return knots, or the knots in reverse direction."""
    return ConstantKnots(1.0 - knots.knots[::-1], knots.order) if is_reversed else knots


def face_edges(rows: np.ndarray) -> tuple[tuple[int, np.ndarray, tuple], ...]:
    """Return the four edges of a face: the direction of each, its rows, and their location in the face."""
    whole = slice(None)
    return tuple(
        (direction, rows[where], where)
        for direction, where in ((0, (whole, 0)), (0, (whole, -1)), (1, (0, whole)), (1, (-1, whole)))
    )


def _face_knots(volume: Volume, side: int) -> tuple[ConstantKnots, ConstantKnots]:
    """Mean knots of the two edges along each direction of a side of a volume."""
    across, end = side // 2, float(side % 2)
    along = [d for d in range(3) if d != across]
    found = []
    for d in along:
        other = next(o for o in along if o != d)
        places = {across: np.full(2, end), other: np.array([0.0, 1.0])}
        knots = volume.knots[d]
        values = knots.values(places[(d + 1) % 3], places[(d + 2) % 3])
        found.append(ConstantKnots(values.mean(axis=0), knots.order))
    return found[0], found[1]


def _labels(faces: list[np.ndarray]) -> np.ndarray:
    """Label every direction of every face, forward and reversed, by its connected component: (n_faces, 2, 2)."""
    seen: dict[tuple, tuple[int, bool]] = {}
    pairs = []
    for number, rows in enumerate(faces):
        for direction, edge, _ in face_edges(rows):
            if (edge == edge[0]).all():  # a collapsed edge has no knots
                continue
            ahead, back = tuple(edge.tolist()), tuple(edge[::-1].tolist())
            key, turned, node = min(ahead, back), back < ahead, 2 * (2 * number + direction)
            if ahead == back:
                pairs.append((node, node + 1))
            other, is_other_turned = seen.setdefault(key, (node, turned))
            flip = int(turned != is_other_turned)
            pairs += [(node, other + flip), (node + 1, other + 1 - flip)]
    n = 4 * len(faces)
    a, b = np.array(pairs).reshape(-1, 2).T
    return connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)[1].reshape(-1, 2, 2)


def _chord(net: np.ndarray, direction: int) -> np.ndarray:
    """Mean vector from one end of a net to the other along one of its directions."""
    return (np.take(net, -1, axis=direction) - np.take(net, 0, axis=direction)).mean(axis=0)
