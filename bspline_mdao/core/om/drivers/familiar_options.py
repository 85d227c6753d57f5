"""Options of `NLoptDriver` under the names that SciPy's driver gives them, each put in NLopt's words or refused.

Theory: ``docs/theory/drivers.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ....errors import InputError

__all__ = ["NLOPT_NAME", "REFUSED", "translated"]

NLOPT_NAME = {
    "ftol": "tol",
    "maxfun": "maxeval",
    "maxfev": "maxeval",
    "maxcor": "vector_storage",
    "xtol": "xtol_abs",
    "xatol": "xtol_abs",
    "fatol": "tol",
    "acc": "tol",
}
"""Options of this driver by what the methods of SciPy call them."""

REFUSED = {
    "eps": "gradients are exact, and there is no step",
    "finite_diff_rel_step": "gradients are exact, and there is no step",
    "gtol": "NLopt has no criterion on gradients; optimality_of(problem) says how far they are from an optimum",
    "catol": "it is called constraint_tolerance here, and holds for all algorithms",
    "iprint": "disp prints a line for every iteration",
    "maxls": "line searches are NLopt's own",
    "initial_tr_radius": "it is called initial_step here",
    "rhobeg": "it is called initial_step here",
}
"""Options of SciPy's methods that have no counterpart, and why."""


def translated(given: Mapping[str, Any], known: Iterable[str]) -> dict[str, Any]:
    """Put what stands in ``opt_settings`` in the words of the driver.

    Parameters
    ----------
    given : mapping
        Settings by the driver's own names, or by SciPy's.
    known : iterable of str
        The driver's own names.

    Returns
    -------
    dict
        The same by the driver's own names.

    Raises
    ------
    InputError
        If a name is not known or has no counterpart, or two of them mean the same.

    Examples
    --------
    >>> translated({"ftol": 1e-8, "maxfun": 200}, ["tol", "maxeval"])
    {'tol': 1e-08, 'maxeval': 200}
    """
    known, found = set(known), {}
    for name, value in given.items():
        if name in REFUSED:
            raise InputError(f"NLoptDriver: opt_settings['{name}']: {REFUSED[name]}; leave it out")
        translated_name = NLOPT_NAME.get(name, name)
        if translated_name not in known:
            names = ", ".join(sorted(known | {name for name in NLOPT_NAME if NLOPT_NAME[name] in known}))
            raise InputError(f"NLoptDriver: opt_settings['{name}'] is not known; give one of {names}")
        if translated_name in found:
            raise InputError(
                f"NLoptDriver: opt_settings gives {translated_name} twice, the second time as '{name}'; leave one out"
            )
        found[translated_name] = value
    return found
