"""Reads a study from TOML, key by key, and fills in the defaults.

Consistency is checked table by table, in the order in which they are read.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path

from ...core.cad.files import SUFFIXES
from ...core.generators.built_in import generator_of
from ...core.om.drivers.nlopt_algorithms import ALGORITHMS
from ...errors import InputError
from ...grids.io.formats import POLYMESH
from .conditions import bare_outputs, of_conditions, resolved_conditions, weights_of
from .expressions import fault_of, is_name, names_in, renamed
from .grid_kinds import kind_of
from .keys import (
    CONDITIONS,
    CONSTRAINT,
    DRIVER,
    FLOWS,
    GRID,
    JUNCTION,
    MEASURES,
    MOST_NODES,
    MOVEMENT,
    OBJECTIVE,
    OUTPUT,
    QUALITIES,
    SCIPY,
)
from .kinds import NAMES, slices_of
from .names import choices, fault_of_name, shortened
from .options import fault_of_option, fault_of_options, options_of
from .responses import constraint_responses, objective_response
from .study import CAD_KINDS, Study, count_values
from .tables import Table, Tables
from .variable_kinds import VARIABLES

__all__ = ["read_study"]

_TABLES = (
    *("families", "grid", "variables", "measures", "flow", "conditions", "objective", "constraints"),
    *("junction", "movement", "driver", "output"),
)


def read_study(
    path: Path | str,  # TOML file
) -> Study:
    """Read a study and check it."""
    advice = "give a study, or draft one with 'bspline-mdao init GRID -o study.toml'"
    return _Reader.read(Path(path), "a study", advice).study()


class _Reader(Tables):
    """Checks the tables of a study in order."""

    def study(self) -> Study:
        self.known(self.document, _TABLES, (), "table")
        self.families = self._families()
        grid = self.table("grid", GRID)
        self._check_grid(grid)
        flow = self._flow()
        conditions = self._conditions(flow)
        self.outputs = (*_outputs(flow), *of_conditions(conditions, _outputs(flow)))
        variables = self._variables(flow, conditions)
        declared = self._measures()
        objective = self.table("objective", OBJECTIVE)
        objective["of"] = self._expression(("objective", "of"), objective["of"])
        paths = self._constraint_paths(conditions)
        constraints = {".".join(path): self._constraint(*path) for path in paths}
        asked: dict[tuple[str, ...], str] = {("objective", "of"): objective["of"]}
        asked |= {("constraints", *path, "of"): constraints[".".join(path)]["of"] for path in paths}
        measures = self._all_measures(declared, asked, flow, conditions)
        self._names(variables, measures, conditions)
        self._numbers(asked, measures)
        if conditions and bare_outputs(names_in(objective["of"])) and not weights_of(conditions):
            raise self.refuse(("conditions",), "have no weight above 0, and the objective is a mean of theirs")
        self._check_responses(objective, constraints, conditions)
        evened = self._evened(variables, flow, conditions)
        driver = self._driver(constraints, sum(map(count_values, variables.values())), evened)
        junction = self._junction(variables)
        movement, output = self._movement(), self.table("output", OUTPUT)
        kind = kind_of(grid["file"], self.path.parent)
        for path, complaint in kind.faults(self.document, asked):
            raise self.refuse(self._written(path), complaint)
        return Study(
            self.path, grid, variables, measures, flow, conditions, objective, constraints, junction, movement, driver,
            output,
        )  # fmt: skip

    def _families(self) -> dict[str, list[str]]:
        """Patches by the name of their family."""
        families = self.document.get("families", {})
        if not isinstance(families, Mapping):
            raise self.refuse(("families",), 'is no table; write [families] and below it lines such as flap = "flap_*"')
        for name, patches in families.items():
            if fault := fault_of_name("families", name):
                raise self.refuse(("families", name), fault)
            if not NAMES.accepts(patches):
                raise self.refuse(("families", name), f"is {shortened(repr(patches))}; give {NAMES.words}")
        return {name: [patches] if isinstance(patches, str) else patches for name, patches in families.items()}

    def _junction(self, variables: Iterable[str]) -> Table | None:
        """The junction of a wing that slides on a body; None without one."""
        if "junction" not in self.document:
            return None
        junction = self.table("junction", JUNCTION)
        if not junction["rigid"] < junction["reach"]:
            said = f"is {junction['rigid']:g}; give less than reach, which is {junction['reach']:g}"
            raise self.refuse(("junction", "rigid"), said)
        shape = junction["shape"] or []
        for name in [shape] if isinstance(shape, str) else shape:
            if name not in variables:
                said = f"names '{shortened(name)}', which is no variable; {choices(name, variables, 'there are')}"
                raise self.refuse(("junction", "shape"), said)
        return junction

    def _movement(self) -> Table:
        """Read the settings of the mover."""
        movement = self.table("movement", MOVEMENT)
        for name in ("increments", "poisson_ratio") if movement["mover"] != "elasticity" else ():
            if name in self.document.get("movement", {}):
                raise self.refuse(("movement", name), 'is for elasticity; add mover = "elasticity", or leave it out')
        return movement

    def _check_grid(self, grid: Table) -> None:
        """Refuse files that do not exist."""
        for key in ("file", "patches"):
            name = grid[key]
            if key == "file" and name.startswith("@"):
                try:
                    generator_of(name)
                except InputError as error:
                    said = f"is '{shortened(name)}', which {str(error).partition(': ')[2]}"
                    raise self.refuse(("grid", key), said) from None
            elif name:
                self._require_file(("grid", key), name)

    def _flow(self) -> Table | None:
        if "flow" not in self.document:
            return None
        flow = self.document["flow"]
        kind = flow.get("kind", "lattice") if isinstance(flow, Mapping) else "lattice"
        if not isinstance(kind, str) or kind not in FLOWS:
            said = shortened(repr(kind))
            raise self.refuse(("flow", "kind"), f"is {said}; {choices(str(kind), FLOWS, 'the flows are')}")
        table = self.table("flow", FLOWS[kind].keys)
        if kind == "lattice" and table["n_chord"] * table["n_span"] > MOST_NODES:
            said = (
                f"makes {table['n_chord'] * table['n_span']:,} nodes of n_chord x n_span; give {MOST_NODES:,} at most"
            )
            raise self.refuse(("flow", "n_span"), said)
        if table.get("trim") and table["CL_target"] is None and "conditions" not in self.document:
            raise self.refuse(("flow", "trim"), "needs a target lift; give CL_target")
        if table.get("trim") is False and table["CL_target"] is not None:
            raise self.refuse(("flow", "CL_target"), "is for a trimmed flow; give trim = true, or leave it out")
        if table.get("trim") and "alpha" in flow:
            raise self.refuse(("flow", "alpha"), "is solved for if trim is true; leave one of them out")
        return table

    def _conditions(self, flow: Table | None) -> dict[str, Table]:
        """Flight conditions, with defaults filled in."""
        names = self.named("conditions")
        if flow is None:
            if "conditions" in self.document:
                raise self.refuse(("conditions",), "need a flow, and there is none; add [flow]")
            return {}
        kind = flow["kind"]
        for name in names:
            if kind == "lattice" and "CL_target" in self.document["conditions"][name]:
                raise self.refuse(
                    ("conditions", name, "CL_target"), "is for euler, which solves for alpha; with a lattice constrain "
                    f"{name}.CL and make alpha a variable by [variables.alpha]"
                )  # fmt: skip
        given = {name: self.table("conditions", CONDITIONS[kind], name) for name in names}
        return resolved_conditions(given, flow, self.refuse)

    def _constraint_paths(self, conditions: Iterable[str]) -> list[tuple[str, ...]]:
        """Paths of the tables of constraints; constraints of conditions are below [constraints]."""
        found: list[tuple[str, ...]] = []
        for name in self.named("constraints"):
            table = self.document["constraints"][name]
            inner = [key for key, value in table.items() if isinstance(value, Mapping)]
            if name in conditions:
                flat = [key for key in table if key not in inner]
                if flat:
                    raise self.refuse(
                        ("constraints", name, flat[0]), f"names no response; write [constraints.{name}.CL] or the like "
                        f"for a constraint of the condition {name}"
                    )  # fmt: skip
                for key in inner:
                    if fault := fault_of_name("constraints", key):
                        raise self.refuse(("constraints", name, key), fault)
                found += [(name, key) for key in inner]
            elif inner and inner[0] not in CONSTRAINT:
                raise self.refuse(("constraints", name), self._no_condition(name, conditions))
            else:
                found.append((name,))
        return found

    def _no_condition(self, name: str, conditions: Iterable[str]) -> str:
        known = list(conditions)
        advice = choices(name, known, "the conditions are") if known else f"add [conditions.{shortened(name)}]"
        return f"is no condition; {advice}"

    def _variables(self, flow: Table | None, conditions: Mapping[str, Table]) -> dict[str, Table]:
        found: dict[str, Table] = {}
        for name in self.named("variables"):
            kind = self.kind("variables", name, VARIABLES)
            table = self.table("variables", VARIABLES[kind].all_keys, name) | {"kind": kind}
            free = [condition for condition, values in conditions.items() if not values["trim"]]
            self._check_bounds(name, table, len(free) if conditions else 1)
            self._check_points(name, table, found)
            if kind in CAD_KINDS:
                self._check_cad(name, table, found)
            if kind in ("rotation", "hinge"):
                self._check_hinge(name, table, found)
            if kind == "alpha" and name != "alpha":
                raise self.refuse(("variables", name), "is the angle of attack; call it [variables.alpha]")
            if kind == "alpha" and conditions and not free:
                raise self.refuse(("variables", name), "is solved for at all conditions; leave it out")
            if kind == "alpha" and (flow is None or (flow.get("trim") and not conditions)):
                lacks = "there is no [flow]" if flow is None else "it is solved for if trim is true"
                raise self.refuse(("variables", name), f"is an input of the flow, and {lacks}; leave one of them out")
            found[name] = table
        if not found:
            raise self.refuse(("variables",), "is empty; give a table such as [variables.twist] with lower and upper")
        return found

    def _check_points(self, name: str, table: Table, above: Mapping[str, Table]) -> None:
        """Refuse missing files and parents, and slices and boxes that select no point of a lattice."""
        file, parent = table.get("file"), table.get("parent")
        if file:
            self._require_file(("variables", name, "file"), file)
        if parent and above.get(parent, {}).get("kind") != "ffd":
            boxes = [other for other, each in above.items() if each["kind"] == "ffd"]
            advice = choices(parent, boxes, "there are") if boxes else "write the table of the outer box first"
            said = f"is '{shortened(parent)}', which is no box in a table above; {advice}"
            raise self.refuse(("variables", name, "parent"), said)
        low, high = table.get("low"), table.get("high")
        if low and high and any(a > b for a, b in zip(low, high)):
            raise self.refuse(("variables", name, "high"), f"is {high}, below low = {low} in a direction")
        if (low or high) and table.get("where"):
            raise self.refuse(("variables", name, "where"), "does not go with low and high; leave one of them out")
        for part, n in zip(slices_of(table.get("where") or "") or (), table.get("n", ())):
            if part not in range(-n, n) if isinstance(part, int) else not range(n)[part]:
                said = f"is '{table['where']}', which is no point of a lattice of {table['n']}"
                raise self.refuse(("variables", name, "where"), said)

    def _check_cad(self, name: str, table: Table, above: Mapping[str, Table]) -> None:
        """Refuse files that are missing or no CAD files, and two ways to tie walls to one file."""
        if "to" in table:
            table["to"] = [table["to"]] if isinstance(table["to"], str) else table["to"]
            for file in table["to"]:
                self._require_file(("variables", name, "to"), file)
        for key, files in (("file", [table["file"]]), ("to", table.get("to", ()))):
            for file in files:
                if Path(file).suffix.lower() not in SUFFIXES:
                    said = f"is '{shortened(file)}', no CAD file by its name; end it in {', '.join(SUFFIXES)}"
                    raise self.refuse(("variables", name, key), said)
        for other, each in ((o, e) for o, e in above.items() if e["kind"] in CAD_KINDS):
            for key in ("scale", "patches") if each["file"] == table["file"] else ():
                if each[key] != table[key]:
                    said = f"is of '{table['file']}', to which [variables.{other}] ties walls with another {key}"
                    raise self.refuse(("variables", name), f"{said}; give both the same")
            if each["file"] != table["file"] and Path(each["file"]).name == Path(table["file"]).name:
                said = f"has the name of another file in [variables.{other}], and results would overwrite each other"
                raise self.refuse(("variables", name, "file"), f"{said}; rename one of them")

    def _require_file(self, path: tuple[str, ...], name: str) -> None:
        """Refuse a missing file."""
        if not _is_file(self.path.parent / name):
            complaint = f"names '{shortened(name)}', and there is no such file next to {self.path.name}"
            raise self.refuse(path, complaint)

    def _check_hinge(self, name: str, table: Table, above: Mapping[str, Table]) -> None:
        """Refuse rotations about no axis or several axes, and rotations of nothing."""
        given = [key for key in ("axis", "chord", "hinge") if table.get(key) is not None]
        if len(given) != 1:
            choice = "axis, chord or hinge" if table["kind"] == "rotation" else "axis or chord"
            said = f"has {' and '.join(given) or 'no axis'}; give one of {choice}"
            raise self.refuse(("variables", name, *given[1:2]), said)
        if "span" in self.document["variables"][name] and given != ["chord"]:
            raise self.refuse(
                ("variables", name, "span"), "is for a hinge along the chord; give chord, or leave it out"
            )
        if given == ["hinge"] and above.get(table["hinge"], {}).get("kind") != "hinge":
            hinges = [other for other, each in above.items() if each["kind"] == "hinge"]
            advice = choices(table["hinge"], hinges, "there are") if hinges else "write the table of the hinge first"
            said = f"is '{shortened(table['hinge'])}', which is no hinge in a table above; {advice}"
            raise self.refuse(("variables", name, "hinge"), said)
        if table["kind"] == "rotation" and not (table["patches"] or table["blend"]):
            said = "does not say what rotates; give blend for what is behind the hinge, or patches, '*' for all of them"
            raise self.refuse(("variables", name), said)
        if table.get("ends") is not None and not table["blend"]:
            raise self.refuse(("variables", name, "ends"), "is for what is behind the hinge; give blend as well")

    def _check_bounds(self, name: str, table: Table, n_alpha: int) -> None:
        """Refuse lists whose length is not the number of values, and bounds with nothing between them."""
        stations, chosen = table.get("stations"), table.get("values")
        n = len(stations) if isinstance(stations, list) else stations
        if chosen and n and (max(chosen) > n or len(set(chosen)) < len(chosen)):
            raise self.refuse(("variables", name, "values"), f"is {chosen}; there are {n} stations, name each once")
        n_values = None if math.isinf(count := count_values(table, n_alpha)) else int(count)
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
        for name in self.named("measures"):
            kind = self.kind("measures", name, MEASURES)
            found[name] = self.table("measures", MEASURES[kind].all_keys, name) | {"kind": kind}
        return found

    def _expression(self, path: tuple[str, ...], of: str) -> str:
        """Expression of a key, in one line."""
        of = " ".join(of.split())
        if not is_name(of) and (fault := fault_of(of)):
            raise self.refuse(self._written(path), f"is '{shortened(of)}'; {fault}")
        return of

    def _constraint(self, *path: str) -> Table:
        table, name = self.table("constraints", CONSTRAINT, *path), ".".join(path)
        of = self._expression(("constraints", *path, "of"), table["of"] or path[-1])
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
        """Measures that are declared, and measures used by the name of their kind."""
        found = dict(declared)
        for path, of in asked.items():
            for name in names_in(of):
                if name in MEASURES and name not in found:
                    required = [key for key, spec in MEASURES[name].all_keys.items() if spec.is_required]
                    if required:
                        lacks = f"names '{name}' without [measures.{name}]; add it with {' and '.join(required)}"
                        raise self.refuse(self._written(path), lacks)
                    defaults = {key: spec.default for key, spec in MEASURES[name].all_keys.items()}
                    found[name] = defaults | {"kind": name}
                elif name not in (*found, *QUALITIES, *self.outputs):
                    raise self.refuse(self._written(path), self._unknown(of, name, found, flow, conditions))
        return found

    def _unknown(
        self, of: str, name: str, measures: Iterable[str], flow: Table | None, conditions: Iterable[str]
    ) -> str:
        said = f"names '{name}', which does not exist" if of == name else f"is '{of}'; there is no '{name}'"
        condition, _, output = name.rpartition(".")
        if condition and condition not in conditions:
            return f"{said}: '{condition}' {self._no_condition(condition, conditions)}"
        if output in FLOWS["euler"].outputs:
            lack = "add [flow]" if flow is None else 'take kind = "euler" in [flow]'
            return f"{said} without another flow; {lack}"
        return f"{said}; {choices(name, [*self.outputs, *MEASURES, *measures, *QUALITIES], 'there are')}"

    def _written(self, path: tuple[str, ...]) -> tuple[str, ...]:
        """Path of a key, or of its table if the key is left out."""
        return path if path in self.lines else path[:-1]

    def _numbers(self, asked: Mapping, measures: dict[str, Table]) -> None:
        """Refuse expressions and objectives of vectors."""
        for path, of in asked.items():
            is_expression = of not in (*measures, *QUALITIES, *self.outputs)
            if is_expression and not names_in(of):
                raise self.refuse(self._written(path), f"is '{of}', which depends on nothing")
            if path[0] == "objective" or is_expression:
                for name in names_in(of):
                    if name in measures and not MEASURES[measures[name]["kind"]].is_number:
                        raise self.refuse(path, f"names '{name}', which is several numbers; constrain it instead")

    def _names(self, variables: Iterable[str], measures: Iterable[str], conditions: Iterable[str]) -> None:
        """Refuse names that are taken."""
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

    def _check_responses(
        self,
        objective: Table,
        constraints: Mapping[str, Table],
        conditions: Mapping[str, Table],
    ) -> None:
        """Refuse two responses with the same output, and expressions with names that are taken."""
        first = objective_response(objective["of"], conditions)
        seen, made = {first.output: "[objective]"}, {first.component, *([first.output] if first.formula else [])}
        for name, table in constraints.items():
            path = ("constraints", *name.split("."))
            for response in constraint_responses(name, table["of"], conditions):
                if response.output in seen:
                    raise self.refuse(
                        path, f"names '{response.output}', as {seen[response.output]} does; leave one out"
                    )
                if response.component in made:
                    raise self.refuse(path, "is a name already in use; choose another one and give of")
                seen[response.output] = f"[constraints.{name}]"
                made |= {response.component, *([response.output] if response.formula else [])}
        for group in ("measures", "variables", "conditions"):
            for name in self.document.get(group, {}):
                if name in made:
                    raise self.refuse((group, name), "is the name of an expression as well; choose another one")

    def _evened(self, variables: Mapping[str, Table], flow: Table | None, conditions: Mapping[str, Table]) -> list[str]:
        """Variables that the driver sees as combinations."""
        path = ("driver", "even_pressures")
        names = self.table("driver", DRIVER)["even_pressures"] or []
        names = [names] if isinstance(names, str) else names
        if names and (flow is None or flow["kind"] != "euler" or conditions):
            raise self.refuse(path, "needs pressures of Euler flow at one condition; leave it out")
        for name in names:
            if name not in variables:
                said = f"names '{shortened(name)}', which is no variable; {choices(name, variables, 'there are')}"
                raise self.refuse(path, said)
            if not VARIABLES[variables[name]["kind"]].made_by:
                raise self.refuse(path, f"names '{name}', which moves no surface; leave that out")
            if f"{name}_combinations" in variables:
                raise self.refuse(
                    ("variables", f"{name}_combinations"), f"is what [driver] makes of '{name}'; rename it"
                )
            if given := [key for key in ("start", "values") if variables[name].get(key) is not None]:
                raise self.refuse(path, f"does not go with '{given[0]}' of [variables.{name}]; leave one of both out")
        return names

    def _driver(self, constraints: Mapping[str, Table], n_variables: float, evened: Iterable[str]) -> Table:
        driver = self.table("driver", DRIVER)
        name = driver["optimizer"]
        if name not in ALGORITHMS and name not in SCIPY:
            advice = choices(name, [*SCIPY, *ALGORITHMS], "those of SciPy are", listed=list(SCIPY))
            said = f"is '{shortened(name)}', which is none; {advice}, of NLopt LD_SLSQP, LD_MMA, ..."
            raise self.refuse(("driver", "optimizer"), said)
        driver["options"] = driver["options"] or {}
        options = options_of(driver)
        for option, value in driver["options"].items():
            if fault := fault_of_option(driver, options, option, value):
                raise self.refuse(("driver", "options", option), fault)
        if name in SCIPY:
            takes_inequality, takes_equality = SCIPY[name]
            if evened and not takes_inequality:
                said = f"does not go with the optimizer {name}, which takes no constraints; take SLSQP or LD_SLSQP"
                raise self.refuse(("driver", "even_pressures"), said)
            for constraint, table in constraints.items():
                if not (takes_equality if table["equals"] is not None else takes_inequality):
                    what = "equals" if table["equals"] is not None and takes_inequality else "constraints"
                    raise self.refuse(
                        ("constraints", *constraint.split(".")),
                        f"does not go with the optimizer {name}, which takes no {what}; take SLSQP or LD_SLSQP",
                    )
            return driver
        bounded: dict[str, Table] = {**constraints, **{each: {"equals": None} for each in evened}}
        if fault := fault_of_options(options, bounded, n_variables):
            raise self.refuse(("driver",), f"has contradictory options: {fault}")
        return driver


def _is_file(path: Path) -> bool:
    """Whether a file, or OpenFOAM's folder, exists; impossible file names do not."""
    try:
        return path.is_file() or (path.name == POLYMESH and path.is_dir())
    except (OSError, ValueError):
        return False


def _outputs(flow: Table | None) -> tuple[str, ...]:
    """Scalar outputs of the flow."""
    return () if flow is None else FLOWS[flow["kind"]].outputs


def _as_list(value: float | list[float], n: int) -> list[float]:
    return list(value) if isinstance(value, list) else [value] * n
