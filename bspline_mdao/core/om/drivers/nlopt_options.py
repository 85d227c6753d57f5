"""Options of `NLoptDriver` and their allowed values, to refuse what NLopt cannot take where it is given."""

from __future__ import annotations

from numbers import Integral, Real

import numpy as np
from openmdao.utils.options_dictionary import OptionsDictionary

from .nlopt_algorithms import ALGORITHMS

__all__ = ["declare_options"]

MOST = 2**31 - 1
"""The largest integer that NLopt counts to."""

MOST_POINTS = 10**6
"""Maximum number of points in a population and of stored gradients."""

LOCAL_NAMES = tuple(a.name for a in ALGORITHMS.values() if not a.is_global and a.local_optimizer == "none")


def declare_options(
    options: OptionsDictionary,  # where to declare them
) -> None:
    """Declare all options of the driver."""
    options.declare("optimizer", "LD_SLSQP", values=tuple(ALGORITHMS), desc="Name of the algorithm in NLopt.")
    options.declare(
        "local_optimizer", None, values=(*LOCAL_NAMES, None), desc="Algorithm that AUGLAG and MLSL run inside."
    )
    _declare_criteria(options)
    _declare_local_criteria(options)
    _declare_search(options)
    options.declare("disp", True, types=bool, desc="Print the iterations and how the run ended.")
    options.declare(
        "singular_jac_behavior",
        "warn",
        values=("error", "warn", "ignore"),
        desc="What to do about rows and columns of zeros in the first total derivatives.",
    )
    options.declare("singular_jac_tol", 1e-16, lower=0.0, desc="What counts as zero there.")


def _declare_criteria(options: OptionsDictionary) -> None:
    """Declare the stopping criteria."""
    options.declare("ftol_rel", 1e-9, types=Real, lower=0.0, desc="Stop at this relative change of the objective.")
    options.declare("ftol_abs", 0.0, types=Real, lower=0.0, desc="Stop at this change of the objective.")
    options.declare(
        "xtol_rel", 0.0, types=Real, lower=0.0, desc="Stop at this relative change of the design variables."
    )
    options.declare(
        "xtol_abs",
        0.0,
        types=(Real, np.ndarray),
        check_valid=_check_change,
        desc="Stop at this change of all (or of each) variable.",
    )
    options.declare("stopval", None, types=Real, allow_none=True, desc="Stop at a feasible point below this objective.")
    options.declare(
        "tol",
        None,
        types=Real,
        lower=0.0,
        allow_none=True,
        desc="Stop at this change of the objective, as ScipyOptimizeDriver: ftol_abs without ftol_rel.",
    )
    options.declare(
        "maxiter",
        None,
        types=Integral,
        lower=1,
        allow_none=True,
        desc="Stop after so many iterations: points at which gradients were computed, after the first one.",
    )
    options.declare(
        "maxeval", 1000, types=Integral, lower=0, upper=MOST, desc="Stop after so many evaluations; 0 for no limit."
    )
    options.declare("maxtime", 0.0, types=Real, lower=0.0, desc="Stop after so many seconds; 0 for no limit.")
    options.declare(
        "constraint_tolerance",
        1e-6,
        types=Real,
        lower=0.0,
        desc="Scaled violation up to which a constraint is satisfied.",
    )


def _declare_local_criteria(options: OptionsDictionary) -> None:
    """Declare the stopping criteria of the local optimizer."""
    for name in ("ftol_rel", "xtol_rel"):
        options.declare(f"local_{name}", 1e-9, types=Real, lower=0.0, desc=f"{name} of the local optimizer.")
    for name in ("ftol_abs", "xtol_abs"):
        options.declare(f"local_{name}", 0.0, types=Real, lower=0.0, desc=f"{name} of the local optimizer.")
    options.declare(
        "local_maxeval", 0, types=Integral, lower=0, upper=MOST, desc="maxeval of each run of the local optimizer."
    )


def _declare_search(options: OptionsDictionary) -> None:
    """Declare the options that control the search."""
    options.declare(
        "initial_step",
        None,
        types=(Real, np.ndarray),
        allow_none=True,
        check_valid=_check_step,
        desc="First step of algorithms without gradients, scaled; None for NLopt's choice.",
    )
    options.declare(
        "population",
        0,
        types=Integral,
        lower=0,
        upper=MOST_POINTS,
        desc="Initial population; 0 for NLopt's choice.",
    )
    options.declare(
        "vector_storage",
        0,
        types=Integral,
        lower=0,
        upper=MOST_POINTS,
        desc="Number of stored gradients; 0 for NLopt's choice.",
    )
    options.declare(
        "seed",
        0,
        types=Integral,
        lower=0,
        upper=MOST,
        allow_none=True,
        desc="Seed of random numbers; None for another one every time.",
    )
    options.declare(
        "parameters",
        {},
        types=dict,
        check_valid=_check_parameters,
        desc="Parameters that one algorithm alone knows, numbers by name.",
    )
    options.declare(
        "restarts", 5, types=Integral, lower=0, desc="How often at most to start again after analyses failed."
    )


def _check_parameters(name: str, value: dict) -> None:
    """Refuse parameters that are not numbers."""
    for parameter, number in value.items():
        if not isinstance(parameter, str) or not isinstance(number, Real):
            raise ValueError(f"Value ({value!r}) of option '{name}' is no table of numbers by name.")


def _check_change(name: str, value: dict) -> None:
    """Refuse changes below zero."""
    if not np.all(np.asarray(value) >= 0.0):
        raise ValueError(f"Value ({value!r}) of option '{name}' is negative.")


def _check_step(name: str, value: dict) -> None:
    """Refuse first steps that are zero or negative."""
    if value is not None and not np.all(np.asarray(value) > 0.0):
        raise ValueError(f"Value ({value!r}) of option '{name}' is not positive.")
