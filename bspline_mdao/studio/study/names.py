"""Names in a study: the rules for variables, measures and conditions."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from keyword import iskeyword

import openmdao.api as om

from ...flow.functionals import FUNCTIONALS
from ...names import ALL_NAMES
from .keys import QUALITIES

__all__ = ["choices", "fault_of_name", "shortened"]

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*", re.ASCII)
_LONGEST = 60

_TAKEN = {
    *(*ALL_NAMES, *QUALITIES, *FUNCTIONALS),
    *("states", "Mach_number", "CL_target", "flow", "grid_movement"),
}
"""Other inputs, outputs and subsystems of the problem."""

FUNCTIONS = {
    "abs", "acos", "acosh", "arange", "arccos", "arccosh", "arcsin", "arcsinh", "arctan", "arctan2", "asin",
    "asinh", "atan", "cos", "cosh", "diff", "dot", "e", "erf", "erfc", "exp", "expm1", "factorial", "fmax", "fmin",
    "inner", "isinf", "isnan", "kron", "linspace", "log", "log10", "log1p", "matmul", "max", "maximum", "min",
    "minimum", "np", "numpy", "ones", "outer", "pi", "power", "prod", "sin", "sinh", "sum", "tan", "tanh",
    "tensordot", "zeros", "always_opt", "assembled_jac_type", "constant", "default_shape", "derivs_method",
    "distributed", "do_coloring", "has_diag_partials", "run_root_only", "shape", "shape_by_conn", "units",
    "use_jit",
}  # fmt: skip
"""Names with a meaning in expressions of an ``om.ExecComp``, and its options."""


def fault_of_name(
    group: str,  # ``variables``, ``measures``, ``conditions`` or ``constraints``
    name: str,  # the name
) -> str:
    """Say why a name is not allowed; empty if it is."""
    if not _NAME.fullmatch(name) or len(name) > _LONGEST:
        return f"is no name; give one of letters, digits and _ that starts with a letter, {_LONGEST} letters at most"
    if iskeyword(name):
        return "is a word of Python; choose another name"
    is_taken = name in _TAKEN or (group == "measures" and name in FUNCTIONS)
    is_taken |= group == "conditions" and hasattr(om.Group(), name)
    if is_taken and group != "constraints":
        return "is a name already in use; choose another one" + ("" if group == "conditions" else " and give kind")
    return ""


def choices(name: str, allowed: Iterable[str], words: str, listed: list[str] | None = None) -> str:
    """Say what was probably meant, and what is allowed."""
    names = list(dict.fromkeys(map(str, allowed)))
    by_letters = {known.lower(): known for known in names}
    wanted = name.lower()[:_LONGEST]
    near = get_close_matches(wanted, by_letters, n=1) or [known for known in by_letters if known.startswith(wanted)]
    meant = f"did you mean '{by_letters[near[0]]}'? " if near else ""
    return f"{meant}{words} {', '.join(names if listed is None else listed)}"


def shortened(text: str) -> str:
    """A text of a study in a message: all of it, or its beginning."""
    return text if len(text) <= 2 * _LONGEST else f"{text[:_LONGEST]}..."
