"""Gauss-Newton steps that move the parameters of nodes towards the closest points of the spline (Hoschek).

A node of an edge has one parameter to move, of a face two, of an interior three.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..splines.volume import Volume, point_and_gradient, volume_basis_gradients

LARGEST_STEP = 0.45
"""Largest step of a parameter relative to the room to its neighbours: the order along grid lines is kept."""

SMALLEST_GAP = 0.1
"""Smallest distance of two neighbouring parameters, relative to their distance before the steps."""

CLOSE = 1e-3
"""A node closer than this fraction of the initial RMS distance of its section is left alone by default."""

_CHUNK = 2048  # points at a time, so that their basis functions stay in the cache
_DAMPING = 1e-12  # of the scaled normal equations, for directions in which the mapping does not move


def project(
    volume: Volume, control_points, parameters, is_free, nodes, n_steps: int, close: float = CLOSE
) -> tuple[np.ndarray, np.ndarray]:
    """Move parameters so that the mapping comes closer to the nodes, by damped Gauss-Newton steps.

    Each step is shortened so that parameters stay strictly increasing along grid lines, and halved for the next trial
    where it does not reduce the distance, so that no distance ever grows.

    Parameters
    ----------
    volume : Volume
        Orders and knots.
    control_points : ndarray, shape (N0, N1, N2, 3)
        Control points (m).
    parameters : ndarray, shape (m0, m1, m2, 3)
        Parameters of the nodes of a whole section, its boundary included; the boundary stays.
    is_free : sequence of three bool
        Directions in which the section extends.
    nodes : ndarray, shape (n, 3)
        Inner nodes of the section, in C order (m).
    n_steps : int
        Largest number of steps.
    close : float
        A node closer than this fraction of the initial RMS distance is left alone.

    Returns
    -------
    parameters : ndarray, shape (m0, m1, m2, 3)
        New parameters.
    points : ndarray, shape (n, 3)
        The mapping at the inner ones (m).
    """
    inner = tuple(slice(1, -1) if free else slice(None) for free in is_free)
    parameters, free = parameters.copy(), np.flatnonzero(is_free)
    current = parameters[inner].reshape(-1, 3).copy()
    points, steps = _gauss_newton(volume, control_points, current, free, nodes)
    distances = ((nodes - points) ** 2).sum(axis=1)
    floors = [SMALLEST_GAP * gaps for gaps in _gaps(parameters, inner, free)]
    enough = close**2 * distances.mean()
    for _ in range(n_steps):
        steps *= _step_limits(parameters, inner, free, floors, steps)
        far = np.flatnonzero(distances > enough)
        trial = current[far] + steps[far]
        trial_points, trial_steps = _gauss_newton(volume, control_points, trial, free, nodes[far])
        trial_distances = ((nodes[far] - trial_points) ** 2).sum(axis=1)
        is_better = trial_distances < distances[far]
        better = far[is_better]
        current[better], points[better] = trial[is_better], trial_points[is_better]
        distances[better], steps[better] = trial_distances[is_better], trial_steps[is_better]
        steps[far[~is_better]] *= 0.5
        parameters[inner] = current.reshape(parameters[inner].shape)
    return parameters, points


def _gaps(parameters, inner, free) -> list[np.ndarray]:
    """Distances of neighbouring parameters along the grid lines of each free direction through inner nodes."""
    return [np.diff(parameters[inner[:d] + (slice(None),) + inner[d + 1 :]][..., d], axis=d) for d in free]


def _step_limits(parameters, inner, free, floors, steps) -> np.ndarray:
    """Fraction of each step that keeps the order of the parameters, shape (n, 1)."""
    limits = np.ones(len(steps))
    for d, gaps, floor in zip(free, _gaps(parameters, inner, free), floors):
        room = np.moveaxis(gaps - floor, d, 0)
        allowed = LARGEST_STEP * np.moveaxis(np.minimum(room[:-1], room[1:]), 0, d).ravel().clip(min=0.0)
        size = np.abs(steps[:, d])
        is_long = size > allowed
        limits[is_long] = np.minimum(limits[is_long], allowed[is_long] / size[is_long])
    return limits[:, None]


def _gauss_newton(volume: Volume, control_points, parameters, free, nodes) -> tuple[np.ndarray, np.ndarray]:
    """Points of the mapping and Gauss-Newton steps of the free parameters, both of shape (n, 3)."""
    points, steps = np.empty_like(nodes), np.zeros_like(nodes)
    is_free = np.isin(np.arange(3), free)
    for start in range(0, len(nodes), _CHUNK):
        chunk = slice(start, start + _CHUNK)
        firsts, gradients = volume_basis_gradients(volume, parameters[chunk])
        arguments = control_points, volume.orders, firsts, gradients, is_free, nodes[chunk]
        _gauss_newton_chunk(*arguments, points[chunk], steps[chunk])
    return points, steps


@njit(cache=True, error_model="numpy")
def _gauss_newton_chunk(B, orders, firsts, gradients, is_free, nodes, points, steps):
    sums, jacobian = np.empty((gradients.shape[1], 3)), np.empty((3, 3))
    normal, scale, right = np.empty((3, 3)), np.empty(3), np.empty(3)
    for q in range(len(nodes)):
        point_and_gradient(B, firsts[q], orders, gradients[q], sums, points[q], jacobian)
        _solve_step(jacobian, is_free, nodes[q], points[q], steps[q], scale, normal, right)


@njit(cache=True, error_model="numpy")
def _solve_step(jacobian, is_free, node, point, step, scale, normal, right):
    """Least-squares step of the free parameters, with columns scaled to unit length."""
    for m in range(3):
        scale[m], right[m] = 1.0, 0.0
        for n in range(3):
            normal[m, n] = 1.0 if m == n else 0.0
        if is_free[m]:
            length = np.sqrt(jacobian[0, m] ** 2 + jacobian[1, m] ** 2 + jacobian[2, m] ** 2)
            scale[m] = 1.0 / length if length > 0.0 else 0.0
    for m in range(3):
        if is_free[m]:
            for c in range(3):
                right[m] += scale[m] * jacobian[c, m] * (node[c] - point[c])
            for n in range(m):
                if is_free[n]:
                    product = 0.0
                    for c in range(3):
                        product += jacobian[c, m] * jacobian[c, n]
                    normal[m, n] = normal[n, m] = product * scale[m] * scale[n]
            normal[m, m] += _DAMPING
    _cramer(normal, right, step)
    for m in range(3):
        step[m] *= scale[m] * is_free[m]


@njit(cache=True, error_model="numpy")
def _cramer(A, r, out):
    """FitSolution of a symmetric 3 x 3 system."""
    c0, c1, c2 = (
        A[1, 1] * A[2, 2] - A[1, 2] ** 2,
        A[0, 2] * A[1, 2] - A[0, 1] * A[2, 2],
        A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1],
    )
    determinant = A[0, 0] * c0 + A[0, 1] * c1 + A[0, 2] * c2
    inverse = 1.0 / determinant if determinant > 0.0 else 0.0
    c11, c12, c22 = (
        A[0, 0] * A[2, 2] - A[0, 2] ** 2,
        A[0, 1] * A[0, 2] - A[0, 0] * A[1, 2],
        A[0, 0] * A[1, 1] - A[0, 1] ** 2,
    )
    out[0] = inverse * (c0 * r[0] + c1 * r[1] + c2 * r[2])
    out[1] = inverse * (c1 * r[0] + c11 * r[1] + c12 * r[2])
    out[2] = inverse * (c2 * r[0] + c12 * r[1] + c22 * r[2])
