"""The contract of `node_map`, of every map: derivatives, their transposes, subsets, and no hidden state."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import riding_cases
from mesh_cases import body_model, section_model, smooth_change
from scipy.spatial.transform import Rotation
from sliding_cases import passage

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.fit.live_fit import live_fit, live_grid
from bspline_mdao.core.mesh.surface_map import SurfaceMap
from bspline_mdao.core.walls.wall_correction import WallCorrection
from bspline_mdao.generators import Spacing, flat_plate_grid, onera_m6_grid
from bspline_mdao.grids.topology.topology import BoundaryFace
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.meshes import EmbeddedMesh
from bspline_mdao.movers import moving_mesh


@cache
def wing():
    return fit_grid(onera_m6_grid((11, 10, 9)), n_control=(7, 6, 5), order=(4, 3, 4))


@cache
def plate():
    return fit_grid(flat_plate_grid((9, 8, 7), Spacing(off_wall=1e-3)), n_control=(6, 5, 4), keep_residual=False)


@cache
def bare():
    """The wing's grid of which nobody has declared the boundary."""
    faces = tuple(BoundaryFace(face.window) for face in wing().topology.boundary)
    return replace(wing(), topology=replace(wing().topology, boundary=faces))


@cache
def paper():
    """The wing's grid without a layer at walls: the map is linear."""
    return fit_grid(onera_m6_grid((11, 10, 9)), n_control=(7, 6, 5), order=(4, 3, 4), wall_layer=False)


def moved(points, rng, size=2e-3):
    """Points that turned by a fifth of a radian and are a little off."""
    turn = Rotation.from_rotvec(0.2 * rng.standard_normal(3)).as_matrix()
    return points @ turn.T + size * rng.standard_normal(points.shape)


def spar():
    """Points inside the wing, in the middle of its thickness."""
    z, xi = np.meshgrid(np.linspace(0.0, 1.4, 7), [0.2, 0.4, 0.6], indexing="ij")
    chord = 0.805891 - 0.237386 * z
    return np.stack([0.577884 * z + xi * chord, np.zeros_like(z), z], axis=-1).reshape(-1, 3)


def of_grid(model, rng):
    return model.grid_map().at, {"control_points": moved(model.control_points, rng)}


def of_given_walls(rng):
    """All wall nodes but some."""
    grid_map, rows = wing().grid_map(), wing().grid_map().following.rows
    correction = WallCorrection.of(wing().topology, grid_map.nodes, np.sort(rng.permutation(rows)[len(rows) // 10 :]))
    points = moved(wing().control_points, rng)
    wall = grid_map.at(points).nodes[correction.rows]
    given = wall + 3e-3 * rng.standard_normal(wall.shape)
    return grid_map.meeting(correction).at, {"control_points": points, "surface": given}


def of_sliding(is_given, rng):
    """A passage whose hub and casing slide on surfaces, with places of the blade's nodes or without."""
    model = passage(contour=lambda x: 2.0 - 0.3 * x)
    mesh, surface = moving_mesh(model, "blade", sliding=["hub", "casing"]), SurfaceGrid.of(model, "blade")
    points = {"control_points": moved(model.control_points, rng)}
    if not is_given:
        return model.map_sliding(mesh.slides, model).at, points
    given = surface.points + 1e-3 * rng.normal(size=surface.points.shape)
    return model.map_meeting(surface.rows, model, mesh.slides).at, {**points, "surface": given}


def of_embedded_points(rng):
    """Points in the volumes, some of them next to walls, and in the body."""
    nodes = riding_cases.model().regenerate().to_vector().reshape(-1, 3)
    embedded = riding_cases.model().embed_points(np.concatenate([nodes[::7], spar()]), 0.5)
    assert embedded.following.layer.n_followers > 50
    assert len(embedded.in_body) > len(spar())
    points = riding_cases.twisted()[0]
    grid = riding_cases.model().grid_map().at(points).nodes
    return embedded.at, {"control_points": points, "grid": grid + 1e-6 * rng.standard_normal(grid.shape)}


def of_body_points(rng):
    embedded = wing().embed_points(spar(), 1e-6)
    nodes = wing().grid_map().nodes[embedded.wall_rows]
    return embedded.body.at, {"surface": moved(nodes, rng)}


def of_surface(model, rng):
    mesh = moving_mesh(model)
    surface_map = SurfaceMap.of(model, mesh, SurfaceGrid.of(model))
    return surface_map.at, {"surface_control_points": moved(mesh.points[mesh.surface_ids], rng)}


def of_live_grid(model, rng):
    """Of a baseline that is not the model's, whose nodes that coincide go together."""
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    nodes = nodes @ (np.eye(3) + 1e-2 * rng.standard_normal((3, 3)))
    initial = live_fit(model, nodes).control_points

    def at(grid_initial, control_points, control_points_initial=None):
        return live_grid(model, grid_initial).at(control_points, control_points_initial)

    inputs = {"grid_initial": nodes, "control_points_initial": initial, "control_points": moved(initial, rng)}
    return at, {name: inputs[name] for name in live_grid(model, nodes).inputs}


def of_riding_mesh(is_asked, rng):
    riding, (points, deformation) = EmbeddedMesh.of(riding_cases.model(), riding_cases.mesh()), riding_cases.twisted()
    wall = deformation.apply_to_nodes(riding.walls.initial)
    return riding.at, {"control_points": points} | ({"wall": wall} if is_asked else {})


def of_mesh(model, rng):
    """A mesh without structure, whose lattice and walls moved, not quite together."""
    walls = model.mesh.points[model.wall_rows] + smooth_change(model, rng, 0.02)
    points = model.mover.move(model.control_points, walls).points
    return model.node_map.at, {"control_points": points + 1e-3 * np.sin(points @ rng.standard_normal((3, 3)))}


MAPS = {
    "grid": lambda rng: of_grid(wing(), rng),
    "grid without walls": lambda rng: of_grid(bare(), rng),
    "grid without a residual": lambda rng: of_grid(plate(), rng),
    "grid of the paper": lambda rng: of_grid(paper(), rng),
    "grid, walls are given": of_given_walls,
    "grid, patches slide on surfaces": lambda rng: of_sliding(False, rng),
    "grid, patches slide and walls are given": lambda rng: of_sliding(True, rng),
    "embedded points": of_embedded_points,
    "points in a body": of_body_points,
    "surface": lambda rng: of_surface(wing(), rng),
    "surface without a residual": lambda rng: of_surface(plate(), rng),
    "live grid": lambda rng: of_live_grid(wing(), rng),
    "live grid without a residual": lambda rng: of_live_grid(plate(), rng),
    "live grid of the paper": lambda rng: of_live_grid(paper(), rng),
    "mesh without structure": lambda rng: of_mesh(body_model(), rng),
    "section without structure": lambda rng: of_mesh(section_model(), rng),
    "mesh that rides": lambda rng: of_riding_mesh(False, rng),
    "mesh that rides, walls are given": lambda rng: of_riding_mesh(True, rng),
}


@cache
def made(name):
    """What makes a state, the inputs, the state, smooth directions in these, and a bar."""
    rng = np.random.default_rng(5)
    at, inputs = MAPS[name](rng)
    waves = rng.standard_normal((3, 3))
    directions = {name: np.sin(x @ waves) for name, x in inputs.items()}
    state = at(**inputs)
    return at, inputs, state, directions, rng.standard_normal(state.nodes.shape)


@pytest.fixture(params=MAPS)
def case(request):
    return made(request.param)


@pytest.mark.slow
def test_jvp_is_the_derivative_of_the_nodes(case):
    """Richardson's differences: kernels are real."""
    at, inputs, state, directions, _ = case
    assert state.inputs == tuple(inputs)
    for name, direction in directions.items():
        slopes = []
        for h in (1e-5, 5e-6):
            ends = (at(**inputs | {name: inputs[name] + s * direction}).nodes for s in (h, -h))
            slopes.append(np.subtract(*ends) / (2 * h))
        found = state.jvp(**{name: direction})
        error = np.abs((4 * slopes[1] - slopes[0]) / 3 - found).max()
        assert error < 1e-7 * np.abs(found).max() > 0.0, name


@pytest.mark.slow
def test_jvp_is_linear_and_takes_directions_in_their_order_or_by_name(case):
    _, _, state, directions, _ = case
    whole = state.jvp(*directions.values())
    np.testing.assert_array_equal(whole, state.jvp(**directions))
    parts = sum(state.jvp(**{name: direction}) for name, direction in directions.items())
    np.testing.assert_allclose(parts, whole, rtol=0, atol=1e-13 * np.abs(whole).max())
    assert not state.jvp().any()


@pytest.mark.slow
def test_vjp_is_the_transpose_of_jvp_in_every_input(case):
    _, inputs, state, directions, bar = case
    bars = state.vjp(bar)
    assert {name: part.shape for name, part in bars.items()} == {name: x.shape for name, x in inputs.items()}
    rng = np.random.default_rng(6)
    for name, x in inputs.items():
        direction = rng.standard_normal(x.shape) if name != "grid_initial" else directions[name]
        terms = bar * state.jvp(**{name: direction})
        assert abs(np.vdot(bars[name], direction) - terms.sum()) < 1e-12 * np.abs(terms).sum(), name


@pytest.mark.slow
def test_a_subset_of_wrt_gives_what_all_of_it_gives(case):
    _, inputs, state, _, bar = case
    bars = state.vjp(bar)
    assert list(bars) == list(state.inputs)
    for name in inputs:
        np.testing.assert_array_equal(state.vjp(bar, [name])[name], bars[name])
    backwards = state.inputs[::-1]
    assert list(state.vjp(bar, backwards)) == list(backwards)
    assert not state.vjp(bar, [])
    with pytest.raises(InputError, match=r"nodes: no derivative in 'sail'; they depend on \w+"):
        state.vjp(bar, ["sail"])


@pytest.mark.slow
def test_equal_inputs_give_equal_bits_and_no_argument_is_written_to(case):
    at, inputs, state, directions, bar = case
    arrays = [*inputs.values(), *directions.values(), bar, state.nodes]
    before = [array.copy() for array in arrays]
    found = state.jvp(**directions), *state.vjp(bar).values()
    again = at(**inputs)
    np.testing.assert_array_equal(again.nodes, state.nodes)
    for one, two in zip(found, (again.jvp(**directions), *again.vjp(bar).values())):
        np.testing.assert_array_equal(one, two)
    for array, copy in zip(arrays, before):
        np.testing.assert_array_equal(array, copy)
