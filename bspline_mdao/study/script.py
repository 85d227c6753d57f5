"""The Python script that a study stands for: the command ``optimize`` runs it, and so can anyone."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .keys import FLOWS, MEASURES, QUALITIES, SCIPY, VARIABLES, Key
from .study import Study, Table

__all__ = ["SCRIPT", "study_script"]

SCRIPT = "optimize.py"
"""Name of the script in the folder of the results."""

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

HERE = Path(__file__).resolve().parent
'''


def study_script(study: Study, folder: Path, generator: str = "") -> str:
    """Write the script of a study.

    Parameters
    ----------
    study : Study
        The study.
    folder : Path
        Folder of the script: names of files in it are relative to that.
    generator : str
        Call that makes the grid, where it is a built-in one.

    Returns
    -------
    str
        Python.
    """
    lines = _Script(study, folder, generator).lines()
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

    def __init__(self, study: Study, folder: Path, generator: str):
        self.study, self.folder, self.generator = study, folder, generator

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
        yield 'model.save(HERE / "model.h5")'
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
        settings = {"n_increments": ("increments", "auto"), "poisson_ratio": ("poisson_ratio", -0.2)}
        changed = {
            key: self.study.movement[name]
            for key, (name, default) in settings.items()
            if self.study.movement[name] != default
        }
        more = "".join(
            (
                ", measures=measures" if self.study.measures else "",
                f", mover=bm.LinearElasticity(wing.mesh{_keywords(changed)})" if changed else "",
                f", quality={self._quality}",
                ", fit=False",
            )
        )
        yield f"shape = wing.grid_movement(variables{more})\n"

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
            yield f"top.add_design_var({_python(name)}{_keywords(_design_var(table))})"
        objective = study.objective
        of = self._response("objective", objective["of"])
        ref = objective["ref"] or (0.01 if any(name in DRAG for name in _words(objective["of"])) else 1.0)
        ref = -ref if objective["maximize"] else ref
        yield f"top.add_objective({_python(of)}{_keywords({'ref': ref} if ref != 1.0 else {})})"
        for name, table in study.constraints.items():
            bounds = {key: table[key] for key in ("lower", "upper", "equals") if table[key] is not None}
            size = max(map(abs, bounds.values()))
            ref = table["ref"] or size or 1.0
            settings = bounds | ({"ref": ref} if ref != 1.0 else {})
            yield f"top.add_constraint({_python(self._response(name, table['of']))}{_keywords(settings)})"
        yield ""

    def _flow(self, flow: Table) -> Iterator[str]:
        kind = FLOWS[flow["kind"]]
        area = flow["reference_area"] or "wing.planform_area"
        inputs = ("kind", "alpha", "Mach_number", "reference_area", "CL_target")
        settings = _changed(flow, kind.keys, tuple(key for key in kind.keys if key not in inputs))
        if flow["kind"] == "lattice" and self.study.grid["design"]:
            settings["patches"] = self.study.grid["design"]
        settings = {key: tuple(value) if key == "moment_reference" else value for key, value in settings.items()}
        yield f"flow = bm.{kind.made_by}(model=model, reference_area={area}{_keywords(settings)})"
        yield 'top.add_subsystem("flow", flow, promotes=["*"])'
        if flow.get("trim"):
            yield f'top.set_input_defaults("CL_target", {flow["CL_target"]})'
        else:
            yield f'top.set_input_defaults("alpha", {flow["alpha"]}, units="deg")'
        yield f'top.set_input_defaults("Mach_number", {flow["Mach_number"]})'

    def _expressions(self) -> Iterator[str]:
        """Components of the expressions among objective and constraints."""
        wanted = {"objective": self.study.objective["of"]}
        wanted |= {name: table["of"] for name, table in self.study.constraints.items()}
        for name, of in wanted.items():
            if not of.isidentifier():
                text = _python(f"{self._response(name, of)} = {of}")
                yield f'top.add_subsystem("{name}_expression", om.ExecComp({text}), promotes=["*"])'

    def _response(self, name: str, of: str) -> str:
        """Name of the output of an objective or a constraint."""
        return of if of.isidentifier() else f"{name}_value"

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
        study = self.study
        suffix = study.output["grid"] or ("cgns" if Path(study.grid["file"]).suffix == ".cgns" else "xyz")
        yield 'driver.add_recorder(om.SqliteRecorder(str(HERE / "cases.sql")))'
        if study.output["report"]:
            recorded = ["control_points", *(["Cp"] if study.flow and study.flow["kind"] == "euler" else [])]
            yield f'driver.recording_options["includes"] = {_python(recorded)}'
            yield 'driver.recording_options["record_derivatives"] = True'
        yield "problem.setup()"
        for name, table in study.variables.items():
            if table["start"] is not None:
                units = {"units": unit} if (unit := VARIABLES[table["kind"]].units) else {}
                yield f"problem.set_val({_python(name)}, {table['start']}{_keywords(units)})"
        yield "problem.run_model()"
        outputs = [*(FLOWS[study.flow["kind"]].outputs if study.flow else ()), *study.measures]
        if study.flow and study.flow.get("trim"):
            outputs.append("alpha")
        yield f"outputs = {_python(outputs)}"
        yield "before = bm.design_summary(problem, outputs)"
        yield "grid = model.regenerate()"
        yield f'bm.write_grid(HERE / "grid_before.{suffix}", grid)\n'
        yield "problem.run_driver()"
        yield "after = bm.design_summary(problem, outputs)"
        yield f'bm.write_grid(HERE / "grid_after.{suffix}", grid.with_vector(problem.get_val("grid")))'
        yield 'after.write_csv(HERE / "summary.csv", before)'
        yield "print(after.table(before))"
        if study.output["report"]:
            title = _python(f"{study.source.stem}: {study.objective['of']}")
            yield f'bm.write_report(HERE / "report.html", HERE / "cases.sql", model, title={title})'


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
