"""Seams of a surface: edges at which two sides of volumes meet, with the derivatives of both there.

On either side the derivative into the side and the derivative along the seam are linear in the control points on the
seam and in the next line. With curved knots the knots along the seam vary into the side, which adds a term of the
points on the seam. Theory: ``docs/theory/linear_constraints.rst``.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...base.display import OneLine
from ..splines.basis import basis_gradients
from ..splines.knots import ConstantKnots, Knots
from ..splines.side import VolumeSide
from ..splines.volume import Volume
from .frame import mesh_planes
from .moving_mesh import MovingMesh

__all__ = [
    "Pole",
    "Seam",
    "SideEdge",
    "find_mirror_seams",
    "find_poles",
    "find_seams",
    "mirror_seams_of_mesh",
    "poles_of_mesh",
    "seams_of_mesh",
]

IN_PLANE = 1e-6
"""Distance from a plane of symmetry, relative to the mesh, up to which a point that stays in a plane is in it."""


@dataclass(frozen=True, eq=False)
class SideEdge(OneLine):
    """An edge of a side."""

    side: VolumeSide  # the side
    ids: np.ndarray  # (N_u, N_v) of int, numbers of its control points
    # axis, end: the edge is where u (axis 0) or v (axis 1) is 0 or 1
    axis: int
    end: int
    is_reversed: bool  # whether the seam runs against the other parameter
    number: int  # number of the side, for the caller

    def line(self, inside: int) -> np.ndarray:
        """Numbers of the control points of a line, 0 on the seam and 1 next to it, along the seam."""
        lines = self.ids if self.axis == 0 else self.ids.T
        line = lines[-1 - inside if self.end else inside]
        return line[::-1] if self.is_reversed else line

    @property
    def inward(self) -> float:
        """Sign of the derivative in the parameter that leads into the side."""
        return -1.0 if self.end else 1.0

    @property
    def along(self) -> float:
        """Sign of the derivative along the seam."""
        return -1.0 if self.is_reversed else 1.0

    def uv(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters u and v of places t, 0 to 1, along the seam."""
        on_edge = 1.0 - t if self.is_reversed else t
        fixed = np.full(len(t), float(self.end))
        return (fixed, on_edge) if self.axis == 0 else (on_edge, fixed)

    def greville(self) -> np.ndarray:
        """Places along the seam that belong to its control points, ascending."""
        knots = self.side.edge_knots(1 - self.axis, self.end)
        sums, order = np.cumsum(knots.knots), knots.order
        on_edge = ((sums[order - 1 : -1] - sums[:-order]) / (order - 1)).clip(0.0, 1.0)
        on_edge[[0, -1]] = 0.0, 1.0
        return 1.0 - on_edge[::-1] if self.is_reversed else on_edge

    def weights(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Weights of control points in derivatives at places along the seam."""
        # Returns inner: (n, N), of the next line in the derivative into the side; own: (n, N), of the line on the seam
        # in the same; tangent: (n, N), of the line on the seam in the derivative along it.
        into, along = self.side.axes[self.axis], self.side.axes[1 - self.axis]
        at = self.side.parameters(*self.uv(t))
        values = _dense(self.side.volume.knots[along], along, at)
        across = _dense(self.side.volume.knots[into], into, at)[..., 1 + into]
        first, second = (-1, -2) if self.end else (0, 1)
        inner = self.inward * across[:, second, None] * values[..., 0]
        on_edge = self.inward * (across[:, first, None] * values[..., 0] + values[..., 1 + into])
        tangent = self.along * values[..., 1 + along]
        return (inner[:, ::-1], on_edge[:, ::-1], tangent[:, ::-1]) if self.is_reversed else (inner, on_edge, tangent)


def _dense(knots: Knots, direction: int, parameters: np.ndarray) -> np.ndarray:
    """All basis functions of a direction and their derivatives in three parameters, shape (n, N, 4)."""
    spans, values = basis_gradients(knots, direction, parameters)
    found = np.zeros((len(parameters), knots.n_control, 4))
    found[np.arange(len(parameters))[:, None], spans[:, None] + np.arange(1 - knots.order, 1)] = values
    return found


@dataclass(frozen=True, eq=False)
class Seam(OneLine):
    """Two coincident edges of sides."""

    # first, second: the edge as an edge of either side; both run the same way
    first: SideEdge
    second: SideEdge
    # (3,), unit normal of the plane of symmetry that contains the edge, if the second side is the mirror image of the
    # first
    mirror: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Pole(OneLine):
    """A point to which edges of sides have collapsed."""

    at: int  # number of its control point
    ring: np.ndarray  # (n,) of int, numbers of the control points next to it, of all sides
    edges: tuple[SideEdge, ...]  # the collapsed edges


def find_seams(
    # sides, and the numbers of their control points, int (N_u, N_v)
    sides: Iterable[tuple[VolumeSide, np.ndarray]],
) -> list[Seam]:  # seams that have not collapsed to a point
    """Find the edges that two sides share, by the numbers of their control points."""
    pairs = (edges for edges in _shared_edges(sides) if len(edges) == 2)
    return [Seam(first, second) for first, second in pairs]


def find_mirror_seams(
    sides: Iterable[tuple[VolumeSide, np.ndarray]],  # as for `find_seams`
    # unit normal and offset (m) of each plane, and the control points in it, of int
    planes: Iterable[tuple[np.ndarray, float, np.ndarray]],
) -> list[Seam]:
    """Find the edges of sides that lie in planes of symmetry, each with the mirror image of its side."""
    planes, found = list(planes), []
    for edges in _shared_edges(sides):
        if len(edges) == 1:
            line = edges[0].line(0)
            of_edge = ((normal, offset) for normal, offset, ids in planes if np.isin(line, ids).all())
            for normal, offset in itertools.islice(of_edge, 1):
                found.append(Seam(edges[0], _mirrored(edges[0], normal, offset), normal))
    return found


def _mirrored(edge: SideEdge, normal: np.ndarray, offset: float) -> SideEdge:
    """Mirror image of an edge and its side, with u and v exchanged: u x v stays on the same side."""
    side = edge.side
    net = side.net - 2.0 * (side.net @ normal - offset)[..., None] * normal
    image = replace(side, net=net, axes=side.axes[::-1])
    return replace(edge, side=image, ids=edge.ids.T, axis=1 - edge.axis)


def _shared_edges(sides: Iterable[tuple[VolumeSide, np.ndarray]]) -> Iterable[list[SideEdge]]:
    """Edges of sides that have not collapsed to a point, grouped by their control points."""
    found: dict[tuple, list[SideEdge]] = defaultdict(list)
    for edge in _edges(sides):
        line = edge.line(0).tolist()
        if len(set(line)) > 1:
            found[tuple(line)].append(edge)
    return found.values()


def find_poles(
    sides: Iterable[tuple[VolumeSide, np.ndarray]],  # as for `find_seams`
) -> list[Pole]:
    """Find the points to which edges of sides have collapsed."""
    found: dict[int, list[SideEdge]] = defaultdict(list)
    for edge in _edges(sides):
        line = edge.line(0)
        if (line == line[0]).all():
            found[int(line[0])].append(edge)
    return [
        Pole(at, np.unique(np.concatenate([e.line(1) for e in edges])), tuple(edges)) for at, edges in found.items()
    ]


def _edges(sides: Iterable[tuple[VolumeSide, np.ndarray]]) -> Iterator[SideEdge]:
    """All edges of sides; coincident ones run the same way."""
    for number, (side, ids) in enumerate(sides):
        for axis in (0, 1):
            for end in (0, 1):
                line = (ids if axis == 0 else ids.T)[-end].tolist()
                yield SideEdge(side, ids, axis, end, line > line[::-1], number)


def poles_of_mesh(mesh: MovingMesh) -> list[Pole]:
    """Find the poles of the design surface of a mesh; points are numbered by rows of ``mesh.surface_ids``."""
    return find_poles(_sides(mesh))


def seams_of_mesh(mesh: MovingMesh) -> list[Seam]:
    """Find the seams of the design surface of a mesh; points are numbered by rows of ``mesh.surface_ids``."""
    # A mesh without splines counts as a mesh of order 2 whose sides are the quads between its points.
    return find_seams(_sides(mesh))


def mirror_seams_of_mesh(mesh: MovingMesh) -> list[Seam]:
    """Find the edges of a mesh's design surface in planes that it has to stay in, as `find_mirror_seams` does."""
    rows, places = np.unique(mesh.in_plane_rows), mesh.points[mesh.surface_ids]
    planes = []
    for plane in mesh_planes(mesh):
        is_near = np.abs(places[rows] @ plane.normal - plane.offset) <= IN_PLANE * mesh.size
        planes.append((plane.normal, plane.offset, rows[is_near]))
    return find_mirror_seams(_sides(mesh), planes)


def _sides(mesh: MovingMesh) -> Iterator[tuple[VolumeSide, np.ndarray]]:
    """Sides of blocks on the surface, without sides between two blocks and sides without extent."""
    found = defaultdict(list)
    for number, ids in enumerate(mesh.blocks):
        for side in range(6):
            face = mesh.surface_rows[np.take(ids, -(side % 2), axis=side // 2)]
            has_collapsed = (face == face[:1]).all() or (face == face[:, :1]).all()
            if (face >= 0).all() and not has_collapsed:
                found[np.unique(face).tobytes()].append((number, side, face))
    for faces in found.values():
        if len(faces) == 1:
            number, side, face = faces[0]
            ids, direction = mesh.blocks[number], side // 2
            volume = mesh.volumes[number] if mesh.volumes else _linear(ids.shape)
            u, v = (d for d in range(3) if d != direction)
            yield VolumeSide(volume, mesh.points[ids], direction, side % 2, (u, v)), face


def _linear(shape: tuple[int, ...]) -> Volume:
    """Splines of order 2 whose control points are the points of a block."""
    return Volume(tuple(ConstantKnots.uniform(n, min(n, 2)) for n in shape))
