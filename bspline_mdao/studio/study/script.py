"""The Python script of a study: the command ``optimize`` runs it, and so can anyone.

It is built as a syntax tree with the study's settings as values: whatever they are, the script calls nothing else.
"""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...flow.functionals import numbers
from .conditions import of_conditions
from .expressions import names_in
from .keys import FLOWS, SCIPY
from .layout import python_text
from .options import settings_of
from .responses import Response, constraint_responses, flat_name, objective_response
from .script_shape import changed, shape_part
from .study import CASES, PICTURE, Study
from .syntax import call, expression, statement
from .tables import Table
from .variable_kinds import VARIABLES

__all__ = ["SCRIPT", "StudyScript", "design_var", "done", "study_script"]

SCRIPT = "optimize.py"
"""Name of the script in the folder of the results."""

FINER = 1.5
"""Cells per direction of the grid on which lift and drag are estimated, relative to the study's grid."""

PRESSURE = 0.1
"""Root mean square of the change of pressure coefficients that the driver sees as 1."""

DRAG = numbers("euler", "drag")
"""Objectives whose unit is a hundredth."""

_HEAD = '''"""The optimisation that a study stands for.

Written and run by ``bspline-mdao optimize``: the results next to it come from this script, which writes them again
when it is run again. Continue here where a study ends.
"""

from pathlib import Path
'''

_IMPORTS = """import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.parallel import together, world
"""

Part = Iterator[ast.stmt | str]


def study_script(
    study: Study,  # the study
    folder: Path,  # folder of the script: file names in it are relative to this folder
    earlier: Path | None = None,  # case file of another run, whose best design is the start
    is_plane: bool = False,  # whether the grid is planar, and becomes one cell deep
) -> str:  # python
    """Write the script of a study."""
    return python_text(StudyScript(study, folder, earlier, is_plane).parts())


class StudyScript:
    """Makes the parts of a script in order: statements, comments and blank lines."""

    def __init__(self, study: Study, folder: Path, earlier: Path | None, is_plane: bool):
        self.study, self.folder, self.is_plane = study, folder, is_plane
        self.earlier = {"earlier": self._path(str(earlier))} if earlier else {}
        self.objective = objective_response(study.objective["of"], study.conditions)
        self.constraints = {
            name: list(constraint_responses(name, table["of"], study.conditions))
            for name, table in study.constraints.items()
        }

    def parts(self) -> Part:
        """All parts."""
        yield _HEAD
        if any(table.get("where") for table in self.study.variables.values()):
            yield "import numpy as np"
        yield _IMPORTS
        objective = self.study.objective
        what = f"{'largest' if objective['maximize'] else 'least'} {objective['of']} of {self.study.grid['file']}"
        yield statement("STUDY = title", title=f"{self.study.source.name}: {what}")
        yield statement("HERE = Path(__file__).resolve().parent")
        yield "# of several processes, under mpirun, the first one writes"
        yield statement("IS_FIRST = world().rank == 0")
        yield ""
        for part in (self._model(), shape_part(self.study, self._path), self._problem(), self._before()):
            yield from part
            yield ""
        yield from self._after()

    @property
    def _responses(self) -> list[Response]:
        return [self.objective, *(response for found in self.constraints.values() for response in found)]

    def _model(self) -> Part:
        """The fitted model and its design surface."""
        grid = self.study.grid
        yield from self.study.kind.model_part(grid, self._path, self.is_plane)
        design = [grid["design"]] if grid["design"] else []
        others = {key: grid[key] for key in ("fixed", "released", "sliding") if grid[key]}
        yield statement("wing = made", made=call("bm.DesignSurface.of", expression("model"), *design, **others))

    def _path(self, name: str) -> ast.expr:
        """Path of a file that the study names."""
        there = (self.study.source.parent / name).resolve()
        try:
            relative = Path(os.path.relpath(there, self.folder.resolve()))
        except ValueError:  # on another drive of Windows
            return expression("Path(there)", there=str(there))
        return expression("HERE / there", there=relative.as_posix())

    def _problem(self) -> Part:
        """The problem: driver, subsystems, variables and responses."""
        study = self.study
        yield from self._combinations()
        yield statement("driver = made", made=self._driver())
        yield statement("problem = om.Problem(driver=driver, reports=None)")
        yield from self._subsystems()
        for name, table in study.variables.items():
            for each, part in self._inputs(name, table):
                if name not in study.evened:
                    yield done(call("top.add_design_var", each, **design_var(part)))
                    continue
                yield done(call("top.add_design_var", f"{name}_combinations", ref=PRESSURE))
                yield done(call("top.add_constraint", name, **design_var(part)))
        objective = study.objective
        ref = objective["ref"] or (0.01 if any(name in DRAG for name in _last_parts(objective["of"])) else 1.0)
        ref = -ref if objective["maximize"] else ref
        yield done(call("top.add_objective", self.objective.output, **({"ref": ref} if ref != 1.0 else {})))
        for name, table in study.constraints.items():
            bounds = {key: table[key] for key in ("lower", "upper", "equals") if table[key] is not None}
            ref = table["ref"] or max(map(abs, bounds.values())) or 1.0
            settings = bounds | ({"ref": ref} if ref != 1.0 else {})
            for response in self.constraints[name]:
                yield done(call("top.add_constraint", response.output, **settings))

    def _combinations(self) -> Part:
        """Combinations of values along which pressures change evenly, by a problem of their own."""
        if not self.study.evened:
            return
        yield "# combinations of values along which the pressures of the baseline change evenly"
        yield statement("at_first = om.Problem(reports=None)")
        yield statement("top = at_first.model")
        yield statement('top.add_subsystem("grid_movement", shape_at_first, promotes=["*"])')
        yield from self._flow(self.study.flow or {})
        made = {name: expression("bm.drivers.even_pressures(at_first, model, n)", n=name) for name in self.study.evened}
        yield statement("combinations = made", made=made)
        yield ""

    def _subsystems(self) -> Part:
        """Mover of the grid, flows, and responses that are expressions."""
        yield statement("top = problem.model")
        for name in self.study.evened:
            units = {"units": unit} if (unit := VARIABLES[self.study.variables[name]["kind"]].units) else {}
            made = call("bm.drivers.combine", name, expression("combinations[name]", name=name), **units)
            inputs = expression('[("combinations", each)]', each=f"{name}_combinations")
            promoted = {"promotes_inputs": inputs, "promotes_outputs": [name]}
            yield done(call("top.add_subsystem", f"combined_{name}", made, **promoted))
        yield statement('top.add_subsystem("grid_movement", shape, promotes=["*"])')
        if self.study.flow:
            yield from self._flow(self.study.flow)
        for response in self._responses:
            yield from self._component(response)

    def _flow(self, flow: Table) -> Part:
        kind, conditions = FLOWS[flow["kind"]], self.study.conditions
        area = flow["reference_area"] or expression("wing.planform_area")
        inputs = ("kind", "alpha", "Mach_number", "reference_area", "CL_target", *(("trim",) if conditions else ()))
        settings = changed(flow, kind.keys, tuple(key for key in kind.keys if key not in inputs))
        if flow["kind"] == "lattice" and self.study.grid["design"]:
            settings["patches"] = self.study.grid["design"]
        if "moment_reference" in settings:
            settings["moment_reference"] = tuple(settings["moment_reference"])
        quiet = {"iprint": 0} if flow["kind"] == "euler" else {}  # the driver's log has a line a run
        settings = {"model": expression("model"), "reference_area": area, **settings, **quiet}
        if not conditions:
            yield statement("flow = made", made=call(f"bm.{kind.made_by}", **settings))
            yield statement('top.add_subsystem("flow", flow, promotes=["*"])')
            if flow.get("trim"):
                yield statement('top.set_input_defaults("CL_target", value)', value=flow["CL_target"])
            else:
                yield statement('top.set_input_defaults("alpha", value, units="deg")', value=flow["alpha"])
            yield statement('top.set_input_defaults("Mach_number", value)', value=flow["Mach_number"])
            return
        given = {
            name: {key: table[key] for key in ("Mach_number", "CL_target" if table["trim"] else "alpha")}
            for name, table in conditions.items()
        }
        yield statement("conditions = given", given=given)
        is_trimmed = any(table["trim"] for table in conditions.values())
        settings |= {"trim": expression('"CL_target" in values')} if is_trimmed else {}
        loop = "for name, values in conditions.items()" if is_trimmed else "for name in conditions"
        yield statement(
            f'{loop}:\n    flow = made\n    top.add_subsystem(name, flow, promotes_inputs=["grid"])',
            made=call(f"bm.{kind.made_by}", **settings),
        )

    def _inputs(self, name: str, table: Table) -> list[tuple[str, Table]]:
        """Inputs of the problem for a variable, with their parts of its bounds: for alpha, one at each condition."""
        if table["kind"] != "alpha" or not self.study.conditions:
            return [(name, table)]
        return [(f"{each}.alpha", _part(table, number)) for number, each in enumerate(self._free)]

    @property
    def _free(self) -> list[str]:
        """Conditions whose angle of attack is given."""
        return [name for name, table in self.study.conditions.items() if not table["trim"]]

    def _component(self, response: Response) -> Part:
        """Component of a response that is an expression."""
        if not response.formula:
            return
        far, near = response.far_and_near(self.study.conditions)
        made = expression("om.ExecComp(equation)", equation=response.equation)
        inputs = {"promotes_inputs": near} if near else {}
        promoted: dict[str, Any] = inputs | {"promotes_outputs": ["*"]} if far else {"promotes": ["*"]}
        yield done(call("top.add_subsystem", response.component, made, **promoted))
        for name in far:
            yield done(call("top.connect", name, f"{response.component}.{flat_name(name)}"))

    def _driver(self) -> ast.expr:
        driver = self.study.driver
        made_by = "bm.ScipyDriver" if driver["optimizer"] in SCIPY else "bm.NLoptDriver"
        return call(made_by, **settings_of(driver), **driver["options"])

    def _before(self) -> Part:
        """The recording options, and the baseline."""
        study = self.study
        yield statement("outputs = names", names=self._outputs())
        made = call("bm.CaseRecorder", expression("HERE / file", file=CASES), keep="*", **self.earlier)
        yield statement("driver.add_recorder(made)", made=made)
        if study.output["report"] or self._is_drawn:
            yield statement('driver.recording_options["includes"] = names', names=self._recorded())
        if study.output["report"]:
            yield statement('driver.recording_options["record_derivatives"] = True')
        mode = self._mode()
        yield done(call("problem.setup", **({"mode": mode} if mode else {})))
        yield from self._values()
        yield statement("problem.run_model()")
        yield statement("before = made", made=self._summary())
        yield statement(
            'with together(problem.comm):\n    if IS_FIRST:\n        model.save(HERE / "model.h5")\n        written',
            written=self._written("before"),
        )

    def _after(self) -> Part:
        """The optimisation, and its output files."""
        study = self.study
        if self.earlier:
            yield done(call("bm.load_best", expression("problem"), *self.earlier.values()))
        yield statement("problem.run_driver()")
        yield statement("after = made", made=self._summary())
        report = ""
        if study.output["report"]:
            both = ", estimates=after.estimates, baseline=before.estimates"
            estimates = both if self._is_estimated else ""
            results = 'HERE / "report.html", HERE / "cases.sql"'
            slides = ", slides=wing.mesh.slides" if study.grid["sliding"] else ""
            report = f"\n        bm.write_report({results}, model, title=STUDY{estimates}{slides})"
        picture = ""
        if self._is_drawn:
            picture = (
                "\n        if wing.surface.is_section:"
                f'\n            bm.plotting.plot_section(HERE / "{PICTURE}", HERE / "{CASES}", model)'
            )
        written = [self._written("after"), *self._cad_written()]
        names = {f"written_{number}": each for number, each in enumerate(written)}
        yield statement(
            "with together(problem.comm):\n"
            "    if IS_FIRST:\n"
            f"        {'; '.join(names)}\n"
            '        after.write_csv(HERE / "summary.csv", before)\n'
            f"        print(after.table(before)){report}{picture}",
            **names,
        )

    @property
    def _is_drawn(self) -> bool:
        """Whether pressures are drawn, if the walls are a section."""
        return self.study.has_pressures and bool(self.study.output["picture"])

    def _cad_written(self) -> Iterator[ast.expr]:
        """Write CAD files with the faces of the optimum."""
        for file, result in self.study.cad_results.items():
            names = [name for name, table in self.study.variables.items() if table.get("file") == file]
            values = {name: expression("problem.get_val(name)", name=name) for name in names}
            moved = call("bm.design.moved_body", [expression("cad[name]", name=name) for name in names], values)
            yield call("bm.files.write_cad_body", expression("HERE / result", result=result), moved)

    def _written(self, when: str) -> ast.expr:
        """Write the grid before or after."""
        return self.study.kind.write(when, self.study.written(when), bool(self.study.grid["sliding"]))

    def _summary(self) -> ast.Call:
        """Summary of the current design, with estimated or solved lift and drag on finer grids."""
        solved_on = self.study.output["solved_on"] if self.study.has_pressures else None
        factors = {"finer": FINER if self._is_estimated else None, "solved_on": solved_on}
        finer = {
            name: expression("factor if problem.comm.size == 1 else None", factor=factor)
            for name, factor in factors.items()
            if factor is not None
        }
        return call("bm.design_summary", expression("problem"), expression("outputs"), **finer)

    @property
    def _is_estimated(self) -> bool:
        """Whether the errors of lift and drag are estimated."""
        return self.study.has_pressures and self.study.output["estimate_errors"]

    def _mode(self) -> str:
        """Mode of total derivatives, each of which may take a linear solve of a flow: forward for few variables."""
        study = self.study
        if not study.has_pressures:
            return ""
        n_depend = sum(response.of_flow for response in self._responses)
        return "rev" if study.n_values > n_depend / max(1, len(study.conditions)) else "fwd"

    def _outputs(self) -> list[str]:
        """Reported outputs of the flow and the shape besides objective and constraints."""
        flow, conditions = self.study.flow, self.study.conditions
        if flow is None:
            return list(self.study.measures)
        outputs = FLOWS[flow["kind"]].outputs
        found = list(of_conditions(conditions, outputs) or outputs)
        trimmed = [f"{name}.alpha" for name in conditions if name not in self._free]
        return [*found, *self.study.measures, *(["alpha"] if flow.get("trim") and not conditions else trimmed)]

    def _recorded(self) -> ast.expr:
        """Recorded outputs for the report page besides variables and responses."""
        study, names = self.study, ["control_points"]
        if study.flow:
            field = "Cp" if study.flow["kind"] == "euler" else "delta_Cp"
            names += [f"{name}.{field}" for name in study.conditions] or [field]
            stream = ("Mach_number", "alpha")
            names += of_conditions(study.conditions, stream) or stream
        found = expression("[*outputs]")
        assert isinstance(found, ast.List)
        found.elts = [*(expression("name", name=name) for name in names), *found.elts]
        return found

    def _values(self) -> Part:
        """Values of inputs that differ from the model's."""
        if self.study.conditions:
            yield statement(
                "for name, values in conditions.items():\n"
                "    for variable, value in values.items():\n"
                '        problem.set_val(f"{name}.{variable}", value)'
            )
        for name, table in self.study.variables.items():
            units = {"units": unit} if (unit := VARIABLES[table["kind"]].units) else {}
            for each, part in self._inputs(name, table) if table["start"] is not None else ():
                yield done(call("problem.set_val", each, part["start"], **units))


def done(made: ast.Call) -> ast.stmt:
    """A call as a statement."""
    return ast.Expr(made)


def _part(table: Table, number: int) -> Table:
    """Bounds and start of one of the values of a variable."""
    return table | {key: table[key][number] for key in ("lower", "upper", "start") if isinstance(table[key], list)}


def design_var(table: Table) -> dict[str, Any]:
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


def _last_parts(of: str) -> list[str]:
    """Names in an expression without their conditions."""
    return [name.rpartition(".")[2] for name in names_in(of)]
