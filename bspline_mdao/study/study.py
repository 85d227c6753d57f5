"""A study: read from TOML, checked key by key, with what is left out filled in."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ..errors import InputError
from ..names import ALL_NAMES
from ..om.drivers.nlopt_algorithms import ALGORITHMS
from .conditions import bare_outputs, of_conditions, resolved_conditions, weights_of
from .expressions import is_arithmetic, names_in, renamed
from .keys import (
    CONDITIONS,
    CONSTRAINT,
    DRIVER,
    FLOWS,
    GRID,
    MEASURES,
    MOVEMENT,
    OBJECTIVE,
    OUTPUT,
    QUALITIES,
    SCIPY,
    VARIABLES,
    Key,
)
from .toml_lines import key_lines, line_of

__all__ = ["CASES", "Study", "read_study"]

Table = dict[str, Any]
"""Values by key; what was left out is there with its default, or None."""

_TABLES = (
    *("grid", "variables", "measures", "flow", "conditions", "objective", "constraints"),
    *("movement", "driver", "output"),
)
_TAKEN = ("CM", "Cp", "states", "Mach_number", "CL_target", "flow", "grid_movement")
"""Other inputs, outputs and subsystems of the problem."""

_MAX_BYTES = 2**20

CASES = "cases.sql"
"""File of the recorded cases among the results."""


@dataclass(frozen=True, eq=False)
class Study:
    """What a study file says.

    Parameters
    ----------
    source : Path
        The file.
    grid, objective, movement, driver, output : dict
        Tables of these names.
    flow : dict or None
        The flow, if there is one.
    conditions : dict of dict
        Flight conditions by name, see `resolved_conditions`; none where the flow is at one condition, its own.
    variables, measures, constraints : dict of dict
        Tables by name, in the order of the file. Measures are all that are asked for, those without a table as well.
        Constraints of one condition are named as in ``cruise.CL``.
    """

    source: Path
    grid: Table
    variables: dict[str, Table]
    measures: dict[str, Table]
    flow: Table | None
    conditions: dict[str, Table]
    objective: Table
    constraints: dict[str, Table]
    movement: Table
    driver: Table
    output: Table

    @property
    def is_fitted(self) -> bool:
        """Whether the grid is that of a fitted model."""
        return Path(self.grid["file"]).suffix == ".h5"

    @property
    def is_built_in(self) -> bool:
        """Whether the grid is a built-in one."""
        return self.grid["file"].startswith("@")

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that it names, by their keys in ``[grid]``."""
        names = {key: self.grid[key] for key in ("file", "patches")}
        return {key: self.source.parent / name for key, name in names.items() if name and not name.startswith("@")}

    @property
    def suffix(self) -> str:
        """Suffix of the grids that are written."""
        return self.output["grid"] or ("cgns" if Path(self.grid["file"]).suffix == ".cgns" else "xyz")

    @property
    def results(self) -> list[str]:
        """Files that its script writes; the page as well, unless it is left out."""
        page = ["report.html"] if self.output["report"] is not False else []
        return ["model.h5", *self._grids, CASES, "summary.csv", *page]

    @property
    def folders(self) -> list[str]:
        """Folders that its script writes files to."""
        return [name.removesuffix(".vtm") for name in self._grids if name.endswith(".vtm")]

    @property
    def _grids(self) -> list[str]:
        return [f"grid_{when}.{self.suffix}" for when in ("before", "after")]

    @property
    def responses(self) -> list[str]:
        """What objective and constraints are of, each once."""
        asked = [self.objective["of"], *(table["of"] for table in self.constraints.values())]
        return list(dict.fromkeys(asked))


def read_study(path: Path | str) -> Study:
    """Read a study and check it.

    Parameters
    ----------
    path : path-like
        TOML file.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        If it cannot be read, or something in it cannot be used: with the line, what is allowed, and what was probably
        meant.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path}: is longer than {_MAX_BYTES} bytes; is this a study?")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        advice = "give a study, or draft one with 'bspline-mdao init GRID -o study.toml'"
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); {advice}") from error
    except ValueError as error:
        raise InputError(f"{path}: is not text; give a study in TOML") from error
    return _Reader(path, text).study()


class _Reader:
    """Checks the tables of a study one after the other."""

    def __init__(self, path: Path, text: str):
        self.path = path
        try:
            self.document = tomlkit.parse(text).unwrap()
        except (TOMLKitError, ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
            line = getattr(error, "line", None)
            at = f"line {line}: " if line else ""
            raise InputError(f"{path}: {at}is not TOML ({' '.join(str(error).split())[:160]})") from error
        self.lines = key_lines(text)

    def study(self) -> Study:
        self._known(self.document, _TABLES, (), "table")
        grid = self._table("grid", GRID)
        self._check_grid(grid)
        flow = self._flow()
        conditions = self._conditions(flow)
        self.outputs = (*_outputs(flow), *of_conditions(conditions, _outputs(flow)))
        variables = self._variables(flow, conditions)
        declared = self._measures()
        objective = self._table("objective", OBJECTIVE)
        paths = self._constraint_paths(conditions)
        constraints = {".".join(path): self._constraint(*path) for path in paths}
        asked: dict[tuple[str, ...], str] = {("objective", "of"): objective["of"]}
        asked |= {("constraints", *path, "of"): constraints[".".join(path)]["of"] for path in paths}
        measures = self._all_measures(declared, asked, flow, conditions)
        self._names(variables, measures, conditions)
        self._responses(asked, measures)
        if conditions and bare_outputs(names_in(objective["of"])) and not weights_of(conditions):
            raise self.refuse(("conditions",), "have no weight above 0, and the objective is a mean of theirs")
        driver = self._driver(constraints)
        movement, output = self._movement(), self._table("output", OUTPUT)
        return Study(
            self.path, grid, variables, measures, flow, conditions, objective, constraints, movement, driver, output
        )  # fmt: skip

    def _movement(self) -> Table:
        """Read what moves the control mesh."""
        movement = self._table("movement", MOVEMENT)
        for name in ("increments", "poisson_ratio") if movement["mover"] != "elasticity" else ():
            if name in self.document.get("movement", {}):
                raise self.refuse(("movement", name), 'is of elasticity; add mover = "elasticity", or leave it out')
        return movement

    def refuse(self, path: Sequence[str], complaint: str) -> InputError:
        """Make the error that names file, line and key."""
        line = line_of(self.lines, tuple(path))
        what = "".join(f"[{'.'.join(path[:-1])}] " if len(path) > 1 else "") + (f"'{path[-1]}' " if path else "")
        return InputError(f"{self.path}: {f'line {line}: ' if line else ''}{what}{complaint}")

    def _known(self, table: Mapping, allowed: Iterable[str], path: tuple[str, ...], what: str = "key") -> None:
        """Refuse a misspelt key."""
        for name in table:
            if name not in allowed:
                raise self.refuse((*path, name), f"is no {what}; {_choices(name, allowed, f'the {what}s are')}")

    def _table(self, name: str, keys: Mapping[str, Key], *sub: str) -> Table:
        """Read one table: values by key, defaults where they are left out."""
        path, found = (name, *sub), self.document
        for part in path:
            found = found.get(part, {})
        if not isinstance(found, Mapping):
            raise self.refuse(path, f"is no table; write [{'.'.join(path)}] and its keys below")
        self._known(found, keys, path)
        for key, spec in keys.items():
            if key not in found and spec.is_required:
                raise self.refuse((*path,), f"has no key '{key}' ({spec.meaning}); give {spec.kind.words}")
            if key in found and not spec.kind.accepts(found[key]):
                raise self.refuse((*path, key), f"is {found[key]!r}; give {spec.kind.words}")
        return {key: found.get(key, spec.default) for key, spec in keys.items()}

    def _named(self, name: str) -> list[str]:
        """Names of the tables in a table."""
        tables = self.document.get(name, {})
        if not isinstance(tables, Mapping):
            raise self.refuse((name,), f"is no table; write [{name}.NAME] for each of them")
        for sub, table in tables.items():
            if not isinstance(table, Mapping):
                raise self.refuse((name, sub), f"is no table; write [{name}.{sub}] and its keys below")
            if not sub.isidentifier():
                raise self.refuse(
                    (name, sub), "is no name; give one of letters, digits and _ that starts with a letter"
                )
        return list(tables)

    def _kind(self, name: str, sub: str, kinds: Iterable[str]) -> str:
        """Kind of a table: what its key says, or its name."""
        kind = self.document[name][sub].get("kind", sub)
        if kind not in kinds:
            path = (name, sub, "kind") if "kind" in self.document[name][sub] else (name, sub)
            said = f"is '{kind}', which is no kind" if len(path) == 3 else "is no kind, and has no key 'kind'"
            raise self.refuse(path, f"{said}; {_choices(str(kind), kinds, 'the kinds are')}")
        return str(kind)

    def _check_grid(self, grid: Table) -> None:
        """Refuse what a fitted model has already, and files that are not there."""
        if Path(grid["file"]).suffix == ".h5":
            for key in ("patches", "n_control", "order", "corrections"):
                if key in self.document["grid"]:
                    raise self.refuse(("grid", key), "does not go with a fitted model, which has it; leave it out")
        for key in ("file", "patches"):
            name = grid[key]
            if name and not name.startswith("@") and not (self.path.parent / name).is_file():
                raise self.refuse(("grid", key), f"names '{name}', and there is no such file beside {self.path.name}")

    def _flow(self) -> Table | None:
        if "flow" not in self.document:
            return None
        flow = self.document["flow"]
        kind = flow.get("kind", "lattice") if isinstance(flow, Mapping) else "lattice"
        if kind not in FLOWS:
            raise self.refuse(("flow", "kind"), f"is {kind!r}; {_choices(str(kind), FLOWS, 'the flows are')}")
        table = self._table("flow", FLOWS[kind].keys)
        if table.get("trim") and table["CL_target"] is None and "conditions" not in self.document:
            raise self.refuse(("flow", "trim"), "needs the lift that is wanted; give CL_target")
        if table.get("trim") is False and table["CL_target"] is not None:
            raise self.refuse(("flow", "CL_target"), "is for a trimmed flow; give trim = true, or leave it out")
        if table.get("trim") and "alpha" in flow:
            raise self.refuse(("flow", "alpha"), "is solved for where trim is true; leave one of the two out")
        return table

    def _conditions(self, flow: Table | None) -> dict[str, Table]:
        """Flight conditions, with what they leave out filled in."""
        names = self._named("conditions")
        if flow is None:
            if "conditions" in self.document:
                raise self.refuse(("conditions",), "are those of a flow, and there is none; add [flow]")
            return {}
        kind = flow["kind"]
        for name in names:
            if kind == "lattice" and "CL_target" in self.document["conditions"][name]:
                raise self.refuse(
                    ("conditions", name, "CL_target"), "is for euler, which solves for alpha; with a lattice constrain "
                    f"{name}.CL and make alpha a variable by [variables.alpha]"
                )  # fmt: skip
        given = {name: self._table("conditions", CONDITIONS[kind], name) for name in names}
        return resolved_conditions(given, flow, self.refuse)

    def _constraint_paths(self, conditions: Iterable[str]) -> list[tuple[str, ...]]:
        """Paths of the tables of constraints, those of conditions below [constraints]."""
        found: list[tuple[str, ...]] = []
        for name in self._named("constraints"):
            table = self.document["constraints"][name]
            inner = [key for key, value in table.items() if isinstance(value, Mapping)]
            if name in conditions:
                flat = [key for key in table if key not in inner]
                if flat:
                    raise self.refuse(
                        ("constraints", name, flat[0]), f"is of no response; write [constraints.{name}.CL] or the like "
                        f"for a constraint of the condition {name}"
                    )  # fmt: skip
                for key in inner:
                    if not key.isidentifier():
                        raise self.refuse(("constraints", name, key), "is no name; give one of letters, digits and _")
                found += [(name, key) for key in inner]
            elif inner and inner[0] not in CONSTRAINT:
                raise self.refuse(("constraints", name), self._no_condition(name, conditions))
            else:
                found.append((name,))
        return found

    def _no_condition(self, name: str, conditions: Iterable[str]) -> str:
        known = list(conditions)
        choices = _choices(name, known, "the conditions are") if known else f"add [conditions.{name}]"
        return f"is no condition; {choices}"

    def _variables(self, flow: Table | None, conditions: Mapping[str, Table]) -> dict[str, Table]:
        found = {}
        for name in self._named("variables"):
            kind = self._kind("variables", name, VARIABLES)
            table = self._table("variables", VARIABLES[kind].all_keys, name) | {"kind": kind}
            free = [condition for condition, values in conditions.items() if not values["trim"]]
            self._check_bounds(name, table, len(free) if conditions else 1)
            if kind == "alpha" and name != "alpha":
                raise self.refuse(("variables", name), "is the angle of attack; call it [variables.alpha]")
            if kind == "alpha" and conditions and not free:
                raise self.refuse(("variables", name), "is solved for at all conditions; leave it out")
            if kind == "alpha" and (flow is None or (flow.get("trim") and not conditions)):
                lacks = "there is no [flow]" if flow is None else "it is solved for where trim is true"
                raise self.refuse(("variables", name), f"is an input of the flow, and {lacks}; leave one of them out")
            found[name] = table
        if not found:
            raise self.refuse(("variables",), "is empty; give a table such as [variables.twist] with lower and upper")
        return found

    def _check_bounds(self, name: str, table: Table, n_alpha: int) -> None:
        """Refuse lists of other lengths than there are values, and bounds that leave nothing between them."""
        stations, chosen = table.get("stations"), table.get("values")
        n = len(stations) if isinstance(stations, list) else stations
        if chosen and n and (max(chosen) > n or len(set(chosen)) < len(chosen)):
            raise self.refuse(("variables", name, "values"), f"is {chosen}; there are {n} stations, name each once")
        n_values = {"taper": 1, "alpha": n_alpha}.get(table["kind"], len(chosen) if chosen else n)
        for key in ("lower", "upper", "start"):
            given = table[key]
            n_wanted = n if key == "start" and chosen else n_values
            if isinstance(given, list) and len(given) != n_wanted:
                wanted = f"one number, or {n_wanted}" if n_wanted else "one number for all"
                raise self.refuse(("variables", name, key), f"has {len(given)} numbers; give {wanted}")
        lower, upper = (_as_list(table[key], n_values or 1) for key in ("lower", "upper"))
        if any(a >= b for a, b in zip(lower, upper)):
            raise self.refuse(("variables", name, "upper"), f"is {table['upper']}, not above lower = {table['lower']}")

    def _measures(self) -> dict[str, Table]:
        found = {}
        for name in self._named("measures"):
            kind = self._kind("measures", name, MEASURES)
            found[name] = self._table("measures", MEASURES[kind].all_keys, name) | {"kind": kind}
        return found

    def _constraint(self, *path: str) -> Table:
        table, name = self._table("constraints", CONSTRAINT, *path), ".".join(path)
        of = table["of"] or path[-1]
        in_condition = len(path) == 2 and bare_outputs(names_in(of))
        table["of"] = renamed(of, lambda n: f"{path[0]}.{n}" if n in in_condition else n) if in_condition else of
        given = [key for key in ("lower", "upper", "equals") if table[key] is not None]
        if not given or ("equals" in given and len(given) > 1):
            raise self.refuse(("constraints", name), "has to have lower or upper or both, or equals alone")
        if table["lower"] is not None and table["upper"] is not None and table["lower"] >= table["upper"]:
            raise self.refuse(("constraints", name, "upper"), "is not above lower; give equals for one value")
        return table

    def _all_measures(
        self, declared: dict[str, Table], asked: Mapping, flow: Table | None, conditions: Iterable[str]
    ) -> dict[str, Table]:
        """Measures that are declared, and those that are asked for by the name of their kind."""
        found = dict(declared)
        for path, of in asked.items():
            for name in names_in(of):
                if name in MEASURES and name not in found:
                    defaults = {key: spec.default for key, spec in MEASURES[name].all_keys.items()}
                    found[name] = defaults | {"kind": name}
                elif name not in (*found, *QUALITIES, *self.outputs):
                    raise self.refuse(self._written(path), self._unknown(of, name, found, flow, conditions))
        return found

    def _unknown(
        self, of: str, name: str, measures: Iterable[str], flow: Table | None, conditions: Iterable[str]
    ) -> str:
        said = f"is of '{name}', which there is not" if of == name else f"is '{of}'; there is no '{name}'"
        condition, _, output = name.rpartition(".")
        if condition and condition not in conditions:
            return f"{said}: '{condition}' {self._no_condition(condition, conditions)}"
        if output in FLOWS["euler"].outputs:
            lack = "add [flow]" if flow is None else 'take kind = "euler" in [flow]'
            return f"{said} without another flow; {lack}"
        return f"{said}; {_choices(name, [*self.outputs, *MEASURES, *measures, *QUALITIES], 'there are')}"

    def _written(self, path: tuple[str, ...]) -> tuple[str, ...]:
        """Path of a key, or of its table where the key is left out."""
        return path if path in self.lines else path[:-1]

    def _responses(self, asked: Mapping, measures: dict[str, Table]) -> None:
        """Refuse expressions and objectives of what is not one number."""
        for path, of in asked.items():
            is_expression = of not in (*measures, *QUALITIES, *self.outputs)
            if is_expression and not is_arithmetic(of):
                raise self.refuse(
                    self._written(path), f"is '{of}'; give a name, or names and numbers with + - * / ** ( )"
                )
            if is_expression and not names_in(of):
                raise self.refuse(self._written(path), f"is '{of}', which depends on nothing")
            if path[0] == "objective" or is_expression:
                for name in names_in(of):
                    if name in measures and not MEASURES[measures[name]["kind"]].is_number:
                        raise self.refuse(path, f"is of '{name}', which is several numbers; constrain it instead")

    def _names(self, variables: Iterable[str], measures: Iterable[str], conditions: Iterable[str]) -> None:
        """Refuse names that are taken."""
        taken = {*ALL_NAMES, *QUALITIES, *FLOWS["euler"].outputs, *_TAKEN}
        groups = (("variables", variables), ("measures", measures), ("conditions", conditions))
        for group, names in groups:
            for name in names:
                if name in taken and (group, name) in self.lines:
                    raise self.refuse(
                        (group, name), "is a name that something else has; choose another one and give kind"
                    )
        for name in conditions:
            if name in variables or name in measures:
                raise self.refuse(
                    ("conditions", name), "is the name of a variable or a measure as well; choose another"
                )
        for name in measures:
            if name in variables:
                raise self.refuse(
                    ("variables", name),
                    'is the name of a measure as well; call the variable otherwise, with kind = "' + name + '"',
                )

    def _driver(self, constraints: Mapping[str, Table]) -> Table:
        driver = self._table("driver", DRIVER)
        name = driver["optimizer"]
        if name not in ALGORITHMS and name not in SCIPY:
            choices = _choices(name, [*SCIPY, *ALGORITHMS], "those of SciPy are", shown=list(SCIPY))
            raise self.refuse(
                ("driver", "optimizer"), f"is '{name}', which is none; {choices}, of NLopt LD_SLSQP, LD_MMA, ..."
            )
        driver["options"] = driver["options"] or {}
        for option in driver["options"]:
            if option in _own_options(name):
                key = "tolerance" if option in ("tol", "ftol_rel") else "max_iterations"
                key = "optimizer" if option == "optimizer" else key
                raise self.refuse(
                    ("driver", "options"), f"has '{option}', which is the key {key} of [driver]; give that"
                )
        if name in SCIPY:
            takes_inequality, takes_equality = SCIPY[name]
            for constraint, table in constraints.items():
                if not (takes_equality if table["equals"] is not None else takes_inequality):
                    what = "equals" if table["equals"] is not None and takes_inequality else "constraints"
                    raise self.refuse(
                        ("constraints", *constraint.split(".")),
                        f"does not go with the optimizer {name}, which takes no {what}; take SLSQP or LD_SLSQP",
                    )
        return driver


def _own_options(optimizer: str) -> tuple[str, ...]:
    """Options of a driver that keys of ``[driver]`` set."""
    return ("optimizer", "tol", "maxiter") if optimizer in SCIPY else ("optimizer", "ftol_rel", "maxeval")


def _outputs(flow: Table | None) -> tuple[str, ...]:
    """Outputs of the flow that are one number."""
    return () if flow is None else FLOWS[flow["kind"]].outputs


def _as_list(value: float | list[float], n: int) -> list[float]:
    return list(value) if isinstance(value, list) else [value] * n


def _choices(name: str, allowed: Iterable[str], words: str, shown: list[str] | None = None) -> str:
    """Say what was probably meant, and what is allowed."""
    names = list(dict.fromkeys(map(str, allowed)))
    by_letters = {known.lower(): known for known in names}
    near = [known for known in by_letters if known.startswith(name.lower())]
    near = get_close_matches(name.lower(), by_letters, n=1) or near
    meant = f"did you mean '{by_letters[near[0]]}'? " if near else ""
    return f"{meant}{words} {', '.join(names if shown is None else shown)}"
