"""Greville abscissae: where in parameter space a control point is."""

from __future__ import annotations

import numpy as np

from .volume import Volume

__all__ = ["greville_abscissae"]

CONVERGED = 1e-15
"""Largest change of a parameter in the last iteration."""

MOST_ITERATIONS = 200


def greville_abscissae(volume: Volume) -> np.ndarray:
    """Give every control point of a volume its place in parameter space.

    In a direction of order p, control point i is at the mean of the p - 1 knots ``T_{i+1} .. T_{i+p-1}``: with these
    coefficients the spline is the parameter itself. Curved knots depend on the other two parameters, which are those of
    the control point, so that all three are found together by fixed-point iteration.

    Parameters
    ----------
    volume : Volume
        The volume.

    Returns
    -------
    ndarray, shape (N0, N1, N2, 3)
        Parameters xi, eta, zeta in [0, 1].

    Examples
    --------
    >>> from bspline_mdao.splines.knots import ConstantKnots
    >>> volume = Volume.of(*(ConstantKnots.uniform(n, 4) for n in (5, 4, 4)))
    >>> greville_abscissae(volume)[:, 0, 0, 0].round(3).tolist()
    [0.0, 0.167, 0.5, 0.833, 1.0]
    """
    axes = (np.linspace(0.0, 1.0, n) if n > 1 else np.zeros(1) for n in volume.n_control)
    parameters = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    for _ in range(MOST_ITERATIONS):
        last, parameters = parameters, _means(volume, parameters)
        if np.abs(parameters - last).max() <= CONVERGED:
            break
    return parameters


def _means(volume: Volume, parameters: np.ndarray) -> np.ndarray:
    """Mean knots of every control point, given its other two parameters."""
    means = np.empty_like(parameters)
    for d, knots in enumerate(volume.knots):
        others = (parameters[..., (d + 1) % 3].ravel(), parameters[..., (d + 2) % 3].ravel())
        sums = np.cumsum(knots.values(*others), axis=1)
        means[..., d] = _own(sums, knots.order, parameters.shape[:3], d)
    return means


def _own(sums: np.ndarray, order: int, shape, d: int) -> np.ndarray:
    """Of the running sums of the knots at each point, the mean that belongs to the point's own index in direction d."""
    index = np.indices(shape)[d].ravel()
    rows = np.arange(len(index))
    means = (sums[rows, index + order - 1] - sums[rows, index]) / max(order - 1, 1)
    return means.clip(0.0, 1.0).reshape(shape)  # running sums round
