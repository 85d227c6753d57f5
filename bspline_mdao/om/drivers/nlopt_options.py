"""The options of the NLopt driver, and the settings they make."""

from numbers import Integral, Real

import numpy as np

from ...errors import InputError
from .nlopt_algorithms import ALGORITHMS, Algorithm, Needs, find_algorithm
from .nlopt_optimizer import Criteria, Settings

__all__ = ["declare_options", "make_settings"]

LOCAL_NAMES = tuple(a.name for a in ALGORITHMS.values() if not a.is_global and a.local_optimizer == "none")


def declare_options(options) -> None:
    """Declare all options.

    Parameters
    ----------
    options : openmdao.utils.options_dictionary.OptionsDictionary
        Where to declare them.
    """
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


def _declare_criteria(options) -> None:
    """When to stop."""
    options.declare("ftol_rel", 1e-9, types=Real, lower=0.0, desc="Stop at this relative change of the objective.")
    options.declare("ftol_abs", 0.0, types=Real, lower=0.0, desc="Stop at this change of the objective.")
    options.declare(
        "xtol_rel", 0.0, types=Real, lower=0.0, desc="Stop at this relative change of the design variables."
    )
    options.declare("xtol_abs", 0.0, types=(Real, np.ndarray), desc="Stop at this change of all (or of each) variable.")
    options.declare("stopval", None, types=Real, allow_none=True, desc="Stop at a feasible point below this objective.")
    options.declare("maxeval", 1000, types=Integral, lower=0, desc="Stop after so many evaluations; 0 for no limit.")
    options.declare("maxtime", 0.0, types=Real, lower=0.0, desc="Stop after so many seconds; 0 for no limit.")
    options.declare(
        "constraint_tolerance",
        1e-6,
        types=Real,
        lower=0.0,
        desc="Scaled violation up to which a constraint is satisfied.",
    )


def _declare_local_criteria(options) -> None:
    """When the local optimizer stops."""
    for name in ("ftol_rel", "xtol_rel"):
        options.declare(f"local_{name}", 1e-9, types=Real, lower=0.0, desc=f"{name} of the local optimizer.")
    for name in ("ftol_abs", "xtol_abs"):
        options.declare(f"local_{name}", 0.0, types=Real, lower=0.0, desc=f"{name} of the local optimizer.")
    options.declare("local_maxeval", 0, types=Integral, lower=0, desc="maxeval of each run of the local optimizer.")


def _declare_search(options) -> None:
    """How to search."""
    options.declare(
        "initial_step",
        None,
        types=(Real, np.ndarray),
        allow_none=True,
        desc="First step of algorithms without gradients, scaled; None for NLopt's choice.",
    )
    options.declare("population", 0, types=Integral, lower=0, desc="Initial population; 0 for NLopt's choice.")
    options.declare(
        "vector_storage", 0, types=Integral, lower=0, desc="Number of stored gradients; 0 for NLopt's choice."
    )
    options.declare(
        "seed", 0, types=Integral, allow_none=True, desc="Seed of random numbers; None for another one every time."
    )
    options.declare("parameters", {}, types=dict, desc="Parameters that one algorithm alone knows, by name.")
    options.declare(
        "restarts", 5, types=Integral, lower=0, desc="How often at most to start again after analyses failed."
    )


def _criteria(options, prefix: str = "") -> Criteria:
    """Stopping criteria of the algorithm, or of the local one."""
    names = ("ftol_rel", "ftol_abs", "xtol_rel", "xtol_abs", "maxeval")
    return Criteria(**{name: options[prefix + name] for name in names})


def _require_end(algorithm: Algorithm, options) -> None:
    """A global search needs something that ends it."""
    if algorithm.is_global and not (options["maxeval"] or options["maxtime"] or options["stopval"] is not None):
        raise InputError(f"NLoptDriver: {algorithm.name} never ends by itself; set maxeval, maxtime or stopval")


def _require_length(options, name: str, n_variables: int) -> None:
    """An option may be one number or one for every variable."""
    if options[name] is not None and np.size(options[name]) not in (1, n_variables):
        raise InputError(
            f"NLoptDriver: option {name} has {np.size(options[name])} values; give one, or one for each of the"
            f" {n_variables} design variables"
        )


def _local_optimizer(algorithm: Algorithm, options, needs: Needs) -> Algorithm | None:
    """The algorithm to run inside, or None for NLopt's choice or where there is none."""
    name = options["local_optimizer"]
    if algorithm.local_optimizer == "none" and name is not None:
        raise InputError(f"NLoptDriver: {algorithm.name} runs no other algorithm; leave local_optimizer out")
    if algorithm.local_optimizer == "needed" and name is None:
        raise InputError(
            f"NLoptDriver: {algorithm.name} needs a local_optimizer; LD_LBFGS, LD_MMA or LN_BOBYQA would do"
        )
    return name and find_algorithm(name, needs.of_subsidiary(algorithm), is_subsidiary=True)


def make_settings(options, needs: Needs) -> Settings:
    """Settings of a run.

    Parameters
    ----------
    options : mapping
        Options by name, as declared by `declare_options`.
    needs : Needs
        What the problem asks.

    Returns
    -------
    Settings
        The algorithms and when they stop.

    Raises
    ------
    InputError
        The algorithm or its local optimizer cannot do what the problem asks, or an option does not fit.
    """
    if needs.n_variables == 0:
        raise InputError("NLoptDriver: the problem has no design variables; add some to its model")
    algorithm = find_algorithm(options["optimizer"], needs)
    _require_end(algorithm, options)
    for name in ("xtol_abs", "initial_step"):
        _require_length(options, name, needs.n_variables)
    same = ("stopval", "maxtime", "initial_step", "population", "vector_storage", "seed", "parameters", "restarts")
    return Settings(
        algorithm=algorithm,
        local_optimizer=_local_optimizer(algorithm, options, needs),
        criteria=_criteria(options),
        local_criteria=_criteria(options, "local_"),
        **{name: options[name] for name in same},
    )
