"""Derivatives of the losses that improvements lower, and what the losses say."""

import numpy as np
import pytest
from adaptation_cases import skewed_grid

from bspline_mdao.core.adaptation.heights import HeightLoss
from bspline_mdao.core.adaptation.loss import WIDTH, WorstCells, price, price_slope
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.testing import central_difference, complex_step


def worst_cells(q, sharpness=30.0):
    return WorstCells.at(q, [np.arange(40), np.arange(0), np.arange(50, 90)], sharpness)


@pytest.mark.parametrize("seed", range(3))
def test_the_gradient_of_the_loss_of_cells_is_exact(seed):
    random = np.random.default_rng(seed)
    q = random.uniform(-0.1, 1.0, 100)
    worst = worst_cells(random.permutation(q))
    v = random.normal(size=q.size)
    exact = complex_step(worst.value, q, v)
    assert worst.gradient(q) @ v == pytest.approx(float(exact), rel=1e-11)
    np.testing.assert_array_equal(worst.gradient(q)[40:50], 0.0)


@pytest.mark.parametrize("gain", [-3.0, -WIDTH, 0.0, 0.3 * WIDTH, 5.0])
def test_the_slope_of_the_price_is_exact_and_the_price_does_not_overflow(gain):
    slope = float(complex_step(lambda x: price(x[0]), np.array([gain]), np.ones(1)))
    assert price_slope(gain) == pytest.approx(slope, rel=1e-12, abs=1e-200)
    assert np.isfinite(price(-1e3))
    assert price(1.0) == pytest.approx(0.0, abs=1e-80)


def test_the_loss_falls_when_the_worst_cell_rises_and_a_block_that_falls_costs_more_than_another_gains():
    q = np.random.default_rng(1).uniform(0.3, 1.0, 100)
    worst = worst_cells(q, 300.0)
    better, mixed = q.copy(), q.copy()
    first, second = np.argmin(q[:40]), 50 + np.argmin(q[50:90])
    better[first] *= 1.2
    mixed[first] *= 1.2
    mixed[second] *= 0.97
    assert worst.value(better) < worst.value(q) < worst.value(mixed)


def test_the_gradient_of_the_loss_of_heights_is_exact():
    quality = GridQuality.of_baseline(skewed_grid())
    nodes, random = skewed_grid().to_vector().reshape(-1, 3), np.random.default_rng(2)
    loss, away = HeightLoss(quality.first_cells, 0.05), nodes + 1e-4 * random.normal(size=nodes.shape)
    bar, direction = np.zeros_like(nodes), random.normal(size=nodes.shape)
    value = loss.add(away, bar)
    assert 0.0 < value < 1e3
    found = central_difference(lambda h: loss.add(away + h * direction, np.zeros_like(bar)), 1e-5)
    assert np.sum(bar * direction) == pytest.approx(float(found), rel=1e-7)
