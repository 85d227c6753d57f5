"""The Python script that a study stands for: the command ``optimize`` runs it, and so can anyone."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .conditions import bare_outputs, of_conditions, weights_of
from .expressions import is_name, names_in, renamed
from .keys import FLOWS, MEASURES, MOVEMENT, QUALITIES, SCIPY, VARIABLES, Key
from .study import Study, Table

__all__ = ["SCRIPT", "study_script"]

SCRIPT = "optimize.py"
"""Name of the script in the folder of the results."""

FINER = 1.5
"""Cells per direction of the grid that lift and drag are estimated for, relative to those of the grid."""

_WIDTH = 120
"""Longest line."""

DRAG = ("CD", "CD_induced", "CD_entropy")
"""Objectives of which a hundredth is the unit."""

_HEAD = '''"""{title}

Written and run by ``bspline-mdao optimize {source}``: the results beside it are those of this script, which writes
them anew when it is run again. Go on from here where a study ends.
"""

from pathlib import Path

{imports}import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.numerics.processes import together, world

HERE = Path(__file__).resolve().parent
IS_FIRST = world().rank == 0  # of several processes, under mpirun, the first one writes
'''


def study_script(study: Study, folder: Path, generator: str = "", earlier: Path | None = None) -> str:
    """Write the script of a study.

    Parameters
    ----------
    study : Study
        The study.
    folder : Path
        Folder of the script: names of files in it are relative to that.
    generator : str
        Call that makes the grid, where it is a built-in one.
    earlier : Path, optional
        Case file of another run, from whose best design it goes on.

    Returns
    -------
    str
        Python.
    """
    lines = _Script(study, folder, generator, earlier).lines()
    return "\n".join(part for line in lines for part in _folded(line)) + "\n"


def _folded(line: str) -> list[str]:
    """Fold a line that is too long: what stands in its last outermost brackets goes below, one thing a line."""
    if len(line) <= _WIDTH or "\n" in line:
        return [line]
    depth, start, commas = 0, 0, list[int]()
    for place, letter in enumerate(line):
        if letter in "([{":
            depth += 1
            if depth == 1:
                start, commas = place + 1, []
        elif letter in ")]}":
            depth -= 1
        elif letter == "," and depth == 1:
            commas.append(place)
    end = max(line.rfind(bracket) for bracket in ")]}")
    cuts = [start, *(comma + 1 for comma in commas if comma < end), end]
    indent = " " * (len(line) - len(line.lstrip()))
    items = [f"{indent}    {line[a:b].strip().rstrip(',')}," for a, b in zip(cuts, cuts[1:])]
    return [line[:start], *(part for item in items for part in _folded(item)), indent + line[end:]]


class _Script:
    """Writes the parts of a script one after the other."""

    def __init__(self, study: Study, folder: Path, generator: str, earlier: Path | None):
        self.study, self.folder, self.generator, self.earlier = study, folder, generator, earlier

    def lines(self) -> Iterator[str]:
        """Lines of the script."""
        objective = self.study.objective
        verb = "Largest" if objective["maximize"] else "Least"
        imports = "import numpy as np\n" if self._needs_numpy else ""
        title = f"{verb} {objective['of']} of {self.study.grid['file']}."
        yield _HEAD.format(title=title, source=self.study.source.name, imports=imports)
        yield from self._model()
        yield from self._shape()
        yield from self._problem()
        yield from self._run()

    @property
    def _needs_numpy(self) -> bool:
        return any(table.get("where") for table in self.study.variables.values())

    def _model(self) -> Iterator[str]:
        """The fitted model and its design surface."""
        grid = self.study.grid
        if self.study.is_fitted:
            yield f"model = bm.FittedModel.load({self._path(grid['file'])})"
        else:
            patches = f", {self._path(grid['patches'])}" if grid["patches"] else ""
            if not self.study.is_built_in:
                made = f"bm.read_grid({self._path(grid['file'])}{patches})"
            elif patches:
                made = f"read_patches({self._path(grid['patches'])}, {self.generator})"
                yield "from bspline_mdao.io.patches import read_patches  # noqa: E402\n"
            else:
                made = self.generator
            settings = {key: grid[key] for key in ("n_control", "order") if grid[key] is not None}
            settings |= {"corrections": grid["corrections"]} if grid["corrections"] else {}
            yield f"model = bm.fit_grid({made}{_keywords(settings)})"
        design = [_python(grid["design"])] if grid["design"] else []
        others = {key: grid[key] for key in ("fixed", "released", "sliding") if grid[key]}
        yield f"wing = bm.DesignSurface.of({', '.join(['model', *design])}{_keywords(others)})\n"

    def _path(self, name: str) -> str:
        """Expression of the path of a file that the study names."""
        there = (self.study.source.parent / name).resolve()
        try:
            relative = os.path.relpath(there, self.folder.resolve())
        except ValueError:  # on another drive of Windows
            return _python(str(there))
        return f"HERE / {_python(Path(relative).as_posix())}"

    def _shape(self) -> Iterator[str]:
        """Variables and measures."""
        parts = sorted({table["at"] for table in self.study.variables.values() if table.get("at", 0.25) != 0.25})
        self.axes = {0.25: "wing.axis"} | {part: f"axes[{part}]" for part in parts}
        if parts:
            made = ", ".join(f"{part}: wing.axis_at({part})" for part in parts)
            yield f"axes = {{{made}}}"
        yield "variables = ["
        for name, table in self.study.variables.items():
            if VARIABLES[table["kind"]].made_by:
                yield f"    {self._variable(name, table)},"
        yield "]"
        if self.study.measures:
            yield "measures = ["
            for name, table in self.study.measures.items():
                yield f"    {_measure(name, table)},"
            yield "]"
        yield from self._mover()
        parts = ["measures=measures"] * bool(self.study.measures) + ["mover=mover"]
        parts += ["comoving=True"] * self.study.movement["comoving"]
        yield f"shape = wing.grid_movement(variables, {', '.join(parts)}, quality={self._quality}, fit=False)\n"

    def _mover(self) -> Iterator[str]:
        """The mover; of elasticity without a number of increments, as many as the bounds of the variables need."""
        movement, increments = self.study.movement, _python(self.study.movement["increments"])
        if movement["mover"] == "rotations":
            yield "mover = bm.Rotations(wing.mesh)"
            return
        settings = _keywords(_changed(movement, MOVEMENT, ("poisson_ratio",)))
        if movement["increments"] is None:
            yield "bounds = {"
            for name, table in self.study.variables.items():
                if VARIABLES[table["kind"]].made_by:
                    ends = [_python(_at_bound(table, side)) for side in ("lower", "upper")]
                    yield f"    {_python(name)}: ({', '.join(ends)}),"
            yield "}"
            yield "designs = wing.parametrization(variables).extremes(bounds)"
            yield "# the least increments with which the control mesh stays good there: the same in every design"
            yield f"n_increments = bm.increments_for(bm.LinearElasticity(wing.mesh{settings}), designs)"
            increments = "n_increments"
        yield f"mover = bm.LinearElasticity(wing.mesh, n_increments={increments}{settings})"

    @property
    def _quality(self) -> str:
        """Aggregates of the cells that are asked for, or none."""
        asked = [name for name in QUALITIES if any(name in of for of in self.study.responses)]
        return _python(asked) if asked else "False"

    def _variable(self, name: str, table: Table) -> str:
        kind = VARIABLES[table["kind"]]
        made = f"bm.{kind.made_by}"
        if table["kind"] == "control_points":
            where = f", bm.OnPatch(model, {_python(table['patches'])})" if table["patches"] else ""
            return f"{made}({_python(name)}{where}, direction={_python(table['direction'])})"
        if table["kind"] == "lattice":
            settings = _changed(table, kind.keys, ("margin",))
            box = f"bm.Lattice.box(wing.mesh, {tuple(table['n'])}{_keywords(settings)})"
            where = f", np.s_[{table['where']}]" if table["where"] else ""
            return f"{made}({_python(name)}, {box}{where}, direction={_python(table['direction'])})"
        arguments = [_python(name), self.axes[table["at"]]]
        if "stations" in table:
            arguments.append(f"stations={table['stations']}")
        settings = _changed(table, kind.keys, ("order", "scales_thickness"))
        return f"{made}({', '.join(arguments)}{_keywords(settings)})"

    def _problem(self) -> Iterator[str]:
        """The problem: driver, subsystems, variables and responses."""
        study = self.study
        yield f"driver = {self._driver()}"
        yield "problem = om.Problem(driver=driver, reports=None)"
        yield "top = problem.model"
        yield 'top.add_subsystem("grid_movement", shape, promotes=["*"])'
        if study.flow:
            yield from self._flow(study.flow)
        yield from self._expressions()
        for name, table in study.variables.items():
            if table["kind"] == "alpha" and study.conditions:
                yield from self._angles(table)
            else:
                yield f"top.add_design_var({_python(name)}{_keywords(_design_var(table))})"
        objective = study.objective
        ((_, of, _),) = self._objective()
        ref = objective["ref"] or (0.01 if any(name in DRAG for name in _words(objective["of"])) else 1.0)
        ref = -ref if objective["maximize"] else ref
        yield f"top.add_objective({_python(of)}{_keywords({'ref': ref} if ref != 1.0 else {})})"
        for name, table in study.constraints.items():
            bounds = {key: table[key] for key in ("lower", "upper", "equals") if table[key] is not None}
            size = max(map(abs, bounds.values()))
            ref = table["ref"] or size or 1.0
            settings = bounds | ({"ref": ref} if ref != 1.0 else {})
            for _, of, _ in self._constraint(name):
                yield f"top.add_constraint({_python(of)}{_keywords(settings)})"
        yield ""

    def _flow(self, flow: Table) -> Iterator[str]:
        kind, conditions = FLOWS[flow["kind"]], self.study.conditions
        area = flow["reference_area"] or "wing.planform_area"
        inputs = ("kind", "alpha", "Mach_number", "reference_area", "CL_target", *(("trim",) if conditions else ()))
        settings = _changed(flow, kind.keys, tuple(key for key in kind.keys if key not in inputs))
        if flow["kind"] == "lattice" and self.study.grid["design"]:
            settings["patches"] = self.study.grid["design"]
        settings = {key: tuple(value) if key == "moment_reference" else value for key, value in settings.items()}
        made = f"flow = bm.{kind.made_by}(model=model, reference_area={area}{_keywords(settings)}"
        if not conditions:
            yield f"{made})"
            yield 'top.add_subsystem("flow", flow, promotes=["*"])'
            if flow.get("trim"):
                yield f'top.set_input_defaults("CL_target", {flow["CL_target"]})'
            else:
                yield f'top.set_input_defaults("alpha", {flow["alpha"]}, units="deg")'
            yield f'top.set_input_defaults("Mach_number", {flow["Mach_number"]})'
            return
        yield "conditions = {"
        for name, table in conditions.items():
            given = {key: table[key] for key in ("Mach_number", "CL_target" if table["trim"] else "alpha")}
            yield f"    {_python(name)}: {{{', '.join(f'{_python(key)}: {value}' for key, value in given.items())}}},"
        yield "}"
        is_trimmed = ', trim="CL_target" in values' if any(table["trim"] for table in conditions.values()) else ""
        yield "for name, values in conditions.items():" if is_trimmed else "for name in conditions:"
        yield f"    {made}{is_trimmed})"
        yield '    top.add_subsystem(name, flow, promotes_inputs=["grid"])'

    def _angles(self, table: Table) -> Iterator[str]:
        """Angles of attack of the conditions that are not trimmed, as design variables."""
        for number, name in enumerate(self._free):
            yield f'top.add_design_var("{name}.alpha"{_keywords(_design_var(_part(table, number)))})'

    @property
    def _free(self) -> list[str]:
        """Conditions whose angle of attack is given."""
        return [name for name, table in self.study.conditions.items() if not table["trim"]]

    def _objective(self) -> list[tuple[str, str, str]]:
        """Component, output and formula of the objective; of what is an output already, the output alone.

        Outputs of the flow without a condition are those of each, and the objective is the mean of all.
        """
        of, weights = self.study.objective["of"], weights_of(self.study.conditions)
        if not self.study.conditions or not bare_outputs(names_in(of)):
            return [_response("objective", of)]
        parts = {name: _at_condition(of, name) for name in weights}
        if len(parts) == 1:
            return [_response("objective", *parts.values())]
        terms = [part if weights[name] == 1.0 else f"{weights[name]} * ({part})" for name, part in parts.items()]
        output = f"mean_{of}" if of.isidentifier() else "objective_value"
        total, mean = f"{sum(weights.values()):.12g}", " + ".join(terms)
        return [("objective", output, mean if total == "1" else f"({mean}) / {total}")]

    def _constraint(self, name: str) -> list[tuple[str, str, str]]:
        """The same of a constraint; one on outputs of the flow without a condition holds at each."""
        of, key = self.study.constraints[name]["of"], name.replace(".", "_")
        if not self.study.conditions or not bare_outputs(names_in(of)):
            return [_response(key, of)]
        return [_response(f"{key}_{each}", _at_condition(of, each)) for each in self.study.conditions]

    def _expressions(self) -> Iterator[str]:
        """Components of the expressions among objective and constraints."""
        wanted = [*self._objective(), *(found for name in self.study.constraints for found in self._constraint(name))]
        of_conditions_ = of_conditions(self.study.conditions, FLOWS["euler"].outputs)
        for key, output, formula in wanted:
            if not formula:
                continue
            component = f"{key}_expression"
            far = [name for name in names_in(formula) if name in of_conditions_]
            near = [name for name in names_in(formula) if name not in far]
            made = f"om.ExecComp({_python(f'{output} = {renamed(formula, _flat)}')})"
            promoted = f'promotes_inputs={_python(near)}, promotes_outputs=["*"]' if far else 'promotes=["*"]'
            promoted = promoted.removeprefix("promotes_inputs=[], ")
            yield f"top.add_subsystem({_python(component)}, {made}, {promoted})"
            for name in far:
                yield f'top.connect({_python(name)}, "{component}.{_flat(name)}")'

    def _driver(self) -> str:
        driver, name = self.study.driver, self.study.driver["optimizer"]
        if name in SCIPY:
            settings = {"optimizer": name, "tol": driver["tolerance"], "maxiter": driver["max_iterations"]}
            made = "bm.ScipyDriver"
        else:
            settings = {"optimizer": name, "ftol_rel": driver["tolerance"], "maxeval": driver["max_iterations"]}
            made = "bm.NLoptDriver"
        return f"{made}({_keywords(settings | driver['options'])[2:]})"

    def _run(self) -> Iterator[str]:
        """Run before and after, and what is written."""
        study, first = self.study, "with together(problem.comm):\n    if IS_FIRST:"
        old = self.earlier and f"HERE / {_python(Path(os.path.relpath(self.earlier, self.folder)).as_posix())}"
        yield f"outputs = {_python(self._outputs())}"
        yield f'driver.add_recorder(bm.CaseRecorder(HERE / "cases.sql", keep="*"{f", earlier={old}" if old else ""}))'
        if study.output["report"]:
            field = "Cp" if study.flow and study.flow["kind"] == "euler" else "delta_Cp"
            pressures = [f"{name}.{field}" for name in study.conditions] or [field]
            recorded = ["control_points", *(pressures if study.flow else [])]
            stream = ("Mach_number", "alpha")
            recorded += (of_conditions(study.conditions, stream) or stream) if study.flow else ()
            yield f'driver.recording_options["includes"] = [{_python(recorded)[1:-1]}, *outputs]'
            yield 'driver.recording_options["record_derivatives"] = True'
        yield f"problem.setup({self._mode()})"
        yield from self._values()
        yield "problem.run_model()\nbefore = bm.design_summary(problem, outputs)"
        yield first
        yield '        model.save(HERE / "model.h5")'
        yield f'        bm.write_grid(HERE / "grid_before.{study.suffix}", model.regenerate())\n'
        if old:
            yield f"bm.load_best(problem, {old})"
        yield "problem.run_driver()"
        finer = f", finer={FINER} if problem.comm.size == 1 else None" if self._is_estimated else ""
        yield f"after = bm.design_summary(problem, outputs{finer})"
        yield first
        moved = 'model.regenerate(problem.get_val("control_points").reshape(-1, 3))'
        yield f'        bm.write_grid(HERE / "grid_after.{study.suffix}", {moved})'
        yield '        after.write_csv(HERE / "summary.csv", before)\n        print(after.table(before))'
        if study.output["report"]:
            title = _python(f"{study.source.stem}: {study.objective['of']}")
            told = f"title={title}" + (", estimates=after.estimates" if self._is_estimated else "")
            yield f'        bm.write_report(HERE / "report.html", HERE / "cases.sql", model, {told})'

    @property
    def _is_estimated(self) -> bool:
        """Whether the errors of lift and drag are estimated."""
        flow = self.study.flow
        return flow is not None and flow["kind"] == "euler" and self.study.output["estimate_errors"]

    def _mode(self) -> str:
        """How totals are taken, where each takes a linear solve of a flow: forward for few variables, or reverse."""
        study = self.study
        if not study.flow or study.flow["kind"] != "euler":
            return ""
        wanted = [*self._objective(), *(found for name in study.constraints for found in self._constraint(name))]
        depend = [
            of
            for of in wanted
            if any(name.rpartition(".")[2] in FLOWS["euler"].outputs for name in names_in(of[2] or of[1]))
        ]
        return (
            'mode="rev"' if _n_values(study.variables) > len(depend) / max(1, len(study.conditions)) else 'mode="fwd"'
        )

    def _outputs(self) -> list[str]:
        """What is told of the flow and the shape besides objective and constraints."""
        flow, conditions = self.study.flow, self.study.conditions
        if flow is None:
            return list(self.study.measures)
        outputs = FLOWS[flow["kind"]].outputs
        found = list(of_conditions(conditions, outputs) or outputs)
        trimmed = [f"{name}.alpha" for name in conditions if name not in self._free]
        return [*found, *self.study.measures, *(["alpha"] if flow.get("trim") and not conditions else trimmed)]

    def _values(self) -> Iterator[str]:
        """Values of inputs that are not those of the model."""
        study = self.study
        if study.conditions:
            yield "for name, values in conditions.items():"
            yield "    for variable, value in values.items():"
            yield '        problem.set_val(f"{name}.{variable}", value)'
        for name, table in study.variables.items():
            if table["start"] is None:
                continue
            units = {"units": unit} if (unit := VARIABLES[table["kind"]].units) else {}
            starts = {name: table["start"]}
            if table["kind"] == "alpha" and study.conditions:
                starts = {f"{each}.alpha": _part(table, n)["start"] for n, each in enumerate(self._free)}
            for of, start in starts.items():
                yield f"problem.set_val({_python(of)}, {start}{_keywords(units)})"


def _n_values(variables: dict[str, Table]) -> float:
    """Number of the values of all variables; infinite where the grid tells it."""
    counts = [
        len(table["values"]) if table.get("values") else len(stations) if isinstance(stations, list) else stations
        for table in variables.values()
        for stations in [table.get("stations", 1 if table["kind"] in ("taper", "alpha") else np.inf)]
    ]
    return float(sum(counts))


def _at_bound(table: Table, side: str) -> Any:
    """Bound of all values of a variable; those that are none of the driver's stay as they are."""
    bound, chosen = table[side], table.get("values")
    if not chosen:
        return bound
    stations = table["stations"]
    found = [VARIABLES[table["kind"]].neutral] * (len(stations) if isinstance(stations, list) else stations)
    for value, each in zip(chosen, bound if isinstance(bound, list) else [bound] * len(chosen)):
        found[value - 1] = each
    return found


def _part(table: Table, number: int) -> Table:
    """Bounds and start of one of the values of a variable."""
    return table | {key: table[key][number] for key in ("lower", "upper", "start") if isinstance(table[key], list)}


def _response(key: str, of: str) -> tuple[str, str, str]:
    """Component, output and formula of a response; of what is an output already, the output alone."""
    return (key, of, "") if is_name(of) else (key, f"{key}_value", of)


def _at_condition(of: str, condition: str) -> str:
    """Write an expression of outputs of the flow for one condition."""
    bare = bare_outputs(names_in(of))
    return renamed(of, lambda name: f"{condition}.{name}" if name in bare else name)


def _flat(name: str) -> str:
    """Name of an input for an output of a condition."""
    return name.replace(".", "_")


def _measure(name: str, table: Table) -> str:
    kind = MEASURES[table["kind"]]
    settings = {}
    for key, spec in kind.keys.items():
        value = tuple(table[key]) if key in ("chord", "span") else table[key]
        is_needed = key in ("n_chord", "n_span", "stations", "relative")
        if is_needed or value != (tuple(spec.default) if isinstance(value, tuple) else spec.default):
            settings[key] = value
    if "relative_to" in kind.keys:
        settings["relative_to"] = table["relative_to"]
    return f"bm.{kind.made_by}(wing.surface{_keywords(settings | {'name': name})})"


def _design_var(table: Table) -> dict[str, Any]:
    """Arguments of a design variable."""
    lower, upper = table["lower"], table["upper"]
    settings: dict[str, Any] = {}
    if table.get("values"):
        settings["indices"] = [value - 1 for value in table["values"]]
    settings |= {"lower": lower, "upper": upper}
    widest = float(np.max(np.subtract(upper, lower)))
    settings["ref"] = table["ref"] or float(f"{0.5 * widest:.3g}")
    units = VARIABLES[table["kind"]].units
    return settings | ({"units": units} if units else {})


def _changed(table: Table, keys: dict[str, Key], names: tuple[str, ...]) -> dict[str, Any]:
    """Keys whose value is not the default."""
    return {key: table[key] for key in names if key in keys and table[key] not in (None, keys[key].default)}


def _keywords(settings: dict[str, Any]) -> str:
    """Keyword arguments after others."""
    return "".join(f", {key}={_python(value)}" for key, value in settings.items())


def _python(value: Any) -> str:
    """Write a value as Python, texts in double quotes."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, list):
        return f"[{', '.join(map(_python, value))}]"
    return repr(value)


def _words(of: str) -> list[str]:
    return "".join(letter if letter.isalnum() or letter == "_" else " " for letter in of).split()
