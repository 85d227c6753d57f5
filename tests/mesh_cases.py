"""Meshes without structure for tests: tetrahedra around a body, and a section of triangles in one layer of wedges."""

from functools import cache
from itertools import product

import numpy as np
from scipy.spatial import Delaunay

from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.grids.cells.mixed_cells import MixedMesh, fans
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window

TETRAHEDRA = np.array([[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]])


def mesh_around_a_body(turn: np.ndarray | None = None) -> tuple[MixedMesh, dict[str, str]]:
    """Tetrahedra around a block that stands on a plane of symmetry, y = 0, in a box of unequal sides."""
    x, y, z = np.linspace(-3.0, 4.0, 14) ** 3 / 16.0, np.linspace(0.0, 2.0, 9), np.linspace(-1.5, 1.2, 10)
    nodes = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    ids = np.arange(nodes[..., 0].size).reshape(nodes.shape[:3])
    middle = 0.5 * (nodes[:-1, :-1, :-1] + nodes[1:, 1:, 1:])
    is_body = (np.abs(middle[..., 0]) < 0.2) & (middle[..., 1] < 0.8) & (np.abs(middle[..., 2]) < 0.4)
    a, b = slice(None, -1), slice(1, None)
    ring = [(a, a), (b, a), (b, b), (a, b)]
    hexahedra = np.stack([ids[i, j, k] for k in (a, b) for i, j in ring], axis=-1)[~is_body]
    corners = hexahedra[:, TETRAHEDRA].reshape(-1, 4)
    points = nodes.reshape(-1, 3)
    skin = MixedMesh(points, {"tetra": corners}).skin
    box = points.min(axis=0), points.max(axis=0)
    on = {
        name: np.isclose(points[skin][..., axis], box[end][axis]).all(axis=1)
        for name, axis, end in (("symmetry", 1, 0), *((f"far_{d}{e}", d, e) for d in range(3) for e in range(2)))
        if name != "far_10"
    }
    is_wall = ~np.any(list(on.values()), axis=0)
    used, numbers = np.unique(corners, return_inverse=True)
    place = np.full(len(points), -1)
    place[used] = np.arange(len(used))
    markers = {"body": place[skin[is_wall]], **{name: place[skin[rows]] for name, rows in on.items()}}
    kinds = {"body": "wall", "symmetry": "symmetry"} | {name: "farfield" for name in on if name != "symmetry"}
    points = points[used] if turn is None else points[used] @ turn.T
    return MixedMesh(points, {"tetra": numbers.reshape(corners.shape)}, markers), kinds


def combs():
    """Three layers of twelve prisms of six sides: polyhedra, and polygons in pieces."""
    numbers, loops = {}, []
    for i, j in np.ndindex(4, 3):
        angles = np.radians(30.0 + 60.0 * np.arange(6))
        ring = np.column_stack([np.sqrt(3.0) * (i + 0.5 * (j % 2)) + np.cos(angles), 1.5 * j + np.sin(angles)])
        loops.append([numbers.setdefault((round(1e3 * x), round(1e3 * y)), len(numbers)) for x, y in ring])
    n, seen, found = len(numbers), {}, []
    flat = np.array(list(numbers)) / 1e3
    for cell, (layer, loop) in enumerate(product(range(3), loops)):
        low, high = (np.array(loop) + (layer + up) * n for up in (0, 1))
        sides = [[low[k - 1], low[k], high[k], high[k - 1]] for k in range(6)]
        for face in (low[::-1], high, *sides):
            polygon = seen.setdefault(frozenset(face), (len(seen), cell, face))
            quads, _ = fans(np.array(polygon[2]), np.array([len(face)]))
            found += [(quad if polygon[1] == cell else quad[::-1], cell, polygon[0]) for quad in quads]
    points = np.concatenate([np.column_stack([flat, np.full(n, 0.7 * layer)]) for layer in range(4)])
    quads, cells, polygons = (np.array(part) for part in zip(*found))
    return MixedMesh(points, {}, None, (quads, cells), polygons=polygons)


def smooth_change(model: MeshModel, rng: np.random.Generator, size: float) -> np.ndarray:
    """Smooth displacements of the nodes of the walls, in planes where these are."""
    points = model.mesh.points[model.wall_rows]
    change = size * np.sin(points @ rng.normal(size=(3, 3)) + rng.normal(size=3))
    for plane in model.planes:
        ids = np.flatnonzero(np.isin(model.wall_rows, plane.rows))
        change[ids] -= np.outer(change[ids] @ plane.normal, plane.normal)
    return change


def mesh_around_a_section(n_around: int = 24, n_off: int = 9) -> tuple[MixedMesh, dict[str, str]]:
    """Triangles around an ellipse in a circle, in one layer of wedges across y: first all nodes of y = 0."""
    angle = 2.0 * np.pi * np.arange(n_around) / n_around
    ellipse = np.stack([0.5 * np.cos(angle), 0.08 * np.sin(angle)], axis=1)
    circle = 4.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    part = np.linspace(0.0, 1.0, n_off)[:, None, None] ** 2
    plane = ((1.0 - part) * ellipse + part * circle).reshape(-1, 2)
    ids = np.arange(len(plane)).reshape(n_off, n_around)
    ring = np.stack([ids[:-1], np.roll(ids[:-1], -1, axis=1), np.roll(ids[1:], -1, axis=1), ids[1:]], axis=-1)
    triangles = np.concatenate([ring[..., [0, 1, 2]].reshape(-1, 3), ring[..., [0, 2, 3]].reshape(-1, 3)])
    n, zeros = len(plane), np.zeros(len(plane))
    points = np.concatenate([np.stack([plane[:, 0], zeros + y, plane[:, 1]], axis=1) for y in (0.0, 0.3)])

    def side(row: np.ndarray) -> np.ndarray:
        ends = np.roll(row, -1)
        return np.stack([row, ends, ends + n, row + n], axis=1)

    cells = {"wedge": np.concatenate([triangles, triangles + n], axis=1)}
    mesh = MixedMesh(points, cells, {"airfoil": side(ids[0]), "far": side(ids[-1])}, n_copies=2)
    return mesh, {"airfoil": "wall", "far": "farfield"}


def channel_with_a_floor(n: tuple[int, int] = (160, 20)) -> tuple[MixedMesh, dict[str, str]]:
    """Quads of a long flat channel, in one layer of hexahedra across z, with a wall below."""
    x, y = np.linspace(0.0, 20.0, n[0] + 1), np.linspace(0.0, 1.0, n[1] + 1) ** 1.5
    plane = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    ids, size = np.arange(len(plane)).reshape(n[0] + 1, n[1] + 1), len(plane)
    quads = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)
    points = np.concatenate([np.column_stack([plane, np.full(size, z)]) for z in (0.0, 0.3)])

    def side(row: np.ndarray) -> np.ndarray:
        return np.stack([row[:-1], row[1:], row[1:] + size, row[:-1] + size], axis=1)

    markers = {"floor": side(ids[:, 0]), "top": side(ids[::-1, -1]), "in": side(ids[0, ::-1]), "out": side(ids[-1])}
    kinds = {"floor": "wall", "top": "farfield", "in": "farfield", "out": "farfield"}
    return MixedMesh(points, {"hexahedron": np.concatenate([quads, quads + size], axis=1)}, markers, n_copies=2), kinds


def mesh_around_two_sections(gap: float) -> tuple[MixedMesh, dict[str, str]]:
    """Triangles around a large ellipse and a small one below its end, in one layer of wedges across z."""
    angle, sizes = 2.0 * np.pi * np.arange(300) / 300, ((0.5, 0.06), (0.05, 0.02))
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    middles = np.zeros(2), np.array([0.3, -0.8 * 0.06 - gap - 0.02])
    bodies = [middle + size * circle[::step] for middle, size, step in zip(middles, np.array(sizes), (1, 5))]
    plane = np.concatenate(bodies)
    for off in np.geomspace(0.3 * gap, 4.0, 18):
        rings = [middle + (np.array(size) + off) * circle[::5] for middle, size in zip(middles, sizes)]
        for ring in rings if off < 1.0 else rings[:1]:
            is_off = np.all([(((ring - m) / s) ** 2).sum(axis=1) > 1.0 for m, s in zip(middles, sizes)], axis=0)
            near = np.linalg.norm(ring[:, None] - plane, axis=2).min(axis=1)
            plane = np.concatenate([plane, ring[is_off & (near > 0.3 * off)]])
    triangles = Delaunay(plane).simplices
    first, second = plane[triangles[:, 1]] - plane[triangles[:, 0]], plane[triangles[:, 2]] - plane[triangles[:, 0]]
    areas = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    triangles = np.where((areas > 0.0)[:, None], triangles, triangles[:, [0, 2, 1]])
    starts = np.cumsum([0, len(bodies[0]), len(bodies[1])])
    is_inside = [((triangles >= a) & (triangles < b)).all(axis=1) for a, b in zip(starts, starts[1:])]
    triangles = triangles[~np.any(is_inside, axis=0)]
    n = len(plane)
    points = np.concatenate([np.column_stack([plane, np.full(n, z)]) for z in (0.0, 0.3)])

    def side(ids: np.ndarray) -> np.ndarray:
        ends = np.roll(ids, -1)
        return np.stack([ids, ends, ends + n, ids + n], axis=1)

    cells = {"wedge": np.concatenate([triangles, triangles + n], axis=1)}
    markers = {"main": side(np.arange(300)), "flap": side(np.arange(300, 360)), "far": side(np.arange(n - 60, n))}
    return MixedMesh(points, cells, markers, n_copies=2), {"main": "wall", "flap": "wall", "far": "farfield"}


@cache
def body_model() -> MeshModel:
    """The mesh around a body, with a lattice of few spans."""
    return MeshModel.of(*mesh_around_a_body(), LatticeSettings(spacing=0.4))


@cache
def section_model() -> MeshModel:
    """The mesh around a section."""
    return MeshModel.of(*mesh_around_a_section())


def periodic_mesh(lean: float = 0.3, twist: float = 0.0) -> tuple[MixedMesh, dict[str, str]]:
    """Tetrahedra around a body over a floor, between curved sides, one period apart in y and not if twisted."""
    axes = np.linspace(-1.5, 2.0, 12), np.linspace(0.0, 1.0, 9), np.linspace(0.0, 1.6, 9)
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    ids = np.arange(nodes[..., 0].size).reshape(nodes.shape[:3])
    middle = 0.5 * (nodes[:-1, :-1, :-1] + nodes[1:, 1:, 1:])
    is_body = (np.abs(middle - [0.1, 0.5, 0.7]) < [0.3, 0.13, 0.25]).all(axis=-1)
    a, b = slice(None, -1), slice(1, None)
    ring = [(a, a), (b, a), (b, b), (a, b)]
    hexahedra = np.stack([ids[i, j, k] for k in (a, b) for i, j in ring], axis=-1)[~is_body]
    corners, points = hexahedra[:, TETRAHEDRA].reshape(-1, 4), nodes.reshape(-1, 3).copy()
    skin = MixedMesh(points, {"tetra": corners}).skin
    ends = {"per_1": (1, 0.0), "per_2": (1, 1.0), "floor": (2, 0.0), "top": (2, 1.6), "in": (0, -1.5), "out": (0, 2.0)}
    on = {name: np.isclose(points[skin][..., axis], end).all(axis=1) for name, (axis, end) in ends.items()}
    is_wall = ~np.any(list(on.values()), axis=0)
    used, numbers = np.unique(corners, return_inverse=True)
    place = np.full(len(points), -1)
    place[used] = np.arange(len(used))
    points[:, 1] *= 1.0 + twist * points[:, 0]
    points[:, 1] += lean * np.sin(points[:, 0]) + 0.2
    markers = {"body": place[skin[is_wall]], **{name: place[skin[rows]] for name, rows in on.items()}}
    kinds = {"body": "wall", "floor": "wall", "per_1": "periodic", "per_2": "periodic"}
    kinds |= dict.fromkeys(("top", "in", "out"), "farfield")
    return MixedMesh(points[used], {"tetra": numbers.reshape(-1, 4)}, markers), kinds


@cache
def periodic_model() -> MeshModel:
    """The mesh between periodic sides."""
    return MeshModel.of(*periodic_mesh(), LatticeSettings(spacing=0.3))


def sector_mesh(
    angle: float = 0.5,  # between its sides (rad), of either sign
    inner: float = 1.2,  # radius of the floor (m)
    axis: tuple[float, float, float] = (2.0, -1.0, 0.5),
    point: tuple[float, float, float] = (0.3, 4.0, -0.2),  # a point of the axis (m)
    lean: float = 0.3,  # how far sides bend
) -> tuple[MixedMesh, dict[str, str]]:
    """The mesh between periodic sides, bent around an axis, with ends that walls meet."""
    mesh, kinds = periodic_mesh(lean)
    ahead = np.array(axis) / np.linalg.norm(axis)
    first = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
    first /= np.linalg.norm(first)
    frame = np.stack([ahead, first, np.cross(ahead, first)])
    x, y, z = mesh.points.T
    points = np.stack([x, (inner + z) * np.cos(angle * y), (inner + z) * np.sin(angle * y)], axis=1) @ frame + point
    cells = mesh.cells["tetra"]
    return MixedMesh(points, {"tetra": cells if angle < 0.0 else cells[:, [1, 0, 2, 3]]}, mesh.markers), kinds


@cache
def sector_model(angle: float = 0.5) -> MeshModel:
    """A sector around an oblique axis."""
    return MeshModel.of(*sector_mesh(angle), LatticeSettings(spacing=0.3))


def nozzle_wedge(angle: float, n: tuple[int, int, int] = (15, 11, 4)) -> Grid:
    """One block of a wedge with its axis x, below a wall that narrows."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, count) for count in n), indexing="ij")
    r, turned = j * (1.0 - 0.3 * np.sin(np.pi * i) ** 2), angle * (k - 0.5)
    nodes = np.stack([3.0 * i, r * np.cos(turned), r * np.sin(turned)], axis=-1)
    whole = Window.whole(0, n)
    ends = (Patch(name, "farfield", (whole.face(side),)) for side, name in enumerate(("in", "out")))
    return Grid((Block(nodes, "block 1"),), (Patch("nozzle", "wall", (whole.face(3),)), *ends), "nozzle")
