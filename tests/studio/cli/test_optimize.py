"""The commands ``init`` and ``optimize``: from a grid to a study, and from that to an optimum and a script."""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import fit_grid, read_grid, write_grid
from bspline_mdao.core.design.section_maps import SCALED_AFTER_TURN
from bspline_mdao.core.om.drivers import nlopt_driver
from bspline_mdao.generators import ball_grid, onera_m6_grid
from bspline_mdao.grids.io.run_folder import MANIFEST
from bspline_mdao.studio.cli import optimize
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.study.reader import read_study

LEAST_AREA = """\
[grid]
file = "{grid}"
{more}

[variables.chord]
stations = 3
lower = 0.6
upper = 1.4

[objective]
of = "surface_area"

[output]
report = false

[constraints.volume]
lower = 1.0

[constraints.corner_ks]
lower = 0.05
"""
pytestmark = pytest.mark.slow

RESULTS = {"optimize.py", "model.h5", "grid_before.xyz", "grid_after.xyz", "cases.sql", "summary.csv"}
"""Results without a report, for which packages may be missing, and without the hidden list of them."""


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "area.toml").write_text(LEAST_AREA.format(grid="@onera_m6:7x9x7", more="n_control = [5, 5, 5]"))
    return tmp_path


def names_in(folder):
    return {path.name for path in Path(folder).iterdir() if path.name != MANIFEST}


def summary(folder):
    with open(Path(folder) / "summary.csv", newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def test_a_study_gives_an_optimum_and_the_script_that_gives_the_same(workplace, capsys):
    assert run(["optimize", "area.toml", "-o", "out", "--json", "out.json"]) == 0
    shown = capsys.readouterr().out
    assert names_in("out") == RESULTS
    assert names_in(".") == {"area.toml", "out", "out.json"}
    found, numbers = summary("out"), json.loads(Path("out.json").read_text())
    assert float(found["surface_area"]["after"]) < 0.97 * float(found["surface_area"]["before"])
    assert float(found["volume"]["after"]) == pytest.approx(1.0, abs=1e-5)
    assert (found["chord[2]"]["lower"], found["chord[2]"]["role"]) == ("0.6", "variable")
    assert numbers["success"]
    assert numbers["after"]["surface_area"]["values"] == [float(found["surface_area"]["after"])]
    assert all(word in shown for word in ("objective", "chord[0]"))
    assert shown.count("FTOL_REACHED") == 1  # the driver says how it ended, the command does not say it again
    cases = om.CaseReader("out/cases.sql").list_cases("driver", out_stream=None)
    assert len(cases) == numbers["evaluations"]
    before, after = (read_grid(f"out/grid_{when}.xyz") for when in ("before", "after"))
    assert np.abs(after.to_vector() - before.to_vector()).max() > 1e-3
    assert before.shapes == after.shapes

    text = (workplace / "out" / "summary.csv").read_text()
    for name in RESULTS - {"optimize.py"}:
        (workplace / "out" / name).unlink()
    environment = {**os.environ, "OPENMDAO_REPORTS": "0"}
    done = subprocess.run(
        [sys.executable, "out/optimize.py"], capture_output=True, text=True, timeout=200, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert (workplace / "out" / "summary.csv").read_text() == text
    assert names_in("out") == RESULTS


def test_a_folder_that_is_not_empty_is_left_alone(workplace, capsys):
    Path("out").mkdir()
    Path("out/mine.txt").write_text("mine")
    assert run(["optimize", "area.toml", "-o", "out"]) == 2
    assert capsys.readouterr().err == "bspline-mdao: out: is not empty; give --overwrite, or another folder\n"
    assert names_in("out") == {"mine.txt"}
    Path("out/grid_after.cgns").write_text("mine as well")
    assert run(["optimize", "area.toml", "-o", "out", "--overwrite", "--overwrite", "--max-iterations", "2"]) == 0
    assert names_in("out") == RESULTS | {"mine.txt", "grid_after.cgns"}
    assert "maxeval=2" in Path("out/optimize.py").read_text()
    capsys.readouterr()
    assert run(["optimize", "area.toml", "-o", "out"]) == 2
    words = "out: is not empty; give --restart to continue from the best of 2 recorded designs, --overwrite, or another"
    assert words in capsys.readouterr().err


def test_a_run_that_is_stopped_says_why_it_shows_the_baseline_and_how_it_goes_on(workplace, capsys):
    Path("curved.toml").write_text(Path("area.toml").read_text().replace("lower = 1.0", "equals = 1.0"))
    assert run(["optimize", "curved.toml", "-o", "out", "--max-iterations", "2"]) == 0
    cases = om.CaseReader("out/cases.sql")
    area, volume = (cases.get_case(1).get_val(name).item() for name in ("surface_area", "volume"))
    stopped, why = capsys.readouterr().err.splitlines()[-2:]
    assert "this may be no optimum: see max_iterations" in stopped
    assert "--restart begins at the baseline again" in stopped
    assert why == (
        "warning: the baseline is the best design that satisfies all constraints; 1 of 3 evaluations have a better "
        f"surface_area, the best of them {area:.4g} in evaluation 2, which is infeasible: volume is "
        f"{volume - 1.0:.3g} above 1"
    )


def test_a_restart_from_the_baseline_repeats_the_run_as_said_until_the_cap_is_raised(workplace, capsys):
    Path("curved.toml").write_text(Path("area.toml").read_text().replace("lower = 1.0", "equals = 1.0"))
    run(["optimize", "curved.toml", "-o", "out", "--max-iterations", "2"])
    capsys.readouterr()
    assert run(["optimize", "curved.toml", "-o", "out", "--restart", "--max-iterations", "2"]) == 0
    assert "and repeats this run: raise max_iterations if it is spent" in capsys.readouterr().err
    cases = om.CaseReader("out/cases.sql")
    chords = [cases.get_case(name)["chord"] for name in cases.list_cases("driver", out_stream=None)]
    assert np.array_equal(chords[: len(chords) // 2], chords[len(chords) // 2 :])
    assert run(["optimize", "curved.toml", "-o", "out", "--restart", "--max-iterations", "40"]) == 0
    assert "this may be no optimum" not in capsys.readouterr().err
    assert run(["optimize", "area.toml", "-o", "better", "--max-iterations", "4"]) == 0
    assert "--restart continues from it" in capsys.readouterr().err


def test_how_a_stopped_run_ended_is_said_once_on_either_stream(workplace, capsys):
    Path("calm.toml").write_text(Path("area.toml").read_text() + "\n[driver]\noptions = { disp = false }\n")
    for more, counts in ((["area.toml"], (1, 0)), (["area.toml", "-q"], (0, 1)), (["calm.toml"], (0, 1))):
        assert run(["optimize", *more, "-o", "out", "--overwrite", "--max-iterations", "2"]) == 0
        streams = capsys.readouterr()
        assert tuple(stream.count("MAXEVAL_REACHED") for stream in streams) == counts, more
        assert streams.err.count("this may be no optimum") == 1


def test_an_interrupted_run_keeps_the_best_design(workplace, capsys, monkeypatch):
    def interrupted(settings, functions):
        functions.objective(functions.best.x + 0.01, np.zeros(0))
        raise KeyboardInterrupt

    monkeypatch.setattr(nlopt_driver, "minimise", interrupted)
    assert run(["optimize", "area.toml", "-o", "out"]) == 130
    words = "bspline-mdao: interrupted after 3 evaluations, 0 gradients; out keeps the best design so far"
    assert capsys.readouterr().err.strip() == words
    assert names_in("out") == RESULTS
    monkeypatch.setattr(om.Problem, "run_driver", interrupted_at_once)
    assert run(["optimize", "area.toml", "-o", "other"]) == 130
    words = "bspline-mdao: interrupted; other keeps cases.sql, grid_before.xyz, model.h5, optimize.py"
    assert capsys.readouterr().err.strip() == words


def interrupted_at_once(problem):
    raise KeyboardInterrupt


def test_the_report_is_written_where_its_packages_are_there(workplace, capsys, monkeypatch):
    text = Path("area.toml").read_text()
    Path("reported.toml").write_text(text.replace("report = false", "report = true"))
    Path("open.toml").write_text(text.replace("report = false", ""))
    monkeypatch.setattr(optimize, "find_spec", lambda name: None)
    assert run(["optimize", "reported.toml", "-o", "out"]) == 2
    assert "reported.toml: the report needs plotly; pip install" in capsys.readouterr().err
    assert run(["optimize", "open.toml", "-o", "out", "--max-iterations", "2"]) == 0
    assert "no report will be written: pip install" in capsys.readouterr().out
    assert names_in("out") == RESULTS
    assert run(["optimize", "open.toml", "-o", "out"]) == 2
    shown, error = capsys.readouterr()
    assert (shown, len(error.splitlines())) == ("", 1)  # no hints before an error
    monkeypatch.undo()
    monkeypatch.chdir(workplace)
    pytest.importorskip("plotly", reason="plotly is not installed")
    assert run(["optimize", "reported.toml", "-o", "out", "--overwrite", "--max-iterations", "2"]) == 0
    assert names_in("out") == RESULTS | {"report.html"}
    assert "surface_area" in Path("out/report.html").read_text()


def test_constraints_that_nothing_satisfies_fail_and_say_so(workplace, capsys):
    text = Path("area.toml").read_text().replace("lower = 1.0", "lower = 100.0")
    Path("big.toml").write_text(text)
    assert run(["optimize", "big.toml", "-o", "out", "--max-iterations", "3", "--json", "out.json"]) == 2
    shown, error = capsys.readouterr()
    (line,) = error.splitlines()
    assert line.startswith("bspline-mdao: out: no design that satisfies all constraints was found (")
    assert "; the best is infeasible: volume is 9" in line
    assert " below 100. The results are kept; " in line
    assert names_in("out") == RESULTS
    assert "before: infeasible: volume is 99 below 100" in shown
    assert "after: infeasible: volume is 9" in shown
    found, numbers = summary("out"), json.loads(Path("out.json").read_text())
    for when, key in (("before", "was_feasible"), ("after", "is_feasible")):
        excess = 100.0 - float(found["volume"][when])
        assert float(found["volume"][f"infeasible_{when}"]) == numbers[when]["volume"]["infeasible"]["volume"] == excess
        assert found["surface_area"][f"infeasible_{when}"] == ""
        assert not numbers[key]


def test_a_wrong_study_or_grid_leaves_nothing(workplace, capsys):
    Path("wrong.toml").write_text(Path("area.toml").read_text().replace("stations", "statoins"))
    assert run(["optimize", "wrong.toml", "-o", "out"]) == 2
    assert "wrong.toml: line 6: [variables.chord] 'statoins' is no key" in capsys.readouterr().err
    Path("built.toml").write_text(LEAST_AREA.format(grid="@m6", more=""))
    assert run(["optimize", "built.toml", "-o", "out"]) == 2
    assert "built.toml: line 2: [grid] 'file' is '@m6', which is no built-in grid" in capsys.readouterr().err
    named = 'n_control = [5, 5, 5]\ndesign = ["wng"]'
    Path("named.toml").write_text(LEAST_AREA.format(grid="@onera_m6:7x9x7", more=named))
    assert run(["optimize", "named.toml", "-o", "out"]) == 2
    error = capsys.readouterr().err
    assert "bspline-mdao: named.toml: line 4: [grid] 'design': " in error
    assert "no patch is called 'wng'; the patches are" in error
    assert not Path("out").exists()


def test_a_file_with_patches_and_its_model_give_one_optimum(workplace):
    grid = onera_m6_grid((9, 9, 7))
    write_grid("wing.xyz", grid)
    assert run(["inspect", "wing.xyz", "--draft", "wing.toml"]) == 0
    more = 'patches = "wing.toml"\nn_control = [6, 6, 5]'
    Path("file.toml").write_text(LEAST_AREA.format(grid="wing.xyz", more=more))
    assert run(["optimize", "file.toml", "-o", "of/file", "--max-iterations", "4"]) == 0
    Path("model.toml").write_text(LEAST_AREA.format(grid="of/file/model.h5", more=""))
    assert run(["optimize", "model.toml", "-o", "of_model", "--max-iterations", "4"]) == 0
    values = [float(summary(folder)["surface_area"]["after"]) for folder in ("of/file", "of_model")]
    assert values[0] == pytest.approx(values[1], rel=1e-9)


EVERYTHING = """\
[grid]
file = "@onera_m6:9x9x7"
n_control = [6, 6, 5]
fixed = "farfield*"

[variables.chord]
at = 1.0
lower = 0.6
upper = 1.4
scales_thickness = false
[variables.twist]
stations = [0.0, 0.5, 1.0]
values = [2, 3]
lower = [-3.0, -3.0]
upper = 3.0
start = [0.0, 0.1, 0.2]
[variables.sweep]
lower = -5
upper = 5
[variables.dihedral]
stations = 2
order = 2
lower = -5
upper = 5
[variables.span]
lower = 0.9
upper = 1.1
[variables.taper]
lower = 0.9
upper = 1.1
[variables.thick]
kind = "thickness"
lower = 0.9
upper = 1.1
[variables.camber]
lower = -0.1
upper = 0.1
[variables.bumps]
kind = "control_points"
patches = "wing_upper"
direction = "y"
lower = -0.01
upper = 0.01
[variables.box]
kind = "lattice"
n = [4, 2, 3]
where = ":, :, 1:"
direction = "y"
margin = 0.1
lower = -0.01
upper = 0.01
[variables.alpha]
lower = 1.0
upper = 5.0

[measures.sections]
kind = "section_thickness"
stations = [0.2, 0.6]
smallest = true
[measures.curvature]
relative = false

[flow]
kind = "lattice"
n_chord = 3
n_span = 6
reference_area = 1.16
moment_reference = [0.25, 0.0, 0.0]

[objective]
of = "CL / (CD_induced + 0.01)"
maximize = true

[constraints.volume]
lower = 0.9
[constraints.surface_area]
upper = 1.2
[constraints.planform_area]
lower = 0.8
upper = 1.2
[constraints.thickness]
lower = 0.5
[constraints.sections]
lower = 0.001
[constraints.curvature]
upper = 1e5
[constraints.leading_edge_radius]
lower = 0.3
[constraints.trailing_edge_angle]
lower = 0.0
[constraints.cells]
of = "quality_ks"
lower = -0.5
[constraints.height_low_ks]
lower = 0.2
[constraints.both]
of = "planform_area + volume"
lower = 0.1

[movement]
mover = "elasticity"
increments = 2

[driver]
optimizer = "SLSQP"
max_iterations = 1
options = { disp = false }

[output]
grid = "vtm"
"""


def test_every_kind_of_variable_measure_and_constraint_works_together(workplace, capsys):
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    Path("all.toml").write_text(EVERYTHING)
    assert run(["optimize", "all.toml", "-o", "out"]) == 0
    assert capsys.readouterr().out.splitlines().count(SCALED_AFTER_TURN) == 1  # thick comes after twist
    assert {"grid_before.vtm", "grid_after.vtm"} <= names_in("out")
    found = summary("out")
    assert float(found["objective_value"]["after"]) > float(found["objective_value"]["before"])
    assert {"twist[1]", "twist[2]"} <= {name.split(" ")[0] for name in found}
    assert "twist[0] (deg)" not in found


IN_EULER_FLOW = """\
[grid]
file = "@onera_m6:7x9x5"
[variables.twist]
stations = 2
values = [2]
lower = -3.0
upper = 3.0
[flow]
kind = "euler"
trim = true
CL_target = 0.2
[objective]
of = "CD_induced"
[output]
report = false
"""


def test_a_study_in_euler_flow_says_what_a_finer_grid_has_of_its_gain(workplace, capsys):
    Path("euler.toml").write_text(IN_EULER_FLOW)
    assert run(["optimize", "euler.toml", "-o", "out", "--max-iterations", "2", "--json", "out.json"]) == 0
    found = json.loads(Path("out.json").read_text())
    gain, shown = found["gains"]["CD_induced"], "".join(capsys.readouterr())
    drags = [found[when]["CD_induced"]["values"][0] for when in ("before", "after")]
    assert gain["gain"] == pytest.approx(1.0 - drags[1] / drags[0], rel=1e-6)
    assert gain["gain"] > 0.0
    assert f"CD_induced by the square of the lift: {100.0 * gain['gain']:.1f} % less on this grid" in shown
    assert gain["gain"] < gain["doubt"]  # on so few cells
    assert "the errors of the grid may be all that was gained" in shown
    assert "Newton steps" not in shown  # a line for each evaluation is in the log of the driver


TWO_CONDITIONS = """\
[grid]
file = "@onera_m6:7x7x5"
n_control = [5, 5, 5]
[variables.alpha]
lower = 0.0
upper = [8.0, 9.0]
start = [2.0, 4.0]
[variables.twist]
stations = 2
values = [2]
lower = -3.0
upper = 3.0
[flow]
kind = "lattice"
n_chord = 3
n_span = 5
[conditions.cruise]
Mach_number = 0.5
weight = 2
[conditions.climb]
[objective]
of = "CD_induced"
[constraints.cruise.CL]
equals = 0.2
[constraints.climb.CL]
equals = 0.3
[driver]
max_iterations = 6
"""


def test_the_objective_of_several_conditions_is_their_mean_and_the_report_has_each(workplace):
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    Path("two.toml").write_text(TWO_CONDITIONS)
    assert run(["optimize", "two.toml", "-o", "out"]) == 0
    found = {name.split(" ")[0]: row for name, row in summary("out").items()}
    drags = [float(found[f"{name}.CD_induced"]["after"]) for name in ("cruise", "climb")]
    assert float(found["mean_CD_induced"]["after"]) == pytest.approx((2.0 * drags[0] + drags[1]) / 3.0, rel=1e-12)
    lifts = [float(found[f"{name}.CL"]["after"]) for name in ("cruise", "climb")]
    assert lifts == pytest.approx([0.2, 0.3], abs=1e-4)
    assert (found["cruise.alpha"]["before"], found["climb.alpha"]["before"]) == ("2.0", "4.0")
    assert (found["cruise.alpha"]["upper"], found["climb.alpha"]["upper"]) == ("8.0", "9.0")
    cases = om.CaseReader("out/cases.sql")
    assert cases.get_case(-1).get_val("cruise.Mach_number") == 0.5
    if "report.html" in names_in("out"):
        page = Path("out/report.html").read_text()
        rows = page[page.index(">Coefficients") :]
        assert rows.index("cruise") < rows.index("climb") < rows.index("first and the best evaluation")
        assert "Pressure difference cruise.delta_Cp" in page


def test_the_study_that_is_drafted_of_a_wing_runs(workplace, capsys):
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    assert run(["init", "@onera_m6:9x9x7", "-o", "m6.toml"]) == 0
    shown, lines = capsys.readouterr().out.splitlines(), Path("m6.toml").read_text().splitlines()
    assert shown[0] == "objective: CD_induced"
    assert len(shown) < 12  # what to check, not all of the draft
    number = next(n for n, line in enumerate(lines, 1) if line.startswith('kind = "lattice"  # guessed: half a wing'))
    assert f"line {number}: {lines[number - 1]}" in shown
    assert run(["init", "@onera_m6:9x9x7", "-o", "m6.toml"]) == 2
    assert "m6.toml: is there already; give --overwrite, or another name" in capsys.readouterr().err
    assert run(["optimize", "m6.toml", "-o", "out", "--max-iterations", "8"]) == 0
    found, shown = summary("out"), capsys.readouterr().out
    assert float(found["CL"]["after"]) == pytest.approx(float(found["CL"]["before"]), rel=1e-4)
    assert float(found["CL"]["before"]) == pytest.approx(0.19, abs=0.01)  # of the lattice at 3 degrees
    assert "twist[0] (deg)" not in found
    assert "infeasible" not in shown


def test_init_and_optimize_say_at_once_which_package_the_flow_of_a_wing_needs(workplace, capsys, monkeypatch):
    monkeypatch.setattr("bspline_mdao.studio.study.draft_body.find_spec", lambda name: None)
    monkeypatch.setattr("bspline_mdao.studio.study.study.find_spec", lambda name: None)
    assert run(["init", "@onera_m6:9x9x7", "-o", "m6.toml"]) == 0
    assert 'needs OpenAeroStruct: pip install "bspline_mdao[vlm]"; then draft it again' in capsys.readouterr().err
    assert "  # set yours: not computed, estimated" in Path("m6.toml").read_text()
    for arguments in (["optimize", "m6.toml"], ["sample", "m6.toml", "-n", "2", "--flow"]):
        assert run([*arguments, "-o", "out"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("bspline-mdao: m6.toml: the flow, the vortex lattice, needs OpenAeroStruct: pip install")
        assert not Path("out").exists()


def test_a_body_that_is_no_wing_gets_a_study_of_its_shape(workplace, capsys):
    write_grid("ball.xyz", ball_grid((5, 5, 5, 5)))
    assert run(["init", "ball.xyz", "-o", "ball.toml"]) == 2
    words = "ball.xyz: no patch is a wall, so there is nothing to design; draft patches by 'bspline-mdao inspect"
    assert words in capsys.readouterr().err
    assert run(["inspect", "ball.xyz", "--draft", "patches.toml"]) == 0
    Path("studies").mkdir()
    assert run(["init", "ball.xyz", "--patches", "patches.toml", "-o", "studies/ball.toml"]) == 0
    study = read_study("studies/ball.toml")
    assert (study.grid["file"], study.flow, study.objective["of"]) == ("../ball.xyz", None, "surface_area")
    assert study.variables["shape"]["kind"] == "control_points"
    assert run(["optimize", "studies/ball.toml", "-o", "out", "--max-iterations", "3"]) == 0


def test_init_says_that_a_plane_of_symmetry_off_zero_has_to_be_shifted(workplace, capsys):
    grid = onera_m6_grid((9, 9, 7))
    for name, by in (("at_half.cgns", 0.5), ("at_zero.cgns", 0.0)):
        nodes = grid.to_vector().reshape(-1, 3) + [0.0, 0.0, by]
        write_grid(name, grid.with_vector(nodes.ravel()))
        assert run(["init", name, "-o", f"{name}.toml"]) == 0
        said = "flows need the plane of symmetry at z = 0, and it is at 0.5: shift the grid"
        assert (said in " ".join(capsys.readouterr().err.split())) == bool(by)
        assert ("# shift the grid first" in Path(f"{name}.toml").read_text()) == bool(by)


def test_init_warns_of_a_wing_that_lies_the_other_way_round(workplace, capsys):
    grid = onera_m6_grid((9, 9, 7))
    for name, turned in (("turned.cgns", [-1.0, -1.0, 1.0]), ("usual.cgns", 1.0)):
        nodes = grid.to_vector().reshape(-1, 3) * turned
        write_grid(name, grid.with_vector(nodes.ravel()))
        assert run(["init", name, "-o", f"{name}.toml"]) == 0
        said = f"warning: {name}.toml: the stream is taken to run along +x, and the downstream end of the sections is"
        assert (said in " ".join(capsys.readouterr().err.split())) == (name == "turned.cgns")


def test_a_model_without_walls_is_to_be_fitted_again_with_patches(workplace, capsys):
    write_grid("ball.xyz", ball_grid((5, 5, 5, 5)))  # a PLOT3D file has no patches
    assert run(["fit", "ball.xyz", "-o", "ball.h5"]) == 0
    assert run(["init", "ball.h5", "-o", "ball.toml"]) == 2
    words = "inspect ball.h5 --draft patches.toml', check them, and fit the grid again with --patches patches.toml"
    assert words in capsys.readouterr().err


def test_a_model_is_drafted_with_its_patches(workplace):
    fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)).save("m6.h5")
    assert run(["init", "m6.h5", "-o", "study.toml"]) == 0
    assert read_study("study.toml").grid["file"] == "m6.h5"
