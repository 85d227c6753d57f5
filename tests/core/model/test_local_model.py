"""Local models: the nodes of every process have the bits of the whole grid, their derivatives add up."""

import pickle
from functools import cache

import numpy as np
import pytest
from periodic_cases import cut_passage
from scipy.spatial.transform import Rotation
from topology_cases import c_grid, grid_of, o_grid, smooth_box, split, twelve_block_plate

from bspline_mdao import fit_grid, read_grid
from bspline_mdao.core.generators.wing_spacing import Spacing
from bspline_mdao.core.mesh.surface import SurfaceGrid
from bspline_mdao.core.model.local_model import rows_of_subdomain
from bspline_mdao.core.model.model import nodes_at
from bspline_mdao.errors import InputError
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.node_numbering import NodeNumbering
from bspline_mdao.grids.topology.partition import Partition, Subdomain


def wing(**options):
    """A wing with a viscous wall, a plane of symmetry and a residual."""
    grid = onera_m6_grid((13, 12, 9), Spacing(off_wall=1e-5))
    return fit_grid(grid, n_control=(7, 6, 5), order=(4, 3, 4), **options)


def section():
    """A single block of several segments around a section with thin cells."""
    thin = np.unique(np.rint(200 * np.linspace(0.0, 1.0, 19) ** 2)).astype(int)
    nodes = c_grid(n_wake=8, n_wing=16, n_off=201, n_span=2)[:, :, thin]
    whole = Window.whole(0, nodes.shape[:3])
    wall = Patch("section", "wall", (Window(0, (8, 0, 0), (40, 1, 0)),))
    rim = Patch("rim", "farfield", (whole.face(5), whole.face(0), whole.face(1)))
    sides = Patch("sides", "symmetry", (whole.face(2), whole.face(3)))
    return fit_grid(Grid((Block(nodes, "block 1"),), (wall, rim, sides)))


MODELS = {
    "wing": wing,
    "no residual": lambda: wing(keep_residual=False),
    "linear": lambda: wing(wall_layer=False),
    "section": section,
    "axis": lambda: fit_grid(grid_of(o_grid(radius=0.0)), n_control=(9, 4, 4), order=3),
    "no kinds": lambda: fit_grid(grid_of(*split(smooth_box(12, 9, 8), [5], [4], [])), n_control=5),
    "passage": lambda: fit_grid(cut_passage()),
    "plate": lambda: fit_grid(twelve_block_plate(), n_control=4, order=3),
}


@cache
def model_of(name):
    return MODELS[name]()


@pytest.fixture(scope="module", params=MODELS)
def model(request):
    return model_of(request.param)


@cache
def baseline_of(model):
    """Nodes of the whole grid."""
    return model.regenerate().to_vector().reshape(-1, 3)


def moved(model, rng, size=1e-4):
    turn = Rotation.from_rotvec(0.2 * rng.standard_normal(3)).as_matrix()
    return model.control_points @ turn.T + size * rng.standard_normal(model.control_points.shape)


def local_models_of(model, n_ranks):
    partition = Partition.of(model.topology, n_ranks)
    return [model.local_model(partition.subdomain(rank)) for rank in range(n_ranks)]


@pytest.mark.parametrize("n_ranks", [1, 2, 5])
def test_every_process_has_the_bits_of_the_whole_grid(model, n_ranks):
    points = moved(model, np.random.default_rng(n_ranks))
    expected = model.grid_map().at(points).nodes
    baseline = baseline_of(model)
    for local in local_models_of(model, n_ranks):
        rows = local.subdomain.rows
        assert local.regenerate(points).tobytes() == expected[rows].tobytes()
        assert local.regenerate().tobytes() == baseline[rows].tobytes()


@pytest.mark.parametrize("n_ranks", [2, 3])
def test_derivatives_are_those_of_the_whole_grid_and_add_up(model, n_ranks):
    rng = np.random.default_rng(n_ranks)
    points, step = moved(model, rng), rng.standard_normal(model.control_points.shape)
    state, total = model.grid_map().at(points), 0.0
    change, bar = state.jvp(step), np.zeros((model.n_nodes, 3))
    for local in local_models_of(model, n_ranks):
        grid_map, rows = local.grid_map(), local.subdomain.rows
        own = grid_map.at(points)
        np.testing.assert_allclose(own.jvp(step)[: len(rows)], change[rows], rtol=0, atol=1e-13 * np.abs(change).max())
        seed = np.zeros((grid_map.numbering.n_nodes, 3))
        seed[: len(rows)] = rng.standard_normal((len(rows), 3))
        np.add.at(bar, rows, seed[: len(rows)])
        total = total + own.vjp(seed)["control_points"]
    expected = state.vjp(bar)["control_points"]
    np.testing.assert_allclose(total, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("n_ranks", [1, 3])
@pytest.mark.parametrize("name", ["wing", "section", "linear"])
def test_walls_that_are_given_have_the_bits_of_the_whole_grid(name, n_ranks):
    model, rng = model_of(name), np.random.default_rng(n_ranks)
    surface, points = SurfaceGrid.of(model), moved(model, rng)
    wall = surface.points + 1e-3 * rng.standard_normal(surface.points.shape)
    grid_map, correction = model.corrected_map(surface.rows, model)
    state, bar = grid_map.meeting(correction).at(points, wall), np.zeros((model.n_nodes, 3))
    total = dict.fromkeys(state.inputs, 0.0)
    partition = Partition.of(model.topology, n_ranks)
    subdomains = [
        *map(partition.subdomain, range(n_ranks)),
        Subdomain.of_rows(rng.integers(model.n_nodes, size=9), model.n_nodes),
    ]
    for local in map(model.local_model, subdomains):
        rows = local.subdomain.rows
        grid_map, own = local.corrected_map(surface.rows, model)
        found = grid_map.meeting(own).at(points, wall)
        assert found.nodes[: len(rows)].tobytes() == state.nodes[rows].tobytes()
        seed = rng.standard_normal((len(rows), 3))
        np.add.at(bar, rows, seed)
        total = {name: total[name] + part for name, part in found.vjp(grid_map.padded(seed)).items()}
    for name, expected in state.vjp(bar).items():
        np.testing.assert_allclose(total[name], expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.slow
def test_a_correction_of_whole_blocks_needs_no_nodes_of_others():
    model = model_of("wing")
    rows = SurfaceGrid.of(model).rows
    for local in local_models_of(model, 3):
        grid_map, _ = local.corrected_map(rows, model)
        assert grid_map.numbering.n_nodes <= 1.15 * local.grid_map().numbering.n_nodes


def test_a_whole_model_is_the_local_model_of_a_process_that_is_alone(model):
    alone, points = model.part(Subdomain.of_grid(model.topology)), moved(model, np.random.default_rng(3))
    assert model.ownership is None
    assert alone.ownership.is_grid
    for control_points in (None, points):
        assert alone.local_nodes(control_points).tobytes() == model.local_nodes(control_points).tobytes()
    rows = np.random.default_rng(4).permutation(model.n_nodes)
    held = NodeNumbering.of(model.topology, rows)
    assert all(map(np.array_equal, alone.parameters_of(held), model.parameters_of(held)))
    for one in (alone, model):
        assert one.n_nodes == model.n_nodes
        assert one.fits(alone.subdomain)
        assert np.array_equal(one.residual_at(rows), model.residual_at(rows))


def test_a_local_model_is_taken_for_its_own_nodes_alone(model):
    first, second = local_models_of(model, 2)
    assert first.part(first.ownership) is first
    assert first.fits(first.subdomain)
    assert not first.fits(second.subdomain)
    with pytest.raises(InputError, match="of another subdomain than the partition's; leave the partition out"):
        first.part(second.subdomain)


def test_a_local_model_of_a_solvers_rows_has_the_bits_of_the_grid(model):
    rng = np.random.default_rng(7)
    points, rows = moved(model, rng), rng.integers(model.n_nodes, size=200)
    local = model.local_model(Subdomain.of_rows(rows, model.n_nodes))
    assert local.regenerate(points).tobytes() == model.grid_map().at(points).nodes[rows].tobytes()


def test_a_local_model_without_nodes_has_none(model):
    local = model.local_model(Subdomain.of_rows([], model.n_nodes))
    assert local.regenerate(moved(model, np.random.default_rng(1))).shape == (0, 3)
    assert local.grid_map().at(model.control_points).jvp(model.control_points).shape[1] == 3


@pytest.mark.slow
def test_what_a_local_model_knows_falls_with_the_number_of_processes():
    model = fit_grid(onera_m6_grid((25, 24, 21)), n_control=7)
    one, four = (max(local.n_bytes for local in local_models_of(model, n)) for n in (1, 4))
    boundary = len(rows_of_subdomain(model.topology, Subdomain.of_rows([], model.n_nodes)))
    assert four < one / 4 + 1.4 * 56 * boundary


def test_a_local_model_survives_pickling(model):
    local = local_models_of(model, 2)[1]
    points = moved(model, np.random.default_rng(2))
    expected = local.regenerate(points)
    assert pickle.loads(pickle.dumps(local)).regenerate(points).tobytes() == expected.tobytes()


def test_nodes_are_found_by_their_rows(model):
    rows = np.random.default_rng(3).permutation(model.n_nodes)[:50]
    expected = model.regenerate().to_vector().reshape(-1, 3)[rows]
    assert nodes_at(model, rows).tobytes() == expected.tobytes()


def test_nodes_that_a_local_model_does_not_know_are_refused():
    model = fit_grid(grid_of(smooth_box(12, 9, 8)), n_control=5)
    low, high = local_models_of(model, 2)
    with pytest.raises(InputError, match="is not in this process's part of the model"):
        nodes_at(low, np.array([(9 * 9 + 4) * 8 + 4]))
    assert nodes_at(high, np.array([(9 * 9 + 4) * 8 + 4])).shape == (1, 3)


def test_a_local_model_of_another_grid_is_refused():
    model = fit_grid(grid_of(smooth_box(12, 9, 8)), n_control=5)
    with pytest.raises(InputError, match="a subdomain of a grid of 8 nodes, but it has 864"):
        model.local_model(Subdomain.of_rows([0], 8))


@pytest.mark.slow
def test_local_models_of_a_real_grid_have_its_bits(real_grids):
    model = fit_grid(read_grid(real_grids / "pyhyp_m6_9blocks.xyz"))
    points = moved(model, np.random.default_rng(5), size=1e-6)
    expected = model.grid_map().at(points).nodes
    for local in local_models_of(model, 3):
        assert local.regenerate(points).tobytes() == expected[local.subdomain.rows].tobytes()
