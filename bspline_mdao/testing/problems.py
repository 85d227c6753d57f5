"""Checks of partial and total derivatives of problems that the caller passes: OpenMDAO is not loaded here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import openmdao.api as om

from ..errors import InputError
from .derivatives import central_differences, richardson

__all__ = ["TotalsCheck", "assert_partials", "check_totals", "perturb_design", "total_difference"]


class TotalsCheck(NamedTuple):
    """How well total derivatives agree with each other and with differences. Printed, it is a table.

    Parameters
    ----------
    transposed : float
        Largest difference of forward and reverse products, relative to the product of the norms.
    differences : float
        Largest difference of extrapolated central differences and forward products, relative to the largest product.
    steps : ndarray, shape (levels,)
        Steps of the differences, in units of the driver.
    errors : ndarray, shape (levels,)
        The same for the differences at each step: they fall by four as the step is halved, until round-off.
    """

    transposed: float
    differences: float
    steps: np.ndarray
    errors: np.ndarray

    def __str__(self) -> str:
        """Table of the errors, each with what it is between."""
        rows = [
            ("step", "error", "of"),
            *((f"{step:.2e}", f"{error:.2e}", "differences") for step, error in zip(self.steps, self.errors)),
        ]
        rows += [("to zero", f"{self.differences:.2e}", "differences extrapolated to step zero")]
        rows += [("none", f"{self.transposed:.2e}", "forward derivatives by reverse ones")]
        return "\n".join(f"{step:>12}{error:>12}  {of}" for step, error, of in rows)


def check_totals(
    problem: om.Problem,
    of: Sequence[str] | None = None,
    wrt: Sequence[str] | None = None,
    n_directions: int = 2,
    step: float = 1e-3,
    levels: int = 4,
) -> TotalsCheck:
    """Compare the total derivatives at the current point with each other and with differences.

    Parameters
    ----------
    problem : openmdao.api.Problem
        A problem that has been run.
    of, wrt : sequence of str, optional
        Outputs and inputs; by default the objectives and constraints, and the design variables.
    n_directions : int
        Random directions in the space of all inputs.
    step : float
        First step of the differences, in units of the driver. It is halved, and the differences are extrapolated.
    levels : int
        Number of steps.

    Returns
    -------
    TotalsCheck

    Raises
    ------
    InputError
        If there are no outputs or no inputs, or an output does not depend on any input along the directions: the
        smallest step changes it by less than round-off. Derivatives vanish by symmetry at some baselines, see
        `perturb_design`.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao.testing import check_totals
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("parabola", om.ExecComp("y = x**2 + 3*x"), promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> check = check_totals(problem, ["y"], ["x"], step=1e-2)
    >>> bool(check.differences < 1e-9), bool(check.transposed < 1e-15), len(check.steps)
    (True, True, 4)
    """
    designs = problem.model.get_design_vars() if wrt is None else dict.fromkeys(wrt)
    of = [*problem.model.get_objectives(), *problem.model.get_constraints()] if of is None else list(of)
    if not designs or not of:
        raise InputError("there is nothing to compare: the problem has no responses or no design variables")
    random = np.random.default_rng(5)
    sizes = {name: problem.get_val(name).size for name in designs}
    directions = [
        {name: _direction(random, meta, sizes[name]) for name, meta in designs.items()} for _ in range(n_directions)
    ]
    reverse = problem.compute_totals(of, list(designs))
    forward = [problem.compute_jacvec_product(of, list(designs), "fwd", direction) for direction in directions]
    tables = [_total_differences(problem, of, direction, step, levels) for direction in directions]
    products = {name: np.array([product[name].ravel() for product in forward]) for name in of}
    smallest = step / 2.0 ** (levels - 1)
    for name, product in products.items():
        change, size = (np.abs(x).max(initial=0.0) for x in (smallest * product, problem.get_val(name)))
        if change <= np.finfo(float).eps * size:
            raise InputError(
                f"there is nothing to compare: '{name}' does not depend on the design variables but for round-off; if "
                "its derivatives vanish here by symmetry, move the design first, as perturb_design(problem) does, or "
                "name the others in 'of'"
            )

    def error(differences: list[dict]) -> float:
        return max(_relative_error([one[name] for one in differences], products[name]) for name in of)

    limits = [{name: richardson([each[name] for each in table]) for name in of} for table in tables]
    return TotalsCheck(
        max(_untransposed(reverse, *pair, _chosen(problem, of)) for pair in zip(forward, directions)),
        error(limits),
        step / 2.0 ** np.arange(levels),
        np.array([error([table[level] for table in tables]) for level in range(levels)]),
    )


def total_difference(
    problem: om.Problem, of: Sequence[str], direction: Mapping[str, np.ndarray], step: float = 4e-3, levels: int = 3
) -> dict[str, np.ndarray]:
    """Differentiate outputs of a problem along a direction in its inputs by extrapolated central differences.

    Parameters
    ----------
    problem : openmdao.api.Problem
        A problem that has been run; it is run again at the same point.
    of : sequence of str
        Outputs.
    direction : mapping of str to ndarray
        The direction, by names of the inputs.
    step : float
        Largest step, which multiplies the direction.
    levels : int
        Number of steps, see `central_difference`.

    Returns
    -------
    dict of ndarray
        Derivatives by names of the outputs, flat.

    Raises
    ------
    InputError
        If there are no outputs or no inputs.
    """
    if not of or not direction:
        raise InputError("there is nothing to differentiate: no outputs or no inputs")
    table = _total_differences(problem, of, direction, step, levels)
    return {name: richardson([each[name] for each in table]) for name in of}


def perturb_design(problem: om.Problem, size: float = 0.1, seed: int = 4) -> om.Problem:
    """Run a problem with every design variable perturbed, away from points where derivatives happen to vanish.

    Parameters
    ----------
    problem : openmdao.api.Problem
        A problem that has been run.
    size : float
        Largest change, in units of the driver.
    seed : int
        Seed of the random changes.

    Returns
    -------
    openmdao.api.Problem
        The same problem.
    """
    random = np.random.default_rng(seed)
    for name, meta in problem.model.get_design_vars().items():
        value = problem.get_val(name)
        problem.set_val(name, value + size * _unit(meta) * random.uniform(-1.0, 1.0, value.shape))
    problem.run_model()
    return problem


def assert_partials(problem: om.Problem, **tolerances: float) -> None:
    """Check the partial derivatives of all components; missing ones and zeros fail.

    Parameters
    ----------
    problem : openmdao.api.Problem
        A problem that has been run. ``set_check_partial_options`` sets how derivatives are compared.
    **tolerances
        ``atol`` and ``rtol`` of OpenMDAO's ``assert_check_partials``.

    Raises
    ------
    InputError
        If a component was not checked, has no derivatives, or only zeros.
    ValueError
        If derivatives differ.
    """
    from openmdao.api import IndepVarComp  # here, so kernels can be checked without the framework
    from openmdao.core.component import Component
    from openmdao.utils.assert_utils import assert_check_partials

    data = problem.check_partials(out_stream=None)
    components = problem.model.system_iter(recurse=True, typ=Component)
    given = (part for part in components if part.get_io_metadata("output"))  # other components have no derivatives
    missing = {part.pathname for part in given if not isinstance(part, IndepVarComp)} ^ set(data)
    if missing or not data:
        raise InputError(f"not checked: {', '.join(sorted(missing)) or 'the problem has no component'}")
    for name, pairs in data.items():
        for exact in ("J_fwd", "J_fd"):
            if not any(np.any(pair[exact]) for pair in pairs.values() if exact in pair):
                raise InputError(f"{name}: there is nothing to compare, {exact} is empty or zero")
    assert_check_partials(data, **tolerances)


def _total_differences(
    problem: om.Problem, of: Sequence[str], direction: Mapping, step: float, levels: int
) -> list[dict[str, np.ndarray]]:
    """Central differences at halved steps along a direction, by output; the problem is restored afterwards."""
    start = {name: problem.get_val(name).copy() for name in direction}

    def run(h: float) -> np.ndarray:
        for name, value in start.items():
            problem.set_val(name, value + h * np.reshape(direction[name], value.shape))
        problem.run_model()
        return np.concatenate([problem.get_val(name).ravel() for name in of])

    ends = np.cumsum([problem.get_val(name).size for name in of])[:-1]
    table = [dict(zip(of, np.split(row, ends))) for row in central_differences(run, step, levels)]
    run(0.0)
    return table


def _chosen(problem: om.Problem, of: Sequence[str]) -> dict[str, Any]:
    """Entries of the outputs that the driver uses: the indices of constraints, all entries of others."""
    responses = {**problem.model.get_objectives(), **problem.model.get_constraints()}
    indices = {name: responses[name]["indices"] if name in responses else None for name in of}
    return {name: slice(None) if found is None else found.shaped_array() for name, found in indices.items()}


def _untransposed(reverse: dict, forward: dict, direction: dict, chosen: dict) -> float:
    """Largest difference of products with reverse-mode rows and forward products, relative to their size."""
    errors = []
    for name, product in forward.items():
        rows = {wrt: reverse[name, wrt] for wrt in direction}
        terms = np.concatenate([rows[wrt] * values[values != 0.0] for wrt, values in direction.items()], axis=1)
        errors.append(np.abs(terms.sum(axis=1) - product.ravel()[chosen[name]]).max() / np.linalg.norm(terms))
    return max(errors)


def _relative_error(differences: list[np.ndarray], products: np.ndarray) -> float:
    """Largest error of several differences, relative to the largest product."""
    return np.abs(np.subtract(differences, products)).max() / np.abs(products).max()


def _direction(random: np.random.Generator, meta: dict | None, size: int) -> np.ndarray:
    """Random values for the design entries of an input, within one unit of the driver."""
    indices = None if meta is None else meta["indices"]
    direction, entries = np.zeros(size), slice(None) if indices is None else indices.shaped_array()
    direction[entries] = _unit(meta) * random.uniform(-1.0, 1.0, direction[entries].size)
    return direction


def _unit(meta: dict | None) -> np.ndarray | float:
    """Size of one unit of the driver for a design variable, from its metadata."""
    return 1.0 if meta is None or meta["total_scaler"] is None else 1.0 / meta["total_scaler"]
