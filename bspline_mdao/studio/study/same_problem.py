"""Check that two studies pose the same problem, so that cases of one are valid for the other."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import reduce
from operator import getitem
from typing import Any

from ...errors import InputError
from ...grids.io.run_folder import digest_of
from .study import Study, Table

__all__ = ["check_same_problem", "problem_of"]

_LIMITS = ("lower", "upper", "start", "equals", "ref")
"""Keys of variables, objective and constraints that may change: the values of the model at a design stay the same."""

_FILES = ("grid", "file"), ("grid", "patches"), ("variables", "file"), ("variables", "to")
"""Tables, and their keys that name files."""


def problem_of(study: Study) -> dict[str, Any]:
    """All that the values of a study's model depend on, table by table, in the form of JSON; files by their digests."""
    found: dict[str, Any] = {
        "grid": dict(study.grid),
        "variables": {name: _without_limits(table) for name, table in study.variables.items()},
        "measures": study.measures,
        "flow": study.flow or {},
        "conditions": study.conditions,
        "objective": _without_limits(study.objective),
        "constraints": {name: _without_limits(table) for name, table in study.constraints.items()},
        "movement": study.movement,
    }
    found |= {"junction": study.junction} if study.junction else {}
    found |= {"driver": {"even_pressures": study.evened}} if study.evened else {}
    found = json.loads(json.dumps(found))  # a copy, down to lists of files
    for (*path, key), file in study.inputs.items():
        reduce(getitem, path, found)[key] = digest_of(file)
    return found


def check_same_problem(
    study: Study,  # the study
    earlier: Mapping[str, Any],  # result of `problem_of` for the earlier study
    where: str,  # where its run was, for the message
) -> None:
    """Refuse a study whose problem differs from an earlier one."""
    changed = _difference(earlier, problem_of(study))
    if changed:
        raise InputError(
            f"{study.source}: {changed} in the run whose cases are in {where}; undo that to continue from them, or "
            f"start again with --overwrite"
        )


def _without_limits(table: Table) -> Table:
    return {key: value for key, value in table.items() if key not in _LIMITS}


def _difference(old: Mapping[str, Any], new: Mapping[str, Any], *path: str) -> str:
    """The first difference of two tables in words, empty if there is none."""
    for name in {**new, **old}:
        place = [*path, name]
        if isinstance(old.get(name), Mapping) and isinstance(new.get(name), Mapping):
            words = _difference(old[name], new[name], *place)
        elif old.get(name) == new.get(name):
            words = ""
        elif isinstance(old.get(name, new.get(name)), Mapping):
            words = f"[{'.'.join(place)}] is {'new, and was not' if name in new else 'left out, and was'}"
        elif (place[0], name) in _FILES:
            words = f"[{'.'.join(path)}] {name} is not the same as"
        else:
            words = f"[{'.'.join(path)}] {name} is {_written(new.get(name))}, and was {_written(old.get(name))}"
        if words:
            return words
    if list(old) != list(new) and path == ("variables",):
        return "[variables] are in another order than"
    return ""


def _written(value: Any) -> str:
    return "left out" if value is None else json.dumps(value)
