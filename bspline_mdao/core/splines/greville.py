"""Parameters of control points (Greville abscissae), and of the corners at which spans meet.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .knots import ConstantKnots, Knots
from .volume import Volume

__all__ = ["greville_abscissae", "span_breaks", "span_corners"]

CONVERGED = 1e-15
"""Largest change of a parameter in the last iteration."""

MOST_ITERATIONS = 200


def greville_abscissae(volume: Volume) -> np.ndarray:  # (N0, N1, N2, 3), parameters xi, eta, zeta in [0, 1]
    """Parameters that belong to the control points of a volume.

    Examples
    --------
    >>> from bspline_mdao.core.splines.knots import ConstantKnots
    >>> volume = Volume.of(*(ConstantKnots.uniform(n, 4) for n in (5, 4, 4)))
    >>> greville_abscissae(volume)[:, 0, 0, 0].round(3).tolist()
    [0.0, 0.167, 0.5, 0.833, 1.0]
    """
    # In a direction of order p, control point i is at the mean of the p - 1 knots ``T_{i+1} .. T_{i+p-1}``: with these
    # coefficients the spline is the parameter itself. Curved knots depend on the control point's other two parameters,
    # so all three are found together by fixed-point iteration.
    return _fixed_point(volume, volume.n_control, _knot_means)


def span_breaks(knots: Knots) -> np.ndarray:
    """Numbers (from 0) of the knots at which the spans of a direction begin, and of the knot that ends the last."""
    # Of equal knots the last one counts: a break is then the number of the span that begins there.
    numbers = np.arange(knots.order - 1, knots.n_control + 1)
    if not isinstance(knots, ConstantKnots):
        return numbers  # inner knots that vary increase strictly
    return np.append(numbers[:-1][np.diff(knots.knots[numbers]) > 0], knots.n_control)


def span_corners(
    volume: Volume,
) -> np.ndarray:  # (M0, M1, M2, 3), parameters at which the knots ``span_breaks`` of all three directions meet
    """Parameters of the corners of the spans of a volume."""
    shape = tuple(len(span_breaks(knots)) for knots in volume.knots)
    return _fixed_point(volume, shape, _knot_breaks)


def _fixed_point(
    volume: Volume, shape: tuple[int, ...], rule: Callable[[Knots, np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Parameters of points that satisfy ``rule``, a function of the knots there and of the point's index."""
    axes = (np.linspace(0.0, 1.0, n) if n > 1 else np.zeros(1) for n in shape)
    parameters, indices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), np.indices(shape)
    for _ in range(MOST_ITERATIONS):
        last, parameters = parameters, np.empty_like(parameters)
        for d, knots in enumerate(volume.knots):
            values = knots.values(last[:, (d + 1) % 3].copy(), last[:, (d + 2) % 3].copy())
            parameters[:, d] = rule(knots, values, indices[d].ravel())
        if np.abs(parameters - last).max() <= CONVERGED:
            break
    return parameters.reshape(*shape, 3)


def _knot_means(knots: Knots, values: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Mean of the knots at each point that belongs to its own control point."""
    sums, rows = np.cumsum(values, axis=1), np.arange(len(index))
    means = (sums[rows, index + knots.order - 1] - sums[rows, index]) / max(knots.order - 1, 1)
    return means.clip(0.0, 1.0)  # running sums have rounding errors


def _knot_breaks(knots: Knots, values: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Knot at each point at which its own span begins."""
    return values[np.arange(len(index)), span_breaks(knots)[index]]
