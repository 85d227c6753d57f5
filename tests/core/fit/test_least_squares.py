"""Least squares: exactness, sharing, transposes and the optimum."""

import numpy as np
import pytest
from fit_cases import ALL_SHAPES, bend, bent_block, grid_of, lattice, o_grid, two_blocks, wedge

from bspline_mdao.core.fit import least_squares
from bspline_mdao.core.fit.control_counts import choose_counts
from bspline_mdao.core.fit.design_matrix import build_design_matrix
from bspline_mdao.core.fit.fitting import fit_grid, set_up_fit
from bspline_mdao.core.fit.least_squares import ReferenceNet, greville_sampling
from bspline_mdao.core.fit.parameters import chord_length_parameters
from bspline_mdao.core.fit.problem import problem_of_mesh, solve_fit
from bspline_mdao.core.fit.quasi_interpolant import greville_places
from bspline_mdao.core.splines.volume import evaluate
from bspline_mdao.errors import InputError
from bspline_mdao.grids.topology.detection import find_topology


def segment_parameters(grid, topology):
    """Chord length parameters of the nodes of every segment."""
    return [chord_length_parameters(grid.blocks[w.block].nodes[w.slices]) for w in topology.segments]


def dense_matrix(volume, parameters):
    """The matrix of Eq. (3), column by column."""
    columns = np.eye(int(np.prod(volume.n_control))).reshape(*volume.n_control, -1)
    return evaluate(volume, columns, parameters.reshape(-1, 3))


@pytest.mark.parametrize("orders", [(4, 4, 4), (2, 3, 5), (6, 4, 1)])
def test_products_with_the_design_matrix_agree_with_the_mapping(orders):
    rng = np.random.default_rng(7)
    grid = bent_block((12, 13, 14))
    parameters = segment_parameters(grid, find_topology(grid))[0]
    n_control = [n if p > 1 else 1 for n, p in zip((7, 8, 9), orders)]
    volume = set_up_fit(find_topology(grid), [parameters], [n_control], [orders]).mesh.volumes[0]
    matrix, dense = build_design_matrix(volume, parameters.reshape(-1, 3)), dense_matrix(volume, parameters)
    b, r = rng.standard_normal((dense.shape[1], 3)), rng.standard_normal((dense.shape[0], 3))
    np.testing.assert_allclose(matrix.apply(b), dense @ b, atol=1e-12)
    np.testing.assert_allclose(matrix.apply_transpose(r), dense.T @ r, atol=1e-11)


@pytest.mark.parametrize("is_banded", [False, True])
def test_gram_matrix_holds_the_lower_half(is_banded):
    grid = bent_block((12, 13, 14))
    parameters = segment_parameters(grid, find_topology(grid))[0]
    volume = set_up_fit(find_topology(grid), [parameters], [(5, 9, 4)], [(3, 2, 4)]).mesh.volumes[0]
    matrix, dense = build_design_matrix(volume, parameters.reshape(-1, 3)), dense_matrix(volume, parameters)
    columns = np.full(180, -1)
    columns[20:150] = np.arange(130)
    expected = dense[:, 20:150].T @ dense[:, 20:150]
    width = matrix.bandwidth(columns)
    i, j = np.nonzero(np.tril(expected))
    assert width == (i - j).max()
    stored = matrix.gram(columns, 130, width if is_banded else None)
    np.testing.assert_allclose(stored[j, i - j] if is_banded else stored[j, i], expected[i, j], atol=1e-12)


def problem_of(grid, n_control=None):
    topology = find_topology(grid)
    parameters = segment_parameters(grid, topology)
    counts = choose_counts(topology, n_control, 4)
    problem = set_up_fit(topology, parameters, counts.n_control, counts.orders)
    return problem, parameters, grid.to_vector().reshape(-1, 3)


@pytest.mark.parametrize("shape", ALL_SHAPES)
def test_entities_of_a_round_know_nothing_of_each_other(shape):
    problem, _, _ = problem_of(ALL_SHAPES[shape]())
    is_known, n_entities = np.zeros(problem.mesh.n_control_points, bool), 0
    for entities in problem.rounds():
        for entity in entities:
            is_local = np.isin(entity.control_ids, entity.unknown_ids)
            assert is_known[entity.control_ids[~is_local]].all()
        unknown = np.concatenate([entity.unknown_ids for entity in entities])
        assert len(np.unique(unknown)) == len(unknown)
        is_known[unknown] = True
        n_entities += len(entities)
    assert is_known.all()
    assert n_entities == len(problem.entities) > 8


@pytest.mark.parametrize("shape", ALL_SHAPES)
def test_a_fit_has_the_same_bits_on_any_number_of_threads(shape, monkeypatch):
    problem, parameters, nodes = problem_of(ALL_SHAPES[shape]())
    solutions = []
    for n_threads in (1, 2, 5):
        monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", n_threads)
        assert problem.n_threads == n_threads
        solutions.append(solve_fit(problem, parameters, nodes))
    for other in solutions[1:]:
        np.testing.assert_array_equal(other.control_points, solutions[0].control_points)
        np.testing.assert_array_equal(other.fitted, solutions[0].fitted)


def test_threads_of_a_fit_share_the_memory_of_one_gram_matrix(monkeypatch):
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 8)
    monkeypatch.setattr("bspline_mdao.core.fit.problem.LARGEST_GRAM", 2**20)
    problem, _, _ = problem_of(bent_block((12, 13, 14)), (9, 8, 10))
    assert 8 * problem.n_threads * (7 * 6 * 8) ** 2 <= 2**20


@pytest.mark.slow
@pytest.mark.parametrize("shape", ALL_SHAPES)
@pytest.mark.parametrize("orders", [(4, 4, 4), (2, 3, 5)])
def test_a_grid_sampled_from_splines_is_recovered_to_round_off(shape, orders):
    rng = np.random.default_rng(3)
    grid = ALL_SHAPES[shape]()
    topology = find_topology(grid)
    if len(topology.segments) > 1:
        orders = (3, 3, 3) if orders[0] == 2 else orders
    model = fit_grid(grid, topology=topology, order=orders)
    problem = problem_of_mesh(topology, model.mesh)
    control_points = model.control_points + 0.01 * rng.standard_normal(model.control_points.shape)
    sampled = np.full((topology.n_nodes, 3), np.nan)
    for volume, net, x, rows in zip(
        model.mesh.volumes, model.mesh.nets(control_points), model.parameters, problem.sharing.rows
    ):
        sampled[rows.ravel()] = evaluate(volume, net, x.reshape(-1, 3))
    solution = solve_fit(problem, model.parameters, sampled)
    assert not solution.warnings
    np.testing.assert_allclose(solution.fitted, sampled, atol=3e-12)
    np.testing.assert_allclose(solution.control_points, control_points, atol=1e-9)


@pytest.mark.parametrize("shape", ALL_SHAPES)
def test_fitted_points_are_the_splines_of_the_control_points(shape):
    grid = ALL_SHAPES[shape]()
    model = fit_grid(grid)
    fitted = grid.to_vector().reshape(-1, 3) - model.residual
    rows = problem_of_mesh(model.topology, model.mesh).sharing.rows
    for volume, net, x, r in zip(model.mesh.volumes, model.mesh.nets(model.control_points), model.parameters, rows):
        np.testing.assert_allclose(evaluate(volume, net, x.reshape(-1, 3)), fitted[r.ravel()], atol=1e-12)


@pytest.mark.parametrize("shape", ALL_SHAPES)
def test_shared_nodes_are_fitted_bit_for_bit_alike(shape):
    grid = ALL_SHAPES[shape]()
    model = fit_grid(grid, n_control=None)
    copies = problem_of_mesh(model.topology, model.mesh).sharing.copies
    fitted = grid.to_vector().reshape(-1, 3) - model.residual
    np.testing.assert_allclose(fitted[copies[:, 0]], fitted[copies[:, 1]], atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ALL_SHAPES)
@pytest.mark.parametrize("is_mixed", [False, True])
def test_the_transpose_passes_the_dot_test(shape, is_mixed):
    rng = np.random.default_rng(8)
    model = fit_grid(ALL_SHAPES[shape]())
    weights = rng.dirichlet(np.ones(6), model.report.n_control_points) if is_mixed else None
    operator = problem_of_mesh(model.topology, model.mesh).operator(model.parameters, weights)
    x = rng.standard_normal((operator.n_nodes, 3))
    b = rng.standard_normal((operator.n_control_points, 3))
    forward, reverse = np.vdot(b, operator.forward(x)), np.vdot(operator.adjoint(b), x)
    scale = np.linalg.norm(b) * np.linalg.norm(operator.forward(x))
    assert abs(forward - reverse) < 1e-12 * scale


def test_the_operator_repeats_the_fit():
    grid = two_blocks()
    model = fit_grid(grid)
    operator = problem_of_mesh(model.topology, model.mesh).operator(model.parameters)
    np.testing.assert_array_equal(operator.forward(grid.to_vector().reshape(-1, 3)), model.control_points)


def test_two_fits_give_the_same_bits():
    first, second = (fit_grid(o_grid()) for _ in range(2))
    np.testing.assert_array_equal(first.control_points, second.control_points)
    np.testing.assert_array_equal(first.residual, second.residual)


def test_corners_are_interpolated():
    grid = bent_block()
    model = fit_grid(grid)
    net, nodes = model.mesh.nets(model.control_points)[0], grid.blocks[0].nodes
    ends = np.ix_([0, -1], [0, -1], [0, -1])
    np.testing.assert_array_equal(net[ends], nodes[ends])


def test_the_sequence_of_entities_is_within_two_percent_of_the_optimum():
    grid = grid_of(bend(lattice(33, 31, 29) ** 1.2))
    model = fit_grid(grid, n_control=(12, 10, 11))
    nodes, matrix = (
        grid.to_vector().reshape(-1, 3),
        build_design_matrix(model.mesh.volumes[0], model.parameters[0].reshape(-1, 3)),
    )
    gram = matrix.gram(np.arange(matrix.shape[1]), matrix.shape[1], None)
    gram += np.triu(gram, 1).T
    optimum = nodes - matrix.apply(np.linalg.solve(gram, matrix.apply_transpose(nodes)))
    rms = np.sqrt((optimum**2).sum(axis=1).mean())
    assert rms <= model.report.rms <= 1.02 * rms


def test_spans_without_nodes_lean_on_the_boundary_and_are_reported():
    nodes = bend(lattice(12, 9, 8))
    parameters = [np.clip(lattice(12, 9, 8, powers=(1, 1, 1)), 0, 1)]
    inside = parameters[0][1:-1, 1:-1, 1:-1, 0]
    inside[:] = 0.5 * inside  # the nodes inside leave the upper spans in xi empty
    topology = find_topology(grid_of(nodes))
    problem = set_up_fit(topology, segment_parameters(grid_of(nodes), topology), [(9, 5, 5)], [(4, 4, 4)])
    solution = solve_fit(problem, parameters, nodes.reshape(-1, 3))
    assert "block 1 interior" in solution.warnings[0]
    assert np.abs(solution.control_points).max() < 10


def test_the_reference_net_reproduces_grids_that_are_linear_in_their_indices():
    nodes = lattice(9, 13, 11, powers=(1, 1, 1))
    rows = np.arange(nodes[..., 0].size).reshape(nodes.shape[:3])
    axes = [greville_places(*line) / (line[0] - 1) for line in ((9, 6, 4), (13, 7, 3), (11, 5, 2))]
    reference = ReferenceNet.of(axes, greville_sampling(rows, (6, 7, 5), (4, 3, 2), rows.size))
    expected = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(reference.net(nodes.reshape(-1, 3), expected), expected, atol=1e-14)
    moved = reference.net(nodes.reshape(-1, 3), expected + [1, 2, 3])
    np.testing.assert_allclose(moved, expected + [1, 2, 3], atol=1e-14)


def test_transfinite_interpolation_reproduces_a_tensor_lattice_and_has_its_transpose():
    rng = np.random.default_rng(2)
    net = lattice(5, 6, 4)
    for shape in ((5, 6, 4, 3), (5, 1, 4, 3), (1, 1, 6, 3)):
        places = [np.concatenate([[0], np.sort(rng.random(n - 2)), [1]]) if n > 1 else np.zeros(1) for n in shape[:3]]
        reference = ReferenceNet.of(places)
        if shape == net.shape:
            np.testing.assert_allclose(reference.net(None, net.reshape(-1, 3)), net.reshape(-1, 3), atol=1e-15)
        a, b = rng.standard_normal((2, np.prod(shape[:3]), 3))
        forward, reverse = reference.net(None, a), reference.net_transpose(b, None)
        difference = np.vdot(b, forward) - np.vdot(reverse, a)
        assert abs(difference) < 1e-13 * np.linalg.norm(a) * np.linalg.norm(b)


def test_a_gram_matrix_beyond_memory_is_refused(monkeypatch):
    monkeypatch.setattr(least_squares, "LARGEST_GRAM", 1000)
    with pytest.raises(InputError, match=r"block 1 face imin.*use fewer, or split the block"):
        fit_grid(bent_block())


BAD_OPTIONS = [
    ({"corrections": -1}, "cycles"),
    ({"corrections": 1.5}, "whole number of cycles"),
    ({"method": "smooth"}, 'method "smooth" is unknown; use one of valid, least_squares, quasi_interpolant'),
    ({"knots": None}, "curved"),
    ({"knots": "straight"}, "straight"),
    ({"topology": find_topology(bent_block((4, 5, 6)))}, "other blocks"),
]


@pytest.mark.parametrize(("options", "word"), BAD_OPTIONS)
def test_bad_options_are_an_error(options, word):
    with pytest.raises(InputError, match=word):
        fit_grid(wedge(), **options)


def test_progress_rises_to_one():
    seen = []
    fit_grid(wedge(), progress=lambda fraction, what: seen.append(fraction))
    assert seen[-1] == 1.0
    assert seen == sorted(seen)
