"""Volume grids extruded from surfaces: validity, heights, rims, topology, and surfaces that are refused."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.spatial import cKDTree

from bspline_mdao import Grid, InputError, find_topology, fit_grid, read_grid
from bspline_mdao.core.generators.extrusion import background
from bspline_mdao.core.generators.extrusion.surface import SurfaceMesh
from bspline_mdao.generators import Marching, ball_grid, brick_grid, extrude_surface
from bspline_mdao.grids import Block, GridQuality
from bspline_mdao.grids.cells.wall_spacing import flat_plate_y_plus
from bspline_mdao.grids.topology.overset import component_numbers, donors_of_others

FIRST = 2e-3


def surface_of(grid: Grid, step: int = 1) -> Grid:
    """The first layer of a volume grid."""
    return Grid(tuple(Block(block.nodes[::step, ::step, :1].copy(), block.name) for block in grid.blocks))


def sheet(*faces: np.ndarray) -> Grid:
    """A surface of faces, each of shape (ni, nj, 3)."""
    return Grid(tuple(Block(face[:, :, None], f"block {n}") for n, face in enumerate(faces, 1)))


def plane(origin, first, second, shape) -> np.ndarray:
    """A flat face between two edges."""
    s, t = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    return origin + s[..., None] * np.asarray(first, float) + t[..., None] * np.asarray(second, float)


def corners_of(grid: Grid) -> np.ndarray:
    """Smallest corner of every cell."""
    quality = GridQuality.of_baseline(grid)
    return np.concatenate([cells.min_corner.ravel() for cells in quality.cells(grid.to_vector().reshape(-1, 3))])


def heights_of(grid: Grid) -> np.ndarray:
    """Heights of the first cells at all nodes of walls."""
    return GridQuality.of_baseline(grid).first_cells.baseline


def rotation(rng: np.random.Generator) -> np.ndarray:
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return turn * np.linalg.det(turn)


def ball(shape=(9, 8, 7, 3), octant: bool = False) -> Grid:
    return surface_of(ball_grid(shape, octant=octant))


def test_ball_gets_concentric_layers_of_the_asked_height():
    grid = extrude_surface(ball((13, 12, 14, 3)), FIRST, layers=20, outer=10.0)
    assert corners_of(grid).min() > 0.6  # of the surface itself: 0.62 at the corners of the cube
    assert np.abs(heights_of(grid) / FIRST - 1.0).max() < 0.01
    for block in grid.blocks:  # lines leave the wall along its normal
        wall, up = block.nodes[:, :, 0], block.nodes[:, :, 1] - block.nodes[:, :, 0]
        lengths = np.linalg.norm(wall, axis=-1) * np.linalg.norm(up, axis=-1)
        assert (np.sum(wall * up, axis=-1) / lengths).min() > np.cos(np.radians(2.0))
    radii = np.linalg.norm(np.concatenate([block.nodes[:, :, -1].reshape(-1, 3) for block in grid.blocks]), axis=1)
    assert np.ptp(radii) < 0.15 * radii.mean()
    assert abs(radii.mean() / 11.0 - 1.0) < 0.15


def test_each_surface_block_becomes_one_right_handed_block_with_its_interfaces():
    surface = ball()
    grid = extrude_surface(surface, FIRST, layers=8, outer=2.0)
    topology = find_topology(grid)
    assert [block.name for block in grid.blocks] == [block.name for block in surface.blocks]
    assert len(topology.interfaces) == 12
    assert not topology.warnings
    assert all(face.patch in ("wall", "farfield") for face in topology.boundary)
    quality = GridQuality.of_baseline(grid)
    assert all(cells.handedness == 1 for cells in quality.cells(grid.to_vector().reshape(-1, 3)))
    assert fit_grid(grid, progress=False).n_nodes == grid.n_nodes


def test_grid_does_not_depend_on_how_blocks_are_turned_and_oriented():
    surface, rng = ball((6, 5, 7, 3)), np.random.default_rng(3)
    turned = []
    for block in surface.blocks:
        nodes = block.nodes
        nodes = np.flip(nodes, axis=[axis for axis in (0, 1) if rng.random() < 0.5])
        nodes = np.moveaxis(nodes, 2, rng.integers(3)) if rng.random() < 0.5 else nodes.transpose(1, 0, 2, 3)
        turned.append(Block(np.ascontiguousarray(nodes), block.name))
    one, other = (extrude_surface(each, FIRST, layers=8, outer=4.0) for each in (surface, Grid(tuple(turned))))
    for a, b in zip(one.blocks, other.blocks):
        distances, _ = cKDTree(b.nodes.reshape(-1, 3)).query(a.nodes.reshape(-1, 3))
        assert distances.max() < 4e-2  # sweeps of the solver go in another order, to its tolerance of 1e-3


def test_half_in_a_plane_of_symmetry_is_the_half_of_the_whole_however_it_lies():
    rng = np.random.default_rng(4)
    turn, shift = rotation(rng), rng.normal(size=3)
    surface = ball((7, 7, 7, 3))
    half = [block for block in surface.blocks if block.name == "z+"]
    for block in surface.blocks:
        if block.name[0] != "z":
            nodes = block.nodes
            axis = int(np.argmax([np.ptp(nodes[:, 0, 0, 2]), np.ptp(nodes[0, :, 0, 2])]))
            upper = np.flatnonzero(np.take(nodes[..., 2], 0, axis=1 - axis)[:, 0] >= -1e-9)
            half.append(Block(np.take(nodes, upper, axis=axis), block.name))
    whole = extrude_surface(surface, FIRST, layers=10, outer=5.0)
    moved = Grid(tuple(Block(block.nodes @ turn.T + shift, block.name) for block in half))
    grid = extrude_surface(moved, FIRST, layers=10, outer=5.0)
    assert [(patch.name, patch.kind) for patch in grid.patches][2:] == [("symmetry", "symmetry")]
    assert len(grid.patches[2].windows) == 4
    for window in grid.patches[2].windows:
        side = grid.blocks[window.block].nodes[window.slices]
        assert np.abs((side - shift) @ turn[:, 2]).max() < 1e-12
    top = [next(block for block in each.blocks if block.name == "z+").nodes for each in (whole, grid)]
    np.testing.assert_allclose((top[1] - shift) @ turn, top[0], atol=4e-2)  # the tolerance of the solver is 1e-3


def test_octant_has_three_planes_of_symmetry():
    grid = extrude_surface(ball((7, 8, 6, 3), octant=True), FIRST, layers=12, outer=6.0)
    assert [patch.name for patch in grid.patches][2:] == ["symmetry", "symmetry_2", "symmetry_3"]
    assert corners_of(grid).min() > 0.6
    for patch in grid.patches[2:]:
        sides = [grid.blocks[window.block].nodes[window.slices].reshape(-1, 3) for window in patch.windows]
        assert np.abs(np.concatenate(sides)).max(axis=0).min() < 1e-12


def test_brick_with_sharp_edges_has_the_heights_above_each_of_its_sides():
    grid = extrude_surface(surface_of(brick_grid((9, 11, 7, 3), (1.0, 2.0, 0.5))), FIRST, layers=24, outer=20.0)
    assert corners_of(grid).min() > 0.3
    assert np.abs(heights_of(grid) / FIRST - 1.0).max() < 0.01


def test_straight_edges_of_symmetry_are_those_that_are_given():
    octant = surface_of(brick_grid((6, 7, 5, 3), (1.0, 2.0, 0.5), octant=True))
    grid = extrude_surface(octant, FIRST, layers=12, outer=8.0, symmetry=("x", "y", (0.0, 0.0, 2.0)))
    assert [patch.kind for patch in grid.patches][2:] == 3 * ["symmetry"]
    assert corners_of(grid).min() > 0.3
    assert min(block.nodes.min() for block in grid.blocks) > -1e-12


@pytest.mark.parametrize("angle", [60.0, 90.0, 150.0])
def test_concave_corner_is_filled_without_inverted_cells(angle):
    rise = [np.cos(np.deg2rad(angle)), 0.0, np.sin(np.deg2rad(angle))]
    faces = plane(np.zeros(3), (1, 0, 0), (0, 1, 0), (13, 7)), plane(np.zeros(3), rise, (0, 1, 0), (11, 7))
    mesh = SurfaceMesh.of(sheet(*faces))
    corners = mesh.points[mesh.quads[0]]
    inward = bool(np.cross(corners[2] - corners[0], corners[3] - corners[1])[2] < 0.0)
    grid = extrude_surface(sheet(*faces), FIRST, layers=25, outer=0.3, symmetry=("y",), inward=inward)
    assert corners_of(grid).min() > 0.0
    assert np.abs(heights_of(grid) / FIRST - 1.0).max() < 0.01


def test_free_edges_of_a_plate_lean_outwards_by_the_splay():
    plate = sheet(plane(np.zeros(3), (1, 0, 0), (0, 2, 0), (8, 9)))
    straight, leaning = (extrude_surface(plate, FIRST, layers=15, outer=1.0, splay=angle) for angle in (0.0, 20.0))
    assert [(patch.name, len(patch.windows)) for patch in leaning.patches][2:] == [("edges", 4)]
    assert corners_of(straight).min() > 0.999
    assert corners_of(leaning).min() > 0.7
    assert np.ptp(straight.blocks[0].nodes[..., 0]) == pytest.approx(1.0)
    assert 1.2 < np.ptp(leaning.blocks[0].nodes[..., 0]) < 2.5
    assert np.abs(heights_of(leaning) / FIRST - 1.0).max() < 0.01


def test_ring_with_poles_in_one_block_is_an_o_grid_with_collapsed_lines():
    theta, phi = np.meshgrid(np.linspace(0, np.pi, 13), np.linspace(0, 2 * np.pi, 22), indexing="ij")
    body = np.stack([2 * np.cos(theta), np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)], axis=-1)
    grid = extrude_surface(sheet(body), FIRST, layers=16, outer=10.0)
    topology = find_topology(grid)
    assert len(topology.interfaces) == 1
    assert [patch.name for patch in grid.patches] == ["wall", "farfield"]
    assert corners_of(grid).min() > 0.0
    assert np.ptp(grid.blocks[0].nodes[0], axis=0).max() < 1e-12


def c_surface(sweep: float) -> tuple[np.ndarray, int]:
    """A wing between two planes with its wake, below and above it, as one block; nodes of the wake."""
    x, wake = 0.5 * (1.0 + np.cos(np.linspace(0.0, np.pi, 25))), np.geomspace(1.0, 8.0, 17)
    side = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    x = np.concatenate([wake[:0:-1], x, x[-2::-1], wake[1:]])
    y = np.concatenate([0.0 * wake[1:], -side, side[-2::-1], 0.0 * wake[1:]])
    z = np.linspace(0.0, 1.5, 6)
    return np.stack([x[:, None] + sweep * z, y[:, None] + 0.0 * z, 0.0 * x[:, None] + z], axis=-1), len(wake)


@pytest.mark.parametrize("n_blocks", [1, 4])
@pytest.mark.parametrize("turned", [(), (0,), (0, 1, 2, 3)])
def test_wake_sheet_that_comes_twice_makes_a_c_grid(n_blocks, turned):
    nodes, n = c_surface(0.0)
    cuts = {1: [0, len(nodes) - 1], 4: [0, n - 1, n + 23, len(nodes) - n, len(nodes) - 1]}[n_blocks]
    faces = [nodes[lo : hi + 1] for lo, hi in zip(cuts, cuts[1:])]
    faces = [np.ascontiguousarray(face[:, ::-1]) if number in turned else face for number, face in enumerate(faces)]
    grid = extrude_surface(sheet(*faces), 1e-3, layers=25, outer=6.0, symmetry=("z",), constant=("x",))
    assert corners_of(grid).min() > 0.5
    off = np.abs(heights_of(grid) / 1e-3 - 1.0)
    assert np.quantile(off, 0.9) < 0.01
    assert off.max() < 0.08  # the nose has few nodes
    topology = find_topology(grid)
    assert len(topology.interfaces) == {1: 1, 4: 4}[n_blocks]  # both sides of the wake are one of them
    assert not topology.warnings
    walls = np.concatenate([grid.blocks[w.block].nodes[w.slices].reshape(-1, 3) for w in grid.patches[0].windows])
    assert walls[:, 0].max() == pytest.approx(1.0)
    assert fit_grid(grid, progress=False).n_nodes == grid.n_nodes


def tapered_wing(base: float) -> Grid:
    """Half of a swept wing with a plane tip: skin and tip, and the base of its trailing edge where that is blunt."""
    x = 0.5 * (1.0 + np.cos(np.linspace(0.0, np.pi, 25)))
    side = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4) + 0.5 * base * x
    side[0] = 0.5 * base  # the polynomial closes to round-off
    low, high, across = np.stack([x, -side], 1), np.stack([x, side], 1), np.linspace(0.0, 1.0, 7)[:, None]

    def placed(section: np.ndarray, z: np.ndarray) -> np.ndarray:
        chord = 1.0 - 0.4 * z
        return np.stack([0.6 * z + chord * section[..., 0], chord * section[..., 1], 2.0 * z + 0.0 * chord], axis=-1)

    span = np.sin(np.linspace(0.0, 0.5 * np.pi, 13))
    skin = placed(np.concatenate([low, high[-2::-1]])[:, None], span * np.ones((49, 1)))
    tip = placed(low[:, None] * (1.0 - across) + high[:, None] * across, np.ones((25, 7)))
    back = placed((low[0] * (1.0 - across) + high[0] * across)[:, None], span * np.ones((7, 1)))
    return sheet(skin, tip, back) if base else sheet(skin, tip)


def collar(n: int = 49) -> Grid:
    """A stub of elliptic section on a cylinder, and the ring of that around it, as two blocks that meet."""
    turn, part = np.linspace(0.0, -2.0 * np.pi, n), np.linspace(0.0, 1.0, 13)[:, None] ** 1.5
    turn[-1] = 0.0
    root = np.stack([0.5 * np.cos(turn), 0.1 * np.sin(turn)], 1)[:, None]
    plan = (1.0 - part) * root + part * np.stack([np.cos(turn), 0.6 * np.sin(turn)], 1)[:, None]
    body = np.concatenate([plan, np.sqrt(2.25 - plan[..., 1:] ** 2)], axis=-1)
    stub = np.repeat(body[:, :1], 13, axis=1) + 0.8 * part * np.eye(3)[2]
    return sheet(body, stub)


@pytest.mark.parametrize(("base", "least", "most"), [(0.0, 0.08, 0.38), (0.01, 0.24, 0.67)])
def test_wings_with_sharp_and_blunt_edges_and_plane_tips_have_no_inverted_cell(base, least, most):
    grid = extrude_surface(tapered_wing(base), 1e-5, layers=64, outer=40.0, symmetry=("z",))
    corners = corners_of(grid)
    assert corners.min() > least  # the trailing edge of the sharp one is a wedge of 16 degrees
    assert np.quantile(corners, 0.01) > most
    assert np.mean(np.abs(heights_of(grid) / 1e-5 - 1.0) < 0.01) > 0.99


def test_first_cells_that_are_low_are_exact_where_those_of_a_thin_tip_are_not():
    grid = extrude_surface(tapered_wing(0.01), 1e-3, layers=30, outer=40.0, symmetry=("z",))
    assert corners_of(grid).min() > 0.2
    assert np.mean(np.abs(heights_of(grid) / 1e-3 - 1.0) < 0.01) > 0.8


def test_collar_around_a_stub_on_a_body_has_no_inverted_cell():
    grid = extrude_surface(collar(), 1e-3, layers=30, outer=0.3, inward=True)
    corners = corners_of(grid)
    assert corners.min() > 0.2
    assert np.quantile(corners, 0.01) > 0.38
    assert np.mean(np.abs(heights_of(grid) / 1e-3 - 1.0) < 0.01) > 0.99


def section_of(base: float) -> np.ndarray:
    """A symmetric section from its trailing edge around, (49, 2); blunt by the base."""
    x = 0.5 * (1.0 + np.cos(np.linspace(0.0, np.pi, 25)))
    side = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4) + 0.5 * base * x
    side[0] = 0.5 * base  # the polynomial closes to round-off
    return np.concatenate([np.stack([x, -side], 1), np.stack([x, side], 1)[-2::-1]])


def wing_on_body(base: float, n: int = 21) -> Grid:
    """A wing with a blunt trailing edge on a cylinder, and an O-grid on that around its root."""
    back = np.stack([np.ones(5), base * np.linspace(0.5, -0.5, 5)], 1)
    section = np.concatenate([section_of(base), back[1:]]) - [0.5, 0.0]
    strip = np.stack([np.append(section, np.full((len(section), 1), z), 1) for z in (0.0, 0.2)], axis=1)
    around = extrude_surface(sheet(strip), 2e-3, layers=n - 1, outer=0.4, symmetry=("z",)).blocks[0].nodes
    plan = around.take(0, axis=around.shape.index(2))[..., :2]
    body = np.concatenate([plan, np.sqrt(2.25 - plan[..., 1:] ** 2)], axis=-1)
    up = np.append(0.0, np.cumsum(1.25 ** np.arange(n - 1.0)))
    return sheet(body, body[:, :1] + (0.8 / up[-1]) * up[:, None] * np.eye(3)[2])


@pytest.mark.parametrize(("base", "least"), [(0.001, 0.08), (0.01, 0.3), (0.06, 0.2)])
def test_wings_with_thin_blunt_edges_on_bodies_have_no_inverted_cell(base, least):
    surface = wing_on_body(base)
    mesh = SurfaceMesh.of(surface)
    corners = mesh.points[mesh.quads[0]]
    inward = bool(np.cross(corners[2] - corners[0], corners[3] - corners[1])[2] < 0.0)
    grid = extrude_surface(surface, 1e-4, layers=40, outer=0.3, inward=inward)
    assert corners_of(grid).min() > least
    assert np.quantile(corners_of(grid), 0.01) > 0.7
    assert np.mean(np.abs(heights_of(grid) / 1e-4 - 1.0) < 0.01) > 0.97


@pytest.mark.parametrize("first", [1e-4, 2e-3])
def test_sharp_edge_of_a_section_may_have_first_cells_half_as_high_as_wide(first):
    strip = np.stack([np.append(section_of(0.0), np.full((49, 1), z), 1) for z in (0.0, 0.2)], axis=1)
    grid = extrude_surface(sheet(strip), first, layers=20, outer=0.4, symmetry=("z",))
    assert corners_of(grid).min() > 0.14  # the sine of half the angle of the wedge


@pytest.mark.parametrize("settings", [None, Marching()])
@pytest.mark.parametrize("first", [1e-5, 1e-2])
def test_tips_that_come_to_a_line_are_refused_by_the_one_error(first, settings):
    section, span = section_of(0.0), np.linspace(0.0, 1.0, 9)
    skin = np.stack([section[:, :1] + 0 * span, section[:, 1:] * (1 - span**4), 0 * section[:, :1] + 2 * span], -1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match="inverted, first in layer 1 around"):
            extrude_surface(sheet(skin), first, layers=20, outer=5.0, symmetry=("z",), settings=settings)


def bumpy_tube(n_along: int, shift: np.ndarray) -> np.ndarray:
    """A tube that repeats by a shift, which is oblique to it."""
    phi, along = np.meshgrid(np.linspace(0, 2 * np.pi, 29), np.linspace(0, 1, n_along), indexing="ij")
    radius = 1.0 + 0.1 * np.sin(2 * np.pi * along + phi)
    nodes = np.stack([radius * np.cos(phi), 0.7 * radius * np.sin(phi), 0.0 * phi], axis=-1)
    nodes[-1], nodes[:, -1] = nodes[0], nodes[:, 0]
    return nodes + along[..., None] * shift


@pytest.mark.parametrize("n_along", [2, 3, 9])
def test_periodic_edges_are_the_same_but_for_their_translation(n_along):
    shift = np.array([0.6, 0.2, 2.0])
    grid = extrude_surface(sheet(bumpy_tube(n_along, shift)), FIRST, layers=15, outer=3.0, symmetry=(), periodic=("z",))
    nodes, along = grid.blocks[0].nodes, grid.shapes[0].index(n_along)
    ends = nodes.take(0, along), nodes.take(-1, along)
    np.testing.assert_allclose(ends[1] - ends[0], np.broadcast_to(shift, ends[0].shape), atol=1e-14)
    assert corners_of(grid).min() > 0.7
    assert np.abs(heights_of(grid) / FIRST - 1.0).max() < 0.04  # a side ends within curved cells
    assert [(patch.name, patch.kind) for patch in grid.patches][2:] == [("periodic", "other")]
    assert len(find_topology(grid).periodic) == 1


def test_two_periods_are_extruded_as_one():
    shift = np.array([0.6, 0.2, 2.0])
    once = bumpy_tube(9, shift)
    twice = np.concatenate([once, once[:, 1:] + shift], axis=1)
    options = {"layers": 15, "outer": 3.0, "symmetry": (), "periodic": ("z",), "settings": Marching(tolerance=1e-8)}
    a, b = (extrude_surface(sheet(nodes), FIRST, **options).blocks[0].nodes for nodes in (once, twice))
    np.testing.assert_allclose(b[:, :9], a, atol=1e-4)


def test_surfaces_repeat_in_two_directions():
    x, y = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 2, 8), indexing="ij")
    waves = np.stack([x, y, 0.08 * np.sin(2 * np.pi * x) * np.cos(np.pi * y + 0.4)], axis=-1)
    grid = extrude_surface(sheet(waves), FIRST, layers=12, outer=1.0, symmetry=(), periodic=("x", "y"))
    nodes = grid.blocks[0].nodes
    for direction, size in ((0, 1.0), (1, 2.0)):
        gap = nodes.take(-1, direction) - nodes.take(0, direction)
        np.testing.assert_allclose(gap, np.broadcast_to(size * np.eye(3)[direction], gap.shape), atol=1e-13)
    assert corners_of(grid).min() > 0.9
    assert [patch.name for patch in grid.patches][2:] == ["periodic", "periodic_2"]


def test_periodic_edge_may_end_at_a_plane_of_symmetry():
    wall = sheet(np.ascontiguousarray(bumpy_tube(9, np.array([0.0, 0.0, 2.0]))[:15]))
    with pytest.raises(InputError, match="no edge"):
        extrude_surface(wall, FIRST, layers=8, outer=1.0, symmetry=("x",), periodic=("z",))
    x, y = np.meshgrid(np.linspace(0, 1, 7), np.linspace(0, 2, 8), indexing="ij")
    waves = np.stack([x, y, 0.1 * np.cos(np.pi * x) * np.sin(np.pi * y)], axis=-1)
    grid = extrude_surface(sheet(waves), FIRST, layers=12, outer=1.0, symmetry=("x",), periodic=("y",))
    nodes = grid.blocks[0].nodes
    assert np.abs(np.ptp(nodes[..., 0], axis=(1, 2))[[0, -1]]).max() < 1e-14
    np.testing.assert_allclose(nodes[:, -1] - nodes[:, 0], np.broadcast_to([0, 2, 0], nodes[:, 0].shape), atol=1e-13)
    assert corners_of(grid).min() > 0.9


def test_swept_edges_stay_in_the_plane_that_is_given():
    phi, span = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(0, 1, 9), indexing="ij")
    tube = np.stack([np.cos(phi) + 0.6 * span, np.sin(phi), 2.0 * span], axis=-1)
    grid = extrude_surface(sheet(tube), FIRST, layers=15, outer=3.0, symmetry=(), constant=("z",))
    assert [(patch.name, patch.kind) for patch in grid.patches][2:] == [("constant", "other")]
    nodes = grid.blocks[0].nodes
    ends = sorted([nodes[:, 0], nodes[:, -1]] if np.ptp(nodes[:, 0, :, 2]) < 1 else [nodes[0], nodes[-1]], key=np.mean)
    assert max(np.ptp(end[..., 2]) for end in ends) < 1e-12
    assert corners_of(grid).min() > 0.3


def test_growth_gives_as_many_layers_as_reach_the_distance():
    grid = extrude_surface(ball((5, 5, 5, 3)), 0.01, growth=1.2, outer=2.0)
    steps = np.linalg.norm(np.diff(grid.blocks[0].nodes[2, 2], axis=0), axis=1)
    assert grid.shapes[0][2] == 1 + 21  # 0.01 (1.2^21 - 1) / 0.2 is the first that is above 2
    assert steps[0] == pytest.approx(0.01, rel=0.01)


@pytest.mark.parametrize("length", [None, 0.7])
def test_first_cells_have_the_height_of_y_plus_at_a_length(length):
    plate = sheet(plane(np.zeros(3), (1.3, 0, 0), (0, 2.0, 0), (6, 7)))
    grid = extrude_surface(plate, layers=30, outer=1.0, y_plus=3.0, reynolds=2e5, length=length)
    of = length or 1.3  # the middle one of 0, 1.3 and 2
    for height in (heights_of(grid).min(), heights_of(grid).max()):
        assert flat_plate_y_plus(height, 2e5 / of, of) == pytest.approx(3.0, rel=0.01)


def test_inward_fills_the_body():
    grid = extrude_surface(ball(), 0.01, layers=8, outer=0.4, inward=True)
    assert np.linalg.norm(grid.blocks[0].nodes[:, :, -1], axis=-1).max() < 0.7
    assert corners_of(grid).min() > 0.5


@pytest.mark.parametrize("turned", [False, True])
def test_grid_ends_in_a_background_box_which_ends_at_planes_of_symmetry(turned):
    turn = rotation(np.random.default_rng(8)) if turned else np.eye(3)
    half = Grid(tuple(Block(block.nodes @ turn.T, block.name) for block in tapered_wing(0.01).blocks))
    grid = extrude_surface(half, 1e-3, layers=20, outer=0.8, symmetry=(turn[:, 2],), background=12.0)
    box = grid.blocks[-1]
    assert box.name == "background"
    kinds = {patch.name: patch.kind for patch in grid.patches}
    assert [kinds[name] for name in ("wall", "overset", "farfield")] == ["wall", "overset", "farfield"]
    assert list(kinds.values()).count("symmetry") == 2
    whole, local = grid.to_vector().reshape(-1, 3) @ turn, box.nodes.reshape(-1, 3) @ turn
    assert abs(local[:, 2].min()) < 1e-9  # it ends at the plane, where the wing does
    assert whole[:, 2].min() > -1e-9
    assert min(np.ptp(local, axis=0)) > 12.0
    topology = find_topology(grid)
    assert not topology.warnings
    components = component_numbers(topology)
    assert len(np.unique(components)) == 2
    fringe = np.concatenate([grid.blocks[w.block].nodes[w.slices].reshape(-1, 3) for w in grid.patches[2].windows])
    donors = donors_of_others([block.nodes for block in grid.blocks], components, components[0], fringe)
    # a cell's rounding at the plane of symmetry aside, all nodes that end in the box have a cell there
    assert np.mean(donors.block == len(grid.blocks) - 1) > 0.9
    assert corners_of(grid).min() > 0.0


def test_background_is_refused_where_it_ends_inside_repeats_or_is_too_fine(monkeypatch):
    with pytest.raises(InputError, match="ends inside"):
        extrude_surface(ball((5, 5, 5, 3)), 0.01, layers=8, outer=2.0, background=1.0)
    tube = sheet(bumpy_tube(5, np.array([0.0, 0.0, 2.0])))
    with pytest.raises(InputError, match="periodic"):
        extrude_surface(tube, 0.01, layers=8, outer=1.0, symmetry=(), periodic=("z",), background=9.0)
    monkeypatch.setattr(background, "MOST_NODES", 1000)
    with pytest.raises(InputError, match="nodes; give a smaller outer distance"):
        extrude_surface(ball((5, 5, 5, 3)), 0.01, layers=8, outer=1.0, background=9.0)


BAD = {
    "nothing": ({}, "first cells of no height"),
    "zero": ({"first_cell": 0.0}, "first_cell of 0.0"),
    "nan": ({"first_cell": float("nan")}, "first_cell of nan"),
    "y+ alone": ({"y_plus": 1.0}, "go together"),
    "both": ({"first_cell": 0.1, "y_plus": 1.0, "reynolds": 1e6}, "give one of both"),
    "length alone": ({"first_cell": 0.1, "length": 1.0}, "no Reynolds number"),
    "no length": ({"y_plus": 1.0, "reynolds": 1e6, "length": 0.0}, "a length of 0.0"),
    "layers": ({"first_cell": 0.1, "layers": 0}, "0 layers"),
    "far": ({"first_cell": 0.1, "layers": 30, "outer": 1.0}, "reach farther"),
    "few": ({"first_cell": 1e-6, "layers": 3, "outer": 10.0}, "give more layers"),
    "growth": ({"first_cell": 0.1, "growth": 0.9}, "grow by 0.9"),
    "plane": ({"first_cell": 0.1, "layers": 4, "outer": 1.0, "symmetry": ("w",)}, "'w' is not known"),
    "no rim": ({"first_cell": 0.1, "layers": 4, "outer": 1.0, "symmetry": ("x",)}, "no edge of the surface's rim"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_requests_are_refused_in_one_line(case):
    options, message = BAD[case]
    with pytest.raises(InputError, match=message) as refusal:
        extrude_surface(ball((5, 5, 5, 3)), **options)
    assert "\n" not in str(refusal.value)


def _branch() -> Grid:
    faces = [plane(np.zeros(3), (1, 0, 0), edge, (5, 4)) for edge in ((0, 1, 0), (0, -1, 1), (0, -1, -1))]
    return sheet(*faces)


def _moebius() -> Grid:
    phi, width = np.meshgrid(np.linspace(0, 2 * np.pi, 31), np.linspace(-0.3, 0.3, 4), indexing="ij")
    radius = 1 + width * np.cos(phi / 2)
    return sheet(np.stack([radius * np.cos(phi), radius * np.sin(phi), width * np.sin(phi / 2)], axis=-1))


def _flat_cell() -> Grid:
    face = plane(np.zeros(3), (1, 0, 0), (0, 1, 0), (5, 6))
    face[2, 3] = 0.5 * (face[1, 3] + face[2, 2])
    face[1, 2] = 0.5 * (face[1, 3] + face[2, 2])
    return sheet(face)


def _touching() -> Grid:
    return sheet(plane(np.zeros(3), (1, 0, 0), (0, 1, 0), (4, 5)), plane(np.zeros(3), (-1, 0, 0), (0, -1, 0), (4, 5)))


def _folded() -> Grid:
    face = plane(np.zeros(3), (1, 0, 0), (0, 1, 0), (4, 5))
    return sheet(face, face[::-1].copy())


SURFACES = {
    "folded": (_folded, "lies on itself"),
    "branch": (_branch, "more than two cells meet"),
    "moebius": (_moebius, "turns over"),
    "flat": (_flat_cell, "has no area"),
    "touching": (_touching, "touch only in the point"),
    "volume": (lambda: ball_grid((4, 4, 4, 4)), "a surface is extruded"),
}


@pytest.mark.parametrize("case", SURFACES)
def test_surfaces_that_have_no_sides_are_refused(case):
    make, message = SURFACES[case]
    with pytest.raises(InputError, match=message):
        extrude_surface(make(), 0.01, layers=4, outer=0.1)


def test_periodic_edges_of_other_nodes_are_refused():
    nodes = bumpy_tube(9, np.array([0.0, 0.0, 2.0]))
    nodes[3:20, -1, :2] *= 1.01
    with pytest.raises(InputError, match="not equal up to a translation"):
        extrude_surface(sheet(nodes), FIRST, layers=8, outer=1.0, symmetry=(), periodic=("z",))


def test_inverted_cells_are_refused_and_placed_unless_they_are_allowed():
    fold = [np.cos(np.deg2rad(8.0)), 0.0, np.sin(np.deg2rad(8.0))]
    faces = plane(np.zeros(3), (1, 0, 0), (0, 1, 0), (5, 3)), plane(np.zeros(3), fold, (0, 1, 0), (5, 3))
    options = {"first_cell": 0.3, "layers": 3, "outer": 3.0, "symmetry": ("y",)}
    results = []
    for inward in (False, True):  # one of them is inside the wedge
        try:
            extrude_surface(sheet(*faces), inward=inward, **options)
            results.append("")
        except InputError as refusal:
            results.append(str(refusal))
    assert any("inverted" in text and "first in layer 1 around" in text for text in results)
    inward = "inverted" in results[1]
    with pytest.warns(UserWarning, match="inverted"):
        extrude_surface(sheet(*faces), inward=inward, allow_invalid=True, **options)


PYHYP = {
    # surface, volume of pyHyp from every second node of it, first cell and distance of that, 1 % corner of it
    "m6": ("grids/pyhyp_m6_9blocks.xyz", 3.2e-5, 24.7),
    "bwb": ("strangers/pyhyp_bwb_9blocks.xyz", 1.1e-5, 980.0),
}


@pytest.mark.parametrize("case", PYHYP)
def test_wings_have_no_inverted_cell_and_corners_as_good_as_those_of_pyhyp(real_grids, case):
    volume, first, outer = PYHYP[case]
    folder = real_grids.parent
    path = folder / "geometry" / f"pyhyp_{case}_surface.fmt"
    if not (path.is_file() and (folder / volume).is_file()):
        pytest.skip(f"no {path.name} beside the real grids")
    peer = read_grid(folder / volume)
    surface = read_grid(path)
    surface = Grid(tuple(Block(b.nodes[::2, ::2].copy(), b.name) for b in surface.blocks))
    grid = extrude_surface(surface, first, layers=40, outer=outer)
    assert sorted(grid.shapes) == sorted(peer.shapes)
    ours, theirs = corners_of(grid), corners_of(peer)
    assert ours.min() > theirs.min()
    assert np.quantile(ours, 0.01) >= np.quantile(theirs, 0.01)
    assert ours.mean() > theirs.mean()
    assert np.mean(np.abs(heights_of(grid) / first - 1.0) < 0.01) > 0.997
