"""Chord-length parameters and the knots made from them."""

import numpy as np
import pytest
from fit_cases import bend, lattice

from bspline_mdao.errors import InputError
from bspline_mdao.fit.edge_knots import edge_knots, knots_of_segment
from bspline_mdao.fit.parameters import chord_length_parameters
from bspline_mdao.splines.knots import BilinearKnots, ConstantKnots


def test_parameters_are_the_lengths_of_grid_lines():
    nodes = bend(lattice(5, 6, 4))
    parameters = chord_length_parameters(nodes)
    for d in range(3):
        steps = np.linalg.norm(np.diff(nodes, axis=d), axis=-1)
        lengths = np.cumsum(steps, axis=d) / steps.sum(axis=d, keepdims=True)
        np.testing.assert_allclose(parameters[..., d].take(range(1, nodes.shape[d]), d), lengths, atol=1e-15)


def test_ends_are_exact():
    parameters = chord_length_parameters(bend(lattice(7, 5, 6)))
    for d in range(3):
        assert (parameters[..., d].take(0, d) == 0).all()
        assert (parameters[..., d].take(-1, d) == 1).all()


def test_a_line_without_length_is_uniform():
    nodes = bend(lattice(5, 6, 4))
    nodes[:, 2, 3] = nodes[0, 2, 3]
    np.testing.assert_array_equal(chord_length_parameters(nodes)[:, 2, 3, 0], np.linspace(0, 1, 5))


def test_a_direction_of_one_node_has_parameter_zero():
    assert (chord_length_parameters(lattice(5, 1, 4))[..., 1] == 0).all()


def test_parameters_do_not_depend_on_size_or_place():
    nodes = bend(lattice(5, 6, 4))
    moved = chord_length_parameters(1e-3 * nodes + 7)
    np.testing.assert_allclose(moved, chord_length_parameters(nodes), atol=1e-10)


def test_edge_knots_hold_equal_numbers_of_nodes():
    parameters = np.linspace(0, 1, 45) ** 2
    knots = edge_knots(parameters, 15, 4)
    counts, _ = np.histogram(parameters, knots[3:16])
    assert counts.max() - counts.min() <= 1


def test_edge_knots_follow_the_formula_of_the_paper():
    rng = np.random.default_rng(4)
    parameters = np.concatenate([[0], np.sort(rng.random(17)), [1]])
    n_control, order, n_nodes = 9, 3, 19
    for i in range(order + 1, n_control + 1):
        place = (n_nodes - 1) / (n_control + 1 - order) * (i - order)
        q = min(int(np.floor(place)) + 1, n_nodes - 1)
        expected = (parameters[q] - parameters[q - 1]) * (place - (q - 1)) + parameters[q - 1]
        assert edge_knots(parameters, n_control, order)[i - 1] == pytest.approx(expected, abs=1e-15)


def test_coincident_nodes_still_give_increasing_knots():
    parameters = np.array([0, 0, 0, 0, 0, 0, 0.5, 0.5, 0.5, 1.0])
    assert (np.diff(edge_knots(parameters, 7, 2)[1:-1]) > 0).all()


def test_every_corner_of_bilinear_knots_is_its_edge():
    parameters = chord_length_parameters(bend(lattice(9, 8, 7)))
    knots = knots_of_segment(parameters, (6, 5, 4), (4, 3, 2))
    assert all(isinstance(k, BilinearKnots) for k in knots)
    ends = {0: 0, 1: -1}
    for s, t in np.ndindex(2, 2):
        # knots[1] is a function of (zeta, xi)
        edge = parameters[ends[t], :, ends[s], 1]
        np.testing.assert_array_equal(knots[1].corners[s, t], edge_knots(edge, 5, 3))


def test_constant_knots_are_the_mean_of_the_edges():
    parameters = chord_length_parameters(bend(lattice(9, 8, 7)))
    curved, constant = (knots_of_segment(parameters, (6, 5, 4), (4, 3, 2), kind) for kind in ("curved", "constant"))
    assert all(isinstance(k, ConstantKnots) for k in constant)
    np.testing.assert_allclose(constant[2].knots, curved[2].corners.mean(axis=(0, 1)))


def test_an_unknown_kind_of_knots_is_named():
    with pytest.raises(InputError, match='knots: "wavy" is unknown'):
        knots_of_segment(chord_length_parameters(lattice(5, 5, 5)), (4, 4, 4), (4, 4, 4), "wavy")
