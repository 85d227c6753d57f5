"""Knots that are functions of the user, from the fit to the regenerated grid; and fits of every order."""

import numpy as np
import openmdao.api as om
import pytest
from fit_cases import bend, bent_block, c_grid, grid_of, lattice, o_grid, two_blocks

from bspline_mdao import Fit, GridEvaluate, InputError, fit_grid
from bspline_mdao.core.fit.edge_knots import joined_corners, require_agreement
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.splines import BilinearKnots, FunctionKnots, embed_points, invert_points, require_inside


def bent_knots(order, n_control):
    """Uniform knots, bent by a wave of the other two parameters."""
    inner = np.arange(1, n_control - order + 1) / (n_control - order + 1)
    room = 0.2 * inner * (1 - inner)

    def value(s, t):
        return inner + room * np.sin(2 * s + t)[:, None]

    def gradient(s, t):
        slope = room * np.cos(2 * s + t)[:, None]
        return np.stack([2 * slope, slope], axis=-1)

    return FunctionKnots(order, n_control, value, gradient)


@pytest.fixture(scope="module")
def model():
    knots = tuple(bent_knots(4, n) for n in (7, 8, 6))
    return fit_grid(bent_block(), knots=[knots])


def test_the_mesh_has_the_knots_that_were_given(model):
    assert model.mesh.volumes[0].n_control == (7, 8, 6)
    assert all(isinstance(knots, FunctionKnots) for knots in model.mesh.volumes[0].knots)
    assert 0.0 < model.report.relative_rms < 2e-2


def test_the_baseline_comes_back_through_the_users_knots(model):
    grid = bent_block().to_vector()
    np.testing.assert_allclose(model.regenerate().to_vector(), grid, atol=1e-14)
    problem = om.Problem()
    problem.model.add_subsystem("fit", Fit(model=model), promotes=["*"])
    problem.model.add_subsystem("evaluate", GridEvaluate(model=model), promotes=["grid"])
    problem.model.connect("control_points_initial", "evaluate.control_points")
    problem.setup()
    problem.run_model()
    np.testing.assert_allclose(problem.get_val("grid"), grid, atol=1e-13)


def test_the_users_knots_hold_for_the_whole_family(model):
    fine = model.member(2.0)
    splines, finer = (
        each.evaluator().forward(each.control_points).reshape(*each.topology.shapes[0], 3) for each in (model, fine)
    )
    np.testing.assert_allclose(finer[::2, ::2, ::2], splines, atol=1e-14)
    np.testing.assert_allclose(
        fine.regenerate().blocks[0].nodes[::2, ::2, ::2], bent_block().blocks[0].nodes, atol=1e-14
    )


def test_points_ride_on_a_mesh_with_the_users_knots(model):
    points = bend(np.random.default_rng(5).uniform(0.2, 0.8, (20, 3)))
    inversion = require_inside(invert_points(model.mesh, model.control_points, points))
    turned = model.control_points[:, [1, 2, 0]]
    np.testing.assert_allclose(embed_points(model.mesh, inversion).forward(turned), points[:, [1, 2, 0]], atol=1e-12)


def test_a_grid_sampled_from_the_users_knots_is_recovered_to_round_off(model):
    # with the parameters of the model the least squares of its own points have its control points as their solution
    sampled = model.evaluator().forward(model.control_points)
    problem = om.Problem()
    problem.model.add_subsystem("fit", Fit(model=model), promotes=["*"])
    problem.setup()
    problem.set_val("grid_initial", sampled.ravel())
    problem.run_model()
    recovered = problem.get_val("control_points_initial").reshape(-1, 3)
    np.testing.assert_allclose(recovered, model.control_points, atol=1e-11)


def test_knots_of_the_wrong_number_of_segments_are_refused():
    knots = tuple(bent_knots(4, n) for n in (7, 8, 6))
    with pytest.raises(InputError, match=r"knots of 2 segments; give 1|each of the 1 segments"):
        fit_grid(bent_block(), knots=[knots, knots])


@pytest.mark.parametrize("order", range(2, 7))
def test_a_polynomial_block_is_fitted_exactly_at_every_order(order):
    xi = lattice(13, 12, 14, powers=(1, 1, 1))
    model = fit_grid(grid_of(xi @ np.array([[1.0, 0.2, 0.0], [0.1, 2.0, 0.3], [0.0, 0.4, 1.5]])), order=order)
    assert {volume.orders for volume in model.mesh.volumes} == {(order,) * 3}
    assert max(model.report.max_error) < 1e-13


def test_the_error_falls_with_the_order():
    errors = [fit_grid(bent_block((17, 17, 17)), order=p, n_control=(7, 7, 7)).report.rms for p in (2, 3, 4)]
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


def chosen_knots(grid):
    """Knots that a fit chooses for every segment, as the user may give them."""
    return [list(volume.knots) for volume in fit_grid(grid).mesh.volumes]


@pytest.mark.slow
@pytest.mark.parametrize("make", [two_blocks, o_grid, c_grid])
def test_knots_that_agree_across_interfaces_are_taken(make):
    chosen, given = fit_grid(make()), fit_grid(make(), knots=chosen_knots(make()))
    np.testing.assert_array_equal(given.control_points, chosen.control_points)


def bent(knots, a, b):
    """The same knots with one inner knot of one edge moved by a tenth of its span."""
    corners = knots.corners.copy()
    corners[a, b, knots.order] += 0.1 * (corners[a, b, knots.order + 1] - corners[a, b, knots.order])
    return BilinearKnots(corners, knots.order)


def test_knots_that_disagree_on_a_permuted_interface_are_refused_with_blocks_faces_and_directions():
    names = {1: r"block 1 imax in j and block 2 jm(in|ax) in k", 2: r"block 1 imax in k and block 2 jm(in|ax) in i"}
    for d, (a, b) in {1: (0, 1), 2: (1, 0)}.items():
        # knots of j depend on (k, i), those of k on (i, j): an edge at i = 1
        knots = chosen_knots(two_blocks())
        knots[0][d] = bent(knots[0][d], a, b)
        with pytest.raises(
            InputError, match=rf"splines of {names[d]}.* meet with knots that differ, number .* most"
        ) as error:
            fit_grid(two_blocks(), knots=knots)
        assert "\n" not in str(error.value)


def test_knots_that_differ_away_from_interfaces_are_taken():
    knots = chosen_knots(two_blocks())
    knots[0][1] = bent(knots[0][1], 0, 0)  # the edge k = 0, i = 0 of block 1
    knots[0][0] = bent(knots[0][0], 1, 1)  # the direction that leaves the interface
    assert fit_grid(two_blocks(), knots=knots).report.relative_rms < 0.1


def test_an_interface_that_runs_backwards_wants_its_knots_turned_round():
    grid = turned_blocks()
    knots = chosen_knots(grid)
    fit_grid(grid, knots=knots)
    knots[1][1] = BilinearKnots(knots[0][1].corners[:, ::-1], knots[0][1].order)  # the edges of block 1, not turned
    with pytest.raises(InputError, match="block 1 imax in j and block 2 imin in j, which run against each other"):
        fit_grid(grid, knots=knots)


def test_a_c_grid_wants_the_knots_of_its_wake_to_agree_with_themselves():
    grid = c_grid(n_along=9)
    knots = chosen_knots(grid)
    knots[0][2] = bent(knots[0][2], 0, 0)  # k on the wake, jmin, at its far end
    with pytest.raises(InputError, match=r"block 1 \(.*\) jmin in k and block 1 \(.*\) jmin in k"):
        fit_grid(grid, knots=knots)


def waved_knots(height):
    """Two inner knots that a wave moves between the edges, where s is neither 0 nor 1."""
    inner = np.array([0.3, 0.7])
    return FunctionKnots(
        order=4,
        n_control=6,
        value=lambda s, t: inner + height * np.sin(np.pi * s)[:, None],
        gradient=lambda s, t: np.stack([height * np.pi * np.cos(np.pi * s) + [[0], [0]], 0 * s + [[0], [0]]]).T,
    )


def test_knots_that_are_functions_are_compared_between_their_edges_too():
    grid = grid_of(bend(lattice(9, 8, 7)), bend(lattice(9, 8, 7) + [1, 0, 0]))
    plain, wavy = waved_knots(0.0), waved_knots(0.05)
    fit_grid(grid, knots=[(plain, plain, plain), (wavy, plain, plain)])
    with pytest.raises(InputError, match="block 1 imax in j and block 2 imin in j meet with knots that differ"):
        fit_grid(grid, knots=[(plain, plain, plain), (plain, wavy, plain)])


def test_orders_and_numbers_that_come_with_knots_have_to_agree_too():
    knots = chosen_knots(two_blocks())
    other = fit_grid(two_blocks(), order=[(4, 3, 4), (4, 4, 3)]).mesh.volumes[1].knots
    with pytest.raises(InputError, match=r"block 1 imax in j and block 2 jm(in|ax) in k.* meet with orders 4 and 3"):
        fit_grid(two_blocks(), knots=[knots[0], other])
    more = fit_grid(two_blocks(), n_control=[(5, 7, 6), (6, 8, 7)]).mesh.volumes[1].knots
    with pytest.raises(InputError, match=r"meet with \d and \d control points"):
        fit_grid(two_blocks(), knots=[knots[0], more])


@pytest.mark.slow
@pytest.mark.parametrize("knots", ["curved", "constant"])
@pytest.mark.parametrize("make", [two_blocks, o_grid, c_grid, lambda: onera_m6_grid((9, 14, 11))])
def test_chosen_knots_agree_along_all_interfaces(make, knots):
    model = fit_grid(make(), knots=knots)
    require_agreement(model.topology, model.mesh.volumes)


def turned_blocks():
    """Two blocks that share a face, the second with j backwards."""
    return grid_of(bend(lattice(9, 13, 11)), bend(lattice(15, 13, 11) + [1, 0, 0])[:, ::-1].copy())


def test_constant_knots_are_the_mean_of_all_edges_that_interfaces_join():
    chosen = [[knots.corners.mean(axis=(0, 1)) for knots in triple] for triple in chosen_knots(turned_blocks())]
    first, second = (volume.knots for volume in fit_grid(turned_blocks(), knots="constant").mesh.volumes)
    np.testing.assert_allclose(first[1].knots, (chosen[0][1] + 1 - chosen[1][1][::-1]) / 2, atol=1e-15)
    np.testing.assert_allclose(second[1].knots, 1 - first[1].knots[::-1], atol=1e-15)
    np.testing.assert_allclose(first[0].knots, chosen[0][0], atol=1e-15)
    np.testing.assert_allclose(second[2].knots, (chosen[0][2] + chosen[1][2]) / 2, atol=1e-15)


@pytest.mark.parametrize("make", [turned_blocks, c_grid])
def test_joining_edges_is_affine_and_its_linear_part_symmetric(make):
    rng, model = np.random.default_rng(8), fit_grid(make())
    corners = [[k.corners for k in volume.knots] for volume in model.mesh.volumes]
    u, v = ([[rng.standard_normal(c.shape) for c in triple] for triple in corners] for _ in range(2))
    moved = [[c + d for c, d in zip(*pair)] for pair in zip(corners, u)]
    joined, again = (joined_corners(model.topology, c, is_change=False) for c in (corners, moved))
    change, bar = joined_corners(model.topology, u), joined_corners(model.topology, v)

    def flat(arrays):
        return np.concatenate([array.ravel() for triple in arrays for array in triple])

    np.testing.assert_allclose(flat(again) - flat(joined), flat(change), atol=1e-14)
    assert flat(v) @ flat(change) == pytest.approx(flat(bar) @ flat(u), rel=1e-12)
