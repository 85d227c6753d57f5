"""Chord-length parameters and the knots made from them."""

import numpy as np
import pytest
from fit_cases import bend, bent_block, c_grid, grid_of, lattice, o_grid, two_blocks

from bspline_mdao import FittedModel, fit_grid, write_grid
from bspline_mdao.core.fit.edge_knots import edge_knots, knots_of_segment
from bspline_mdao.core.fit.parameters import chord_length_parameters
from bspline_mdao.core.splines.knots import BilinearKnots, ConstantKnots
from bspline_mdao.errors import InputError
from bspline_mdao.studio.cli.main import run


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


KINDS = ("chord_length", "centripetal", "uniform")


def wavy_parameters(shape):
    """Parameters that nobody would choose: powers of the index, turned a little by the other two."""
    axes = np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij")
    return np.stack(
        [x + 0.2 * x * (1 - x) * np.cos(y + z) for x, y, z in (axes, axes[1:] + axes[:1], axes[2:] + axes[:2])], -1
    )


def parameters_along(grid, kind):
    return fit_grid(grid, parametrization=kind).parameters[0]


def test_centripetal_parameters_are_sums_of_roots_and_uniform_ones_go_with_the_index():
    grid = bent_block((9, 8, 7))
    steps = np.sqrt(np.linalg.norm(np.diff(grid.blocks[0].nodes, axis=1), axis=-1))
    found = parameters_along(grid, "centripetal")[:, 1:, :, 1]
    np.testing.assert_allclose(found, np.cumsum(steps, axis=1) / steps.sum(axis=1, keepdims=True), atol=1e-15)
    uniform = parameters_along(grid, "uniform")
    np.testing.assert_array_equal(uniform[..., 2], np.broadcast_to(np.arange(7) / 6, (9, 8, 7)))
    assert parameters_along(grid, "chord_length").tobytes() == fit_grid(grid).parameters[0].tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("make", [two_blocks, o_grid, c_grid])
def test_every_parametrization_fits_keeps_the_grid_and_takes_corrections(make, kind, tmp_path):
    grid = make()
    plain, corrected = (fit_grid(grid, parametrization=kind, corrections=n) for n in (0, 1))
    assert corrected.report.rms < plain.report.rms
    assert plain.report.relative_rms < 0.3
    plain.save(tmp_path / "m.h5")
    loaded = FittedModel.load(tmp_path / "m.h5")
    assert loaded.settings == plain.settings
    assert loaded.settings.parametrization == kind
    np.testing.assert_allclose(loaded.regenerate().to_vector(), grid.to_vector(), atol=1e-13)


def test_given_parameters_are_taken_to_the_last_bit():
    given = wavy_parameters((13, 17, 11))
    model = fit_grid(bent_block(), parametrization=[given])
    np.testing.assert_array_equal(model.parameters[0], given)
    assert model.settings.parametrization == "given"
    assert model.report.relative_rms < 0.1


def test_parameters_that_a_fit_chose_may_be_given_for_blocks_or_segments():
    chosen = fit_grid(two_blocks(), parametrization="centripetal")
    given = fit_grid(two_blocks(), parametrization=chosen.parameters)
    np.testing.assert_array_equal(given.control_points, chosen.control_points)
    cut = fit_grid(c_grid())
    assert len(cut.parameters) == 3
    np.testing.assert_array_equal(fit_grid(c_grid(), parametrization=cut.parameters).control_points, cut.control_points)


def test_parameters_of_a_block_that_is_cut_are_stretched_over_its_parts():
    whole = chord_length_parameters(c_grid().blocks[0].nodes)
    cut, given = fit_grid(c_grid()), fit_grid(c_grid(), parametrization=[whole])
    assert len(given.parameters) == 3
    for mine, other in zip(given.parameters, cut.parameters):
        np.testing.assert_allclose(mine, other, atol=1e-13)


@pytest.mark.slow
def test_given_parameters_give_shared_nodes_one_place_to_the_last_bit():
    model = fit_grid(two_blocks(), parametrization=fit_grid(two_blocks(), parametrization="uniform").parameters)
    first, second = model.regenerate(1.1 * model.control_points[:, [1, 2, 0]]).blocks
    turned_back = second.nodes[:, ::-1].transpose(1, 2, 0, 3)  # see `two_blocks`
    np.testing.assert_array_equal(first.nodes[-1], turned_back[0])


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda x: x[:, :, :5],
            r"parameters of shapes \(13, 17, 5, 3\); give one array for each block: \(13, 17, 11, 3\)",
        ),
        (lambda x: np.where(x == 1, 0.999, x), r"parameters of block 1: 0\.999 in direction i at node \(13, 1, 1\)"),
        (lambda x: x[::-1], r"in direction i at node \(1, 1, 1\); they have to rise from exactly 0 to exactly 1"),
        (lambda x: 2 * x, r"in direction i at node \(13, 1, 1\)"),
        (lambda x: with_value(x, (4, 5, 6, 1), 0.9), r"block 1: 0\..* in direction j at node \(5, 7, 7\)"),
        (lambda x: with_value(x, (4, 5, 6, 2), np.nan), r"block 1: nan in direction k at node \(5, 6, 7\)"),
    ],
)
def test_given_parameters_that_do_not_rise_from_0_to_1_are_refused_with_their_place(spoil, message):
    with pytest.raises(InputError, match=message):
        fit_grid(bent_block(), parametrization=[spoil(wavy_parameters((13, 17, 11)))])


def with_value(array, place, value):
    array = array.copy()
    array[place] = value
    return array


def test_given_parameters_that_differ_across_a_permuted_interface_are_refused_with_the_node():
    chosen = [array.copy() for array in fit_grid(two_blocks()).parameters]
    chosen[0][-1, 4, 6, 1] += 1e-3
    with pytest.raises(
        InputError, match=r"block 1 and block 2 differ by 0\.001 at .* \(9, 5, 7\) of block 1 in direction j"
    ):
        fit_grid(two_blocks(), parametrization=chosen)


@pytest.mark.parametrize("parametrization", ["arc", [], 3, ["a"], None])
def test_unknown_parametrizations_are_refused_in_one_line(parametrization):
    with pytest.raises(InputError, match=r"parametrization|parameters") as error:
        fit_grid(bent_block(), parametrization=parametrization)
    assert "\n" not in str(error.value)


def test_a_direction_of_one_node_wants_parameter_zero():
    given = wavy_parameters((9, 1, 8))
    fit_grid(grid_of(bend(lattice(9, 1, 8))), parametrization=[given])
    with pytest.raises(InputError, match="be 0 in a direction of one node"):
        fit_grid(grid_of(bend(lattice(9, 1, 8))), parametrization=[given + [0, 0.5, 0]])


def test_the_command_fit_takes_a_parametrization(tmp_path, capsys):
    write_grid(tmp_path / "bent.xyz", bent_block())
    command = ["fit", str(tmp_path / "bent.xyz"), "-o", str(tmp_path / "m.h5"), "--parametrization"]
    assert run([*command, "centripetal"]) == 0
    model = FittedModel.load(tmp_path / "m.h5")
    np.testing.assert_array_equal(model.parameters[0], parameters_along(bent_block(), "centripetal"))
    assert run([*command, "arc"]) == 2
    assert "centripetal" in capsys.readouterr().err
