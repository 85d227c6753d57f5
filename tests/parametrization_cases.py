"""A small wing, and what every design variable must pass."""

from functools import cache

import numpy as np

from bspline_mdao.fit.fitting import fit_grid
from bspline_mdao.generators.canonical import onera_m6_grid


@cache
def wing_model():
    """Fit of a coarse M6."""
    return fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4))


def surface_of(mesh):
    """Surface control points of the baseline."""
    return mesh.points[mesh.surface_ids]


def assert_exact(layout, variable, seed=0):
    """Compare the partials of a bound variable with complex steps, away from the baseline; their pattern is fixed."""
    design_map, random = variable.bind(layout), np.random.default_rng(seed)
    points = layout.points + 0.05 * random.normal(size=layout.points.shape)
    values = design_map.initial + 0.1 * random.normal(size=design_map.initial.shape)
    np.testing.assert_allclose(design_map.apply(layout.points, design_map.initial), layout.points, atol=1e-12)
    partials, there = design_map.partials(points, values), design_map.partials(layout.points, design_map.initial)
    for d_points, d_values, matrix, at_baseline in (
        (1.0, 0.0, partials.points, there.points),
        (0.0, 1.0, partials.values, there.values),
    ):
        by = random.normal(size=matrix.shape[1])
        step = 1e-30j * by
        moved = design_map.apply(
            points + d_points * (step.reshape(-1, 3) if d_points else 0.0), values + (step if d_values else 0.0)
        )
        np.testing.assert_allclose(matrix @ by, moved.imag.ravel() / 1e-30, rtol=1e-11, atol=1e-12)
        np.testing.assert_array_equal(matrix.tocsr().indptr, at_baseline.tocsr().indptr)
        np.testing.assert_array_equal(
            matrix.tocsr().sorted_indices().indices, at_baseline.tocsr().sorted_indices().indices
        )
