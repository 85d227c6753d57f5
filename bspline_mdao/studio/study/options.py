"""Options of drivers in a study: declared by the driver, with values that it accepts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from openmdao.api import OptionsDictionary

from ...core.om.drivers.nlopt_algorithms import Needs
from ...core.om.drivers.nlopt_driver import NLoptDriver, make_settings
from ...core.om.drivers.scipy_driver import ScipyDriver
from ...errors import InputError
from .keys import SCIPY
from .kinds import LONGEST, NUMBER
from .names import choices, shortened

__all__ = ["fault_of_option", "fault_of_options", "options_of", "settings_of"]

KEYS = ("optimizer", "tolerance", "max_iterations")
"""Keys of ``[driver]`` that set options of drivers."""

NLOPT, BY_SCIPY = ("optimizer", "ftol_rel", "maxeval"), ("optimizer", "tol", "maxiter")
"""The options that these keys set."""

MANY = 10**6
"""Stand-in for the number of variables, which only the grid determines."""


def settings_of(driver: Mapping[str, Any]) -> dict[str, Any]:
    """Options of a driver that keys of ``[driver]`` set."""
    return dict(zip(BY_SCIPY if driver["optimizer"] in SCIPY else NLOPT, (driver[key] for key in KEYS)))


def options_of(driver: Mapping[str, Any]) -> OptionsDictionary:
    """Options that a driver declares, without those that keys of ``[driver]`` set."""
    made = ScipyDriver() if driver["optimizer"] in SCIPY else NLoptDriver()
    for name, value in settings_of(driver).items():
        made.options[name] = value
    return made.options


def fault_of_option(driver: Mapping[str, Any], options: OptionsDictionary, name: str, value: Any) -> str:
    """Set an option and return an empty text, or say why it cannot be given."""
    taken = dict(zip(settings_of(driver), KEYS))
    if name in taken:
        return f"is the key {taken[name]} of [driver]; give that"
    declared = sorted({each for each, _ in options.items()} - set(taken))
    if name not in declared:
        return f"is no option of {driver['optimizer']}; {choices(name, declared, 'the options are')}"
    if not _is_plain(value):
        said = shortened(repr(value))
        return (
            f"is {said}, which is not what an option can be; give a text, a number up to 1e20 in size, or true or false"
        )
    if isinstance(value, bool) and not isinstance(options[name], bool):
        return f"is {str(value).lower()}, and is no option to switch on or off"
    try:
        options[name] = value
    except (TypeError, ValueError) as error:
        marker = f"of option '{name}' "  # "NLoptDriver: Value (-1.0) of option 'maxtime' is less than ..."
        return f"is {shortened(repr(value))}: it {str(error).partition(marker)[2] or 'does not fit'}"
    return ""


def fault_of_options(
    options: OptionsDictionary, constraints: Mapping[str, Mapping[str, Any]], n_variables: float
) -> str:
    """Say why options of NLopt contradict each other or the study; empty if they do not."""
    equalities = [name for name, table in constraints.items() if table["equals"] is not None]
    needs = Needs(
        n_variables=int(min(n_variables, MANY)),
        inequality=tuple(name for name in constraints if name not in equalities),
        equality=tuple(equalities),
        bounded=("variables",),
        unbounded=(),
        has_derivatives=True,
    )
    try:
        make_settings(options, needs)
    except InputError as error:
        return str(error).removeprefix("NLoptDriver: ")
    return ""


def _is_plain(value: Any) -> bool:
    """Whether it consists of texts, numbers and flags only."""
    if isinstance(value, list):
        return len(value) <= LONGEST and all(map(_is_plain, value))
    if isinstance(value, dict):
        return len(value) <= LONGEST and all(map(_is_plain, value.values()))
    return isinstance(value, str | bool) or NUMBER.accepts(value)
