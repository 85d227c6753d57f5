"""Grids whose worst cells are raised at fixed surface, and grids that say why theirs are not."""

import numpy as np
import pytest
from adaptation_cases import skewed_grid, skewed_model

from bspline_mdao import InputError, fit_grid
from bspline_mdao.adaptation import improve_grid
from bspline_mdao.core.adaptation.improvement import ORTHOGONAL
from bspline_mdao.core.adaptation.loss import WIDTH, WorstCells
from bspline_mdao.core.adaptation.search import MOST_MARGIN, Search
from bspline_mdao.core.design.interior_points import InteriorPoints
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.testing import central_difference


@pytest.fixture(scope="module")
def found():
    return improve_grid(skewed_model(), iterations=30)


@pytest.mark.slow
def test_the_worst_cell_of_every_block_rises_and_nothing_gets_worse(found):
    assert found.is_better
    assert found.reason == ""
    assert found.after.q_min > 1.3 * found.before.q_min
    for change in found.blocks:
        assert change.after.q > 1.1 * change.before.q
    assert found.after.min_corner >= found.before.min_corner
    assert found.after.n_inverted == found.before.n_inverted == 0


def test_a_folded_grid_is_unfolded():
    found = improve_grid(skewed_model(amount=0.16), iterations=20)
    assert (found.before.n_inverted, found.after.n_inverted) == (3, 0)
    assert found.before.q_min < 0.0 < found.after.q_min


@pytest.mark.parametrize("seed", [1, 2])
def test_other_skewed_grids_rise_as_well(seed):
    other = improve_grid(skewed_model(seed=seed), iterations=20)
    assert all(change.after.q > change.before.q for change in other.blocks)
    assert other.after.min_corner >= other.before.min_corner


def test_the_surface_stays_to_the_last_bit_and_heights_within_their_tolerance(found):
    before, after = (grid.blocks for grid in (skewed_model().regenerate(), found.grid))
    for old, new in zip(before, after):
        np.testing.assert_array_equal(new.nodes[:, :, 0], old.nodes[:, :, 0])
        np.testing.assert_array_equal(new.nodes[:, -1], old.nodes[:, -1])
        np.testing.assert_array_equal(new.nodes[:, 0, :, 1], old.nodes[:, 0, :, 1])
        assert np.abs(new.nodes[:, 0] - old.nodes[:, 0]).max() > 1e-3
    np.testing.assert_array_equal(after[0].nodes[-1], after[1].nodes[0])
    (heights,) = found.after.heights
    assert 0.99 <= heights.ratio_min <= heights.ratio_max <= 1.01


def test_the_grid_is_that_of_its_control_points_and_the_residual(found):
    model = skewed_model()
    nodes = model.evaluator().forward(found.control_points) + model.residual
    np.testing.assert_allclose(found.grid.to_vector().reshape(-1, 3), nodes, atol=1e-13)
    assert np.abs(model.residual).max() > 1e-4
    assert np.abs(found.values).max() <= found.shift.reach


def test_the_report_is_that_of_the_grid_that_is_returned(found):
    q = GridQuality.of_baseline(found.grid).evaluate(found.grid.to_vector().reshape(-1, 3), (), cells=True).q
    assert found.after.q_min == pytest.approx(q.min(), rel=1e-12)
    assert found.after.q_min == min(change.after.q for change in found.blocks)
    assert found.before.q_min == min(change.before.q for change in found.blocks)


@pytest.fixture
def search():
    model = skewed_model()
    return Search(model, InteriorPoints("inner").bind(model), 0.05)


def worst_cells(search):
    """All cells of every block."""
    return WorstCells.at(search.q, [np.arange(cells.start, cells.stop) for cells in search.slices], 30.0)


def test_the_derivative_of_the_loss_of_the_grid_is_exact(search):
    worst, random = worst_cells(search), np.random.default_rng(7)
    values, direction = 0.02 * random.normal(size=(2, search.shift.n_values))
    gradient = search.loss(values, worst)[1]
    found = central_difference(lambda h: search.loss(values + h * direction, worst)[0], 1e-2)
    assert gradient @ direction == pytest.approx(float(found), rel=1e-7)


def test_corners_are_charged_for_what_they_lack_of_the_margin(search):
    losses = []
    for margin in (0.0, WIDTH, MOST_MARGIN):
        search.margin = margin
        losses.append(search.loss(search.values, worst_cells(search))[0])
    assert losses[0] < losses[1] < losses[2]


def test_where_the_worst_corner_alone_falls_its_margin_grows_before_anything_is_held(search, monkeypatch):
    margins, falls = [], search.corners.copy()
    falls[np.argmin(falls)] -= 1e-3

    def minimised(*_):
        margins.append(search.margin)
        return search.values

    monkeypatch.setattr(search, "minimised", minimised)
    monkeypatch.setattr(search, "corners_of", lambda _: falls)
    search.run_round(30.0, 5)
    steps = int(MOST_MARGIN / WIDTH)
    np.testing.assert_allclose(margins[: steps + 1], WIDTH * np.arange(steps + 1))
    assert set(margins[steps + 1 :]) == {margins[steps]}
    cell = np.arange(len(falls)) == np.argmin(falls)
    np.testing.assert_array_equal(search.is_fixed, search.values_that_move(search.nodes_of_cells(cell)))
    assert search.is_fixed.any()


def test_a_grid_without_anything_to_gain_is_returned_as_it_was():
    axes = [np.linspace(0.0, 1.0, n) for n in (6, 7, 8)]
    grid = Grid((Block(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), "box"),))
    found = improve_grid(fit_grid(grid, n_control=(4, 4, 4)), iterations=5)
    assert not found.is_better
    assert 1.0 - found.before.q_min < ORTHOGONAL
    assert found.reason == "all cells are orthogonal"
    np.testing.assert_allclose(found.grid.to_vector(), grid.to_vector(), atol=1e-14)


def test_a_worst_cell_that_no_interior_point_moves_is_named():
    grid = skewed_grid(amount=0.02)
    nodes = grid.blocks[0].nodes.copy()
    nodes[0, -1, -1] += [0.09, 0.04, -0.11]  # the corner of the box, and so three of the cell's faces, are held
    bad = Grid((Block(nodes[:2, -2:, -2:], "corner"),))
    with pytest.raises(InputError, match="all of them are fixed"):
        improve_grid(fit_grid(bad, n_control=(2, 2, 2)))
    folded = improve_grid(fit_grid(Grid((Block(nodes, "left"),)), n_control=(6, 5, 6)), iterations=10)
    worst = min(folded.blocks[0].before, folded.blocks[0].after, key=lambda cell: cell.q)
    assert (worst.i, worst.j, worst.k) == (1, 7, 9)
    assert folded.after.q_min >= folded.before.q_min


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reach": 0.6}, "reach is 0.6"),
        ({"height_tolerance": 0.0}, "height_tolerance is 0.0"),
        ({"iterations": 0}, "iterations is 0"),
    ],
)
def test_options_that_cannot_be_used_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        improve_grid(skewed_model(), **options)
