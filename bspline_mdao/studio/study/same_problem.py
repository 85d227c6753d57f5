"""Whether two studies pose one problem, so that the cases of the one are worth something to the other."""

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
"""Keys of variables, objective and constraints that may change: values of the model at a design stay."""

_FILES = ("grid", "file"), ("grid", "patches"), ("variables", "file"), ("variables", "to")
"""Tables, and keys of theirs that name files."""


def problem_of(study: Study) -> dict[str, Any]:
    """What the values of a study's model depend on, table by table, as JSON gives it back; files by their digests."""
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
    earlier: Mapping[str, Any],  # what `problem_of` gave of the one before
    where: str,  # where its run was, for the message
) -> None:
    """Refuse a study that poses another problem than one before."""
    changed = _difference(earlier, problem_of(study))
    if changed:
        raise InputError(
            f"{study.source}: {changed} in the run that {where} has cases of; undo that to go on from them, or begin "
            f"anew with --overwrite"
        )


def _without_limits(table: Table) -> Table:
    return {key: value for key, value in table.items() if key not in _LIMITS}


def _difference(old: Mapping[str, Any], new: Mapping[str, Any], *path: str) -> str:
    """The first difference of two tables in words, empty where there is none."""
    for name in {**new, **old}:
        place = [*path, name]
        if isinstance(old.get(name), Mapping) and isinstance(new.get(name), Mapping):
            words = _difference(old[name], new[name], *place)
        elif old.get(name) == new.get(name):
            words = ""
        elif isinstance(old.get(name, new.get(name)), Mapping):
            words = f"[{'.'.join(place)}] is {'new, and was not' if name in new else 'left out, and was'}"
        elif (place[0], name) in _FILES:
            words = f"[{'.'.join(path)}] {name} is another one than"
        else:
            words = f"[{'.'.join(path)}] {name} is {_written(new.get(name))}, and was {_written(old.get(name))}"
        if words:
            return words
    if list(old) != list(new) and path == ("variables",):
        return "[variables] are in another order than"
    return ""


def _written(value: Any) -> str:
    return "left out" if value is None else json.dumps(value)
