"""Numbers of control points follow what the splines miss of a grid."""

from itertools import count

import numpy as np
import pytest
from fit_cases import bend, fit_with, grid_of, lattice, two_blocks
from scipy.interpolate import BSpline

from bspline_mdao import fit_grid
from bspline_mdao.core.fit import closer_counts, fitting
from bspline_mdao.core.fit.closer_counts import CloserCounts, request_for
from bspline_mdao.core.fit.control_counts import choose_counts
from bspline_mdao.core.fit.edge_knots import edge_knots
from bspline_mdao.core.fit.fit_nodes import FitNodes
from bspline_mdao.core.fit.line_errors import class_errors, squared_errors
from bspline_mdao.core.fit.parameters import chord_length_parameters
from bspline_mdao.core.fit.settings import FITTING
from bspline_mdao.generators import Spacing, onera_m6_grid
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.sharing import direction_classes
from bspline_mdao.splines import fit_blocks


def kinked(n=(15, 25, 14)):
    """Two blocks whose thin, narrow cells follow a kink along j that spans of four cells cannot follow."""
    i, j, k = np.meshgrid(*(np.linspace(0, 1, m) for m in n), indexing="ij")
    x = 0.05 * i + np.abs(j - 0.37)
    first = np.stack([x, j, 0.01 * k**4], axis=-1)
    return grid_of(first, first + [0.0, 0.0, 0.01] * np.ones(3))


@pytest.mark.parametrize(("n_control", "order"), [(7, 4), (5, 3), (2, 2), (12, 4)])
def test_a_line_is_missed_by_what_least_squares_with_fixed_ends_miss(n_control, order):
    random = np.random.default_rng(n_control)
    parameters = np.concatenate([[0.0], np.sort(random.uniform(size=17)), [1.0]])
    nodes, knots = random.normal(size=(19, 3)), edge_knots(parameters, n_control, order)
    matrix = BSpline.design_matrix(parameters, knots, order - 1).toarray()
    points = np.zeros((n_control, 3))
    points[0], points[-1] = nodes[0], nodes[-1]
    points[1:-1] = np.linalg.lstsq(matrix[:, 1:-1], nodes - matrix @ points, rcond=None)[0]
    expected = ((nodes - matrix @ points) ** 2).sum(axis=1)
    np.testing.assert_allclose(squared_errors(nodes, parameters, knots, order), expected, rtol=1e-6, atol=1e-18)


def test_a_span_without_nodes_leaves_a_line_no_worse():
    nodes = bend(lattice(15, 1, 1))[:, 0, 0]
    parameters = np.concatenate([np.linspace(0, 0.2, 9), np.linspace(0.8, 1.0, 6)])
    knots = np.array([0, 0, 0, 0, 0.1, 0.3, 0.5, 0.6, 0.9, 1, 1, 1, 1])
    assert np.sqrt(squared_errors(nodes, parameters, knots, 4).max()) < 0.05


def errors_of(grid):
    topology = find_topology(grid)
    counts, classes = choose_counts(topology), direction_classes(topology)
    parameters = [chord_length_parameters(block.nodes) for block in grid.blocks]
    arguments = FitNodes.of(topology), grid.to_vector().reshape(-1, 3), parameters, counts.n_control, counts.orders
    return classes, class_errors(classes, range(classes.max() + 1), *arguments)


def test_classes_are_missed_along_the_directions_that_bend():
    classes, errors = errors_of(kinked())
    assert errors[classes[0, 1]] > 4.0
    np.testing.assert_allclose(errors[classes[0, [0, 2]]], 0.0, atol=1e-6)
    classes, errors = errors_of(two_blocks())
    assert (errors > 0.0).all()  # also those that the second block alone has
    _, larger = errors_of(two_blocks().with_vector(7.0 * two_blocks().to_vector()))
    np.testing.assert_allclose(larger, errors, rtol=1e-6)


@pytest.mark.slow
def test_directions_along_which_cells_are_missed_get_more_control_points_and_others_keep_theirs():
    grid = kinked()
    model, usual = fit_grid(grid), choose_counts(find_topology(grid)).n_control
    n_control = np.array([volume.n_control for volume in model.mesh.volumes])
    assert (n_control[:, 1] > usual[:, 1]).all()
    np.testing.assert_array_equal(n_control[:, [0, 2]], usual[:, [0, 2]])
    before = fit_grid(grid, n_control=[tuple(n) for n in usual])
    report = model.report
    assert report.raised.n_control_points == before.report.n_control_points < report.n_control_points
    np.testing.assert_allclose(report.raised.in_widths, before.report.worst_local.in_widths, rtol=1e-9)
    assert report.worst_local.in_widths < report.raised.in_widths
    assert before.report.raised is None
    blocks = fit_blocks(grid)
    assert blocks.report.worst_local == report.worst_local
    np.testing.assert_array_equal(fit_grid(grid).control_points, model.control_points)


@pytest.mark.slow
def test_a_grid_that_is_fitted_well_is_fitted_once(monkeypatch):
    def refuse(*arguments):
        raise AssertionError("looked for more control points")

    monkeypatch.setattr(fitting, "closer_counts", refuse)
    for grid in (onera_m6_grid((13, 17, 9)), two_blocks()):
        model = fit_grid(grid)
        usual = choose_counts(find_topology(grid)).n_control
        np.testing.assert_array_equal([volume.n_control for volume in model.mesh.volumes], usual)
        assert model.report.raised is None


@pytest.mark.slow
def test_a_grid_without_a_boundary_layer_keeps_its_numbers_whatever_it_misses():
    grid = onera_m6_grid((15, 17, 13))
    report = fit_grid(grid).report
    assert report.raised is None
    assert report.worst_local.in_widths > 8.0
    assert not report.warnings
    assert fit_grid(onera_m6_grid((15, 17, 13), Spacing(off_wall=1e-3))).report.raised


def test_numbers_that_are_asked_for_are_not_raised():
    usual = choose_counts(find_topology(kinked())).n_control
    model = fit_grid(kinked(), n_control={1: tuple(usual[0])})
    np.testing.assert_array_equal([volume.n_control for volume in model.mesh.volumes], usual)
    asked = fit_grid(kinked(), n_control=[tuple(n) for n in usual])
    assert asked.report.raised is None
    assert not asked.report.warnings


def test_more_control_points_that_miss_more_are_not_taken(monkeypatch):
    missed = count(5.0)
    monkeypatch.setattr(fitting, "_missed", lambda *arguments: next(missed))
    assert fit_grid(kinked()).report.raised is None
    assert next(missed) == 9.0  # all limits were tried


def test_more_control_points_that_leave_more_invalid_elements_are_not_taken(monkeypatch):
    numbers = count()
    monkeypatch.setattr(fitting, "count_invalid", lambda problem, solution: next(numbers))
    report = fit_grid(kinked()).report
    assert report.raised is None
    assert report.warnings[-1].endswith("no more control points along the lines that they miss come closer")


def test_what_a_mover_cannot_take_is_not_taken_and_can_be_typed(monkeypatch):
    found = []
    fit_with(monkeypatch, small_mesh=1, largest_factor=1, most_cells_per_span=4)
    monkeypatch.setattr(fitting, "warn_of_misses", lambda *arguments: found.append(arguments) or "said")
    report = fit_grid(kinked()).report
    assert report.raised is None
    assert report.warnings == ("said",)
    topology, counts, closer, missed = found[0]
    assert missed == report.worst_local.in_widths
    request = request_for(topology, counts, closer.counts.n_control)
    np.testing.assert_array_equal(choose_counts(topology, request).n_control, closer.counts.n_control)
    text = closer_counts.warn_of_misses(*found[0])
    assert all(f"--n-control {block}={'x'.join(map(str, n))}" in text for block, n in request.items())
    assert f"factors of {closer.factor_bytes / 1e9:.2g} GB" in text


def test_a_request_covers_all_classes_with_few_blocks():
    topology = find_topology(onera_m6_grid((13, 17, 9)))
    counts = choose_counts(topology)
    wanted = counts.n_control + np.where(counts.n_control >= 5, 1, 0)
    request = request_for(topology, counts, wanted)
    assert 0 < len(request) < len(topology.shapes)
    np.testing.assert_array_equal(choose_counts(topology, request).n_control, wanted)
    assert request_for(topology, counts, counts.n_control) == {}


def test_numbers_are_affordable_up_to_the_memory_of_a_factor():
    counts = choose_counts(find_topology(two_blocks()))
    sizes = [None, FITTING.largest_factor, FITTING.largest_factor + 1]
    assert [CloserCounts(counts, size).is_affordable() for size in sizes] == [True, True, False]
