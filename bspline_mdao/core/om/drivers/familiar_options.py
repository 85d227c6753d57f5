"""Options of `NLoptDriver` under the names of SciPy's driver, translated to NLopt's or refused.

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
"""Options of this driver by their names in SciPy's methods."""

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
    """Translate ``opt_settings`` from SciPy's names, or the driver's ``known`` ones, to the driver's names."""
    # {"ftol": 1e-8, "maxfun": 200} becomes {"tol": 1e-8, "maxeval": 200}. `InputError` if a name is unknown or has no
    # counterpart, or if two names mean the same.
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
