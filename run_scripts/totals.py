"""Total derivatives of a problem held against each other and against differences."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import openmdao.api as om


def move_at_random(problem: om.Problem, size: float = 0.1) -> om.Problem:
    """Run a problem with every value off its present one by up to ``size`` in units of the driver."""
    rng = np.random.default_rng(4)
    for name, meta in problem.model.get_design_vars().items():
        value = problem.get_val(name)
        problem.set_val(name, value + size * _scale(meta) * rng.uniform(-1.0, 1.0, value.shape))
    problem.run_model()
    return problem


def check_totals(problem: om.Problem, n_directions: int = 2, step: float = 1e-3, levels: int = 4) -> dict:
    """Hold the total derivatives at the present point against each other and against differences.

    Parameters
    ----------
    problem : om.Problem
        A problem that has run.
    n_directions : int
        Random directions in the space of all design variables.
    step : float
        First step of the differences, in units of the driver. It is halved, and the differences are extrapolated.
    levels : int
        Steps.

    Returns
    -------
    dict
        ``transposed``, the largest difference of forward and reverse products by the product of the norms, and
        ``differences``, that of extrapolated central differences and forward products by the largest of those.
    """
    rng, of = np.random.default_rng(5), [*problem.model.get_objectives(), *problem.model.get_constraints()]
    designs = problem.model.get_design_vars()
    start = {name: problem.get_val(name).copy() for name in designs}
    directions = [
        {name: _direction(rng, meta, start[name].size) for name, meta in designs.items()} for _ in range(n_directions)
    ]
    reverse = problem.compute_totals(of, list(start))
    forward = [problem.compute_jacvec_product(of, list(start), "fwd", direction) for direction in directions]
    differences = [
        extrapolated(partial(_responses, problem, of, start, direction), step, levels) for direction in directions
    ]
    _responses(problem, of, start, directions[0], 0.0)
    return {
        "transposed": max(_untransposed(reverse, *pair) for pair in zip(forward, directions)),
        "differences": max(
            _largest_error([d[name] for d in differences], [f[name].ravel() for f in forward]) for name in of
        ),
    }


def _untransposed(reverse: dict, forward: dict, direction: dict) -> float:
    """Largest difference of products with rows from reverse mode and forward products, by the norm of the terms."""
    errors = []
    for name, product in forward.items():
        rows = {wrt: reverse[name, wrt] for wrt in direction}
        terms = np.concatenate([rows[wrt] * values[values != 0.0] for wrt, values in direction.items()], axis=1)
        errors.append(np.abs(terms.sum(axis=1) - product.ravel()).max() / np.linalg.norm(terms))
    return max(errors)


def _largest_error(differences: list[np.ndarray], products: list[np.ndarray]) -> float:
    """Largest error of several differences by the largest product."""
    return np.abs(np.subtract(differences, products)).max() / np.abs(products).max()


def extrapolated(function: Callable[[float], dict[str, np.ndarray]], step: float, levels: int) -> dict[str, np.ndarray]:
    """Central differences of a function of the step at halved steps, extrapolated to none (Richardson)."""
    table = []
    for h in step / 2.0 ** np.arange(levels):
        above, below = function(h), function(-h)
        table.append({name: (above[name] - below[name]) / (2.0 * h) for name in above})
    for power in 4.0 ** np.arange(1, levels):
        pairs = zip(table, table[1:])
        table = [{name: (power * b[name] - a[name]) / (power - 1.0) for name in a} for a, b in pairs]
    return table[0]


def _responses(problem: om.Problem, of: list[str], start: dict, direction: dict, h: float) -> dict[str, np.ndarray]:
    """Responses at a step along a direction."""
    for name, value in start.items():
        problem.set_val(name, value + h * direction[name])
    problem.run_model()
    return {name: problem.get_val(name).ravel().copy() for name in of}


def _direction(rng: np.random.Generator, meta: dict, size: int) -> np.ndarray:
    """Random values of those entries of a variable that are designed, within a unit of the driver."""
    direction, entries = np.zeros(size), _entries(meta)
    direction[entries] = _scale(meta) * rng.uniform(-1.0, 1.0, direction[entries].size)
    return direction


def _entries(meta: dict):
    """Index of the entries of a variable that are designed."""
    return slice(None) if meta["indices"] is None else meta["indices"].shaped_array()


def _scale(meta: dict) -> np.ndarray | float:
    """What one unit of the driver is, for a design variable."""
    return 1.0 if meta["total_scaler"] is None else 1.0 / meta["total_scaler"]
