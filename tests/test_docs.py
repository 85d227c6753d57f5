"""What the documentation shows works: its Python examples and its command lines."""

import ast
import importlib.util
import json
import os
import re
import runpy
import shlex
import shutil
import sys
import textwrap
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import su2_stand_in
from mesh_cases import sector_mesh
from overset_cases import two_cylinders
from periodic_cases import PITCH, passage
from riding_cases import SPACING, mesh, plane_su2_text, section, su2_text

from bspline_mdao import FittedModel, design_summary, fit_grid, load_best, read_grid, write_grid
from bspline_mdao.core.om.drivers.case_history import read_history
from bspline_mdao.files import read_mesh
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.studio.cli.main import run as cli
from bspline_mdao.studio.study.reader import read_study

pytestmark = pytest.mark.slow

DOCS = Path(__file__).parents[1] / "docs"
PACKAGE = DOCS.parent / "bspline_mdao"


def code_blocks(page, language):
    """Code of every block of one language on a page."""
    pattern = rf"^\.\. code-block:: {language}\n\n((?:   .*\n|\n)+)"
    return [textwrap.dedent(block) for block in re.findall(pattern, (DOCS / page).read_text(), re.M)]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder with the grid and the model that the pages speak of, small."""
    folder = tmp_path_factory.mktemp("docs")
    grid = onera_m6_grid((15, 17, 13))
    write_grid(folder / "wing.xyz", grid)
    fit_grid(grid).save(folder / "m6.h5")
    return folder


@pytest.fixture
def folder(made, tmp_path):
    """A folder of its own for each page, with these files."""
    return Path(shutil.copytree(made, tmp_path / "page"))


def run_blocks(page, **contents):
    """Run all Python of a page, one block after another; return what there is at the end."""
    contents = {"__name__": __name__, **contents}
    for block in code_blocks(page, "python"):
        exec(compile(block, page, "exec"), contents)
    return contents


def commands_of(page):
    """Arguments of the command lines of a page, in their order."""
    lines = re.sub(r" *\\\n *", " ", "\n".join(code_blocks(page, "sh"))).splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("bspline-mdao")]


def run_commands(page, but=(), **more):
    """Run the command lines of a page here, with more arguments by the command; return the commands."""
    commands = [command for command in commands_of(page) if not set(command) & set(but)]
    for command in commands:
        assert cli([*command, *more.get(command[0], [])]) == 0
    return [command[0] for command in commands]


def test_the_grid_comes_out_as_the_page_says(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert cli(["inspect", "wing.xyz", "--draft", "wing.toml"]) == 0
    assert run_commands("howto/get_the_grid_out.rst") == [*("fit", "move", "move"), *("refine",) * 3, "quality"]
    contents = run_blocks("howto/get_the_grid_out.rst")
    longer = read_grid("longer.cgns").to_vector().reshape(-1, 3)
    np.testing.assert_allclose(np.sort(longer, axis=0), np.sort(contents["grid"].to_vector().reshape(-1, 3), axis=0))
    assert {"bent.xyz", "fine.xyz", "coarse.cgns", "wing.vtm", "thicker.xyz", "fine.cgns"} <= set(os.listdir(folder))


def written_by_openvsp(path):
    """Write a body of revolution as OpenVSP writes PLOT3D: points along the sections, sections, 1; then x, y and z."""
    x, angle = 2.0 - 2.0 * np.cos(np.linspace(0.0, np.pi, 21))[:, None], np.linspace(0.0, 2.0 * np.pi, 65)
    radius = 0.4 * np.sqrt(np.maximum(1.0 - (0.5 * x - 1.0) ** 2, 0.0))
    lines = [" ".join(f"{value:25.17e}" for value in np.broadcast_to(axis, (21, 65)).ravel().tolist())
             for axis in (x, radius * np.sin(angle), radius * np.cos(angle))]  # fmt: skip
    path.write_text("\n".join([" 1", " 65 21 1", *lines, ""]))


@pytest.mark.parametrize(
    ("word", "page"),
    [
        *(("airfoil", "howto/airfoil.rst"), ("CST", "howto/airfoil.rst"), ("y+", "viscous.rst")),
        *(("extrusion", "theory/extrusion.rst"), ("pyHyp", "theory/extrusion.rst")),
        *(("STEP", "howto/cad.rst"), ("OpenVSP", "howto/cad.rst")),
        *((word, "faq.rst") for word in ("negative cells", "y+", "units", "MPI", "wavy optimum", "hot start", "trim")),
        *((word, "comparison.rst") for word in ("mesh deformation", "mesh warping")),
        *(("lift-constrained drag minimisation", "in_python.rst"), ("surrogate", "command_line.rst")),
        *(("adjoint", "flow.rst"), ("FFD", "design.rst"), ("unstructured", "howto/unstructured.rst")),
        *(("overset", "howto/overset.rst"), ("control surface", "howto/flaps.rst"), ("DOE", "howto/many_designs.rst")),
        *(("restart", "howto/restart.rst"), ("mesh warping", "theory/movers.rst"), ("FFD", "theory/free_form.rst")),
        *(("unstructured", "theory/background_lattice.rst"), ("adjoint", "theory/euler.rst")),
    ],
)
def test_words_that_are_searched_for_are_in_the_index(word, page):
    entries = re.findall(r"^\.\. index:: (.*)$", (DOCS / page).read_text(), re.M)
    assert word in [entry.strip() for line in entries for entry in line.split(",")]


def test_pages_of_theory_begin_with_the_idea():
    for path in (DOCS / "theory").glob("*.rst"):
        if path.stem != "index":
            first, *_ = re.findall(r"^(?!\.\. index::)(\S.*)$", path.read_text(), re.M)[2:]
            assert first == ".. admonition:: The idea", path.stem


def test_each_picture_of_an_idea_follows_the_idea_of_a_page():
    pages = [path.read_text() for path in (DOCS / "theory").glob("*.rst")]
    for name in [path.stem for path in (DOCS / "_static/ideas").glob("*.png")]:
        follows = rf"The idea\n\n(   .*\n)+\n\.\. figure:: \.\./_static/ideas/{name}\.png\n"
        assert any(re.search(follows, page) for page in pages), name


def messages_of(path):
    """Texts of a module that may be printed, ``…`` in the place of what is formatted into them."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value.replace("%s", "…")


def test_pages_name_the_scripts_that_they_include():
    """Sites that show the source of a page leave out what a directive includes."""
    n_scripts = 0
    for page in [*DOCS.glob("*.rst"), *(DOCS / "howto").glob("*.rst")]:
        lines = page.read_text().splitlines()
        text = "\n".join(line for line in lines if not line.startswith(".. "))
        for path in re.findall(r"^\.\. literalinclude:: (\S+\.py)$", "\n".join(lines), re.M):
            script = (page.parent / path).resolve().relative_to(DOCS.parent.resolve())
            assert f"``{script.as_posix()}``" in text, f"{page.name}: {script}"
            n_scripts += 1
    assert n_scripts >= 3


def test_messages_that_are_explained_are_in_the_code():
    page = (DOCS / "faq.rst").read_text()
    quoted = re.findall(r"^\.\. code-block:: text\n   :class: message\n\n   (.*)$", page, re.M)
    assert len(quoted) >= 45
    texts = "\n".join(text for path in sorted(PACKAGE.rglob("*.py")) for text in messages_of(path))
    assert [message for message in quoted if message not in texts] == []


@pytest.mark.skipif(importlib.util.find_spec("OCP") is None, reason="OpenCascade is missing: the extra cad")
def test_surfaces_go_into_cad_as_the_page_says(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert cli(["inspect", "wing.xyz", "--draft", "wing.toml"]) == 0
    written_by_openvsp(folder / "body.p3d")
    commands = run_commands("howto/cad.rst", optimize=["--max-iterations", "1"])
    assert commands == ["fit", "cad", "cad", "move", "move", "init", "optimize", "extrude"]
    (variables,) = code_blocks("howto/cad.rst", "toml")
    (folder / "points.toml").write_text(f'[grid]\nfile = "wing.h5"\n[objective]\nof = "surface_area"\n{variables}')
    assert read_study(folder / "points.toml").cad_results == {"wing.step": "wing_after.step"}
    contents = run_blocks("howto/cad.rst")
    assert contents["report"].distance < contents["report"].tolerance
    assert contents["shape"].is_valid
    assert {"wing.step", "wing.igs", "twisted.step", "longer.step", "follows.xyz", "bumps.step"} <= set(
        os.listdir(folder)
    )
    surface, half = contents["tied"].surface, contents["twist"].of_nodes @ [0.5]
    moved = contents["problem"].get_val("grid").reshape(-1, 3)[surface.rows] - surface.points
    asked = half + contents["bumps"].of_nodes @ (0.002 + contents["bumps"].initial)
    np.testing.assert_allclose(moved.ravel(), asked, atol=1e-14)


def test_many_designs_are_made_as_the_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_commands("howto/many_designs.rst") == ["init", "sample"]
    assert {"designs.h5", "model.h5", "sample.py", "card.md"} == set(os.listdir("designs"))
    contents = run_blocks("howto/many_designs.rst")
    assert len(contents["designs"]) == 8
    assert contents["nodes"].shape == (contents["wing"].model.n_nodes, 3)
    assert np.ptp(contents["designs"].outputs["area"]) > 1e-6


def test_points_of_other_meshes_follow_as_the_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_commands("howto/foreign_points.rst") == ["fit"]
    contents = run_blocks("howto/foreign_points.rst")
    assert np.abs(contents["embedded"].forward(contents["moved"]) - contents["probes"]).max() > 0.01


def test_a_mesh_rides_along_as_the_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_grid("wing.xyz", onera_m6_grid((9, 11, 9), SPACING))
    (tmp_path / "mesh.su2").write_text(su2_text(mesh()))
    (tmp_path / "airfoil.su2").write_text(plane_su2_text())
    commands = ["inspect", "fit", "ride", "init", "optimize", "ride", "airfoil", "ride"]
    assert run_commands("howto/ride.rst", optimize=["--max-iterations", "1"]) == commands
    assert {"twisted.su2", "optimum.su2", "pitched.su2"} <= set(os.listdir())
    contents = run_blocks("howto/ride.rst")
    assert np.abs(contents["state"].nodes - contents["corners"])[:, 2].max() > 0.01


def test_a_mesh_without_structure_moves_as_the_page_says(tmp_path, monkeypatch):
    for package in ("openaerostruct", "plotly", "jinja2"):
        pytest.importorskip(package, reason=f"{package} is not installed")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mesh.su2").write_text(su2_text(mesh()))
    (tmp_path / "kinds.toml").write_text(code_blocks("howto/unstructured.rst", "toml")[0])
    commands = ["inspect", "fit", "move", "fit", "fit", "fit", "init", "optimize", "report", "report"]
    assert run_commands("howto/unstructured.rst") == commands
    contents = run_blocks("howto/unstructured.rst")
    rows, before = contents["model"].wall_rows, mesh().points
    moved = read_mesh("moved.su2").mesh.points
    np.testing.assert_allclose(moved[rows], before[rows] * [1.0, 1.0, 1.1], rtol=0, atol=1e-12)
    assert np.abs(contents["nodes"] - before)[rows].max() > 0.01
    (total,) = contents["totals"].values()
    assert np.isfinite(total).all()
    assert total.any()


def test_overset_grids_move_as_the_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grid = two_cylinders()
    write_grid("overset.cgns", grid)
    assert run_commands("howto/overset.rst") == ["inspect", "fit", "move", "quality"]
    contents = run_blocks("howto/overset.rst")
    np.testing.assert_array_equal(contents["same"].to_vector(), read_grid("by_hand.cgns").to_vector())
    before, after = (each.blocks[0].nodes[:, 0] for each in (grid, contents["same"]))
    np.testing.assert_allclose(after, before * [1.0, 1.02, 1.0], rtol=0, atol=1e-13)


def test_an_airfoil_becomes_a_grid_and_an_optimum_as_the_page_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    done = run_commands("howto/airfoil.rst", optimize=["--max-iterations", "2"])
    assert done == ["airfoil", "airfoil", "quality", "airfoil", "airfoil", "init", "optimize"]
    printed = capsys.readouterr().out
    assert "cells: 6,144, 0 inverted; smallest corner 0.144" in printed
    assert "cells: 12,384, 0 inverted; smallest corner 0.674" in printed
    assert re.search(r"CD +0\.0172973", printed)
    contents = run_blocks("howto/airfoil.rst")
    assert contents["model"].report.n_invalid == 0
    (study,) = code_blocks("howto/airfoil.rst", "toml")
    Path("case_1.toml").write_text(study)
    assert list(read_study(Path("case_1.toml")).variables) == ["thickness_points"]


@pytest.mark.parametrize(
    ("page", "but", "commands"),
    [
        ("faq.rst", (), ["inspect", "fit"]),
        ("viscous.rst", (), ["fit", "move", "inspect"]),
        ("install.rst", ("--version", "warm-up"), ["fit"]),
        ("howto/flaps.rst", ("mesh.h5",), ["move", "move"]),
    ],
)
def test_commands_of_a_page_run_on_the_grid_that_it_names(tmp_path, monkeypatch, page, but, commands):
    monkeypatch.chdir(tmp_path)
    grid = onera_m6_grid((9, 9, 9))
    for name in "wing.xyz", "wing.cgns":
        write_grid(name, grid)
    fit_grid(grid).save("wing.h5")
    section().save("tail.h5")
    assert run_commands(page, but, fit=["--overwrite"]) == commands


def test_every_page_with_commands_is_run():
    """But for synopses, for lines of pages that are run elsewhere, and for other programs and several processes."""
    pages = [*DOCS.glob("*.rst"), *(DOCS / "howto").glob("*.rst")]
    with_commands = {str(page.relative_to(DOCS)) for page in pages if commands_of(page)}
    text = Path(__file__).read_text()
    run = {
        *re.findall(r'run_commands\("([\w/]+\.rst)"', text),
        *re.findall(r'^        \("([\w/]+\.rst)", \(', text, re.M),
    }
    synopses, of_other_pages, opens_a_browser = {"command_line.rst"}, {"index.rst", "report.rst"}, {"howto/live.rst"}
    by_its_program, by_its_study = {"tutorial.rst"}, {"studies.rst"}
    known = synopses | of_other_pages | opens_a_browser | by_its_program | by_its_study
    assert with_commands - run == known


def test_sectors_move_as_the_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sector, _ = sector_mesh(0.5, axis=(0.0, 0.0, 1.0), point=(0.0, 0.0, 0.0))
    names = {"body": "blade", "floor": "hub", "top": "casing", "in": "inlet", "out": "outlet"}
    markers = {names.get(name, name): faces for name, faces in (sector.markers or {}).items()}
    (tmp_path / "sector.su2").write_text(su2_text(replace(sector, markers=markers)))
    write_grid("passage.xyz", passage())
    assert run_commands("howto/sectors.rst") == ["fit", "move", "quality", "inspect", "fit", "move"]
    sides = read_grid("moved.xyz").blocks[0].nodes[:, [0, -1]]
    x, y, z = np.moveaxis(sides[:, 0], -1, 0)
    turned = np.stack([x, y * np.cos(PITCH) - z * np.sin(PITCH), z * np.cos(PITCH) + y * np.sin(PITCH)], axis=-1)
    np.testing.assert_allclose(turned, sides[:, 1], rtol=0, atol=1e-13)
    contents = run_blocks("howto/sectors.rst")
    assert contents["gap"] < 1e-14
    moved = read_mesh("leaned.su2").mesh
    assert not moved.quality().is_inverted.any()
    assert np.abs(moved.points - sector.points).max() > 0.03


def test_a_case_for_openfoam_is_written_as_the_page_says(folder, monkeypatch):
    monkeypatch.chdir(folder)
    shutil.copy("m6.h5", "wing.h5")
    for case in "case", "twisted":
        os.makedirs(f"{case}/constant")
    assert run_commands("howto/openfoam.rst") == ["refine", "move"]
    run_blocks("howto/openfoam.rst")
    assert {"U", "p"} == set(os.listdir("wing_case/0"))


@pytest.mark.solver
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("simpleFoam") is None, reason="simpleFoam is not on the PATH: install OpenFOAM")
def test_a_design_is_flown_with_openfoam_as_the_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    problem = run_blocks("howto/openfoam_flow.rst")["problem"]
    assert problem.compute_totals(["CL"], ["alpha"])["CL", "alpha"].item() == pytest.approx(0.1, rel=0.2)


def test_a_variable_of_ones_own_works_as_the_page_says():
    contents = run_blocks("howto/own_variable.rst")
    assert np.abs(contents["problem"].compute_totals(["corner_ks"], ["bow"])["corner_ks", "bow"]).min() > 0.0


def test_a_flap_turns_about_its_hinge_as_the_page_says():
    problem = run_blocks("howto/flaps.rst")["problem"]
    assert problem.get_val("corner_ks").item() > 0.1
    totals = problem.compute_totals(["corner_ks"], ["flap", "hinge_line", "twist"])
    assert all(np.abs(total).max() > 0.0 for total in totals.values())


def test_a_flow_of_ones_own_works_as_the_page_says():
    problem = run_blocks("howto/own_flow.rst")["problem"]
    twist = problem.compute_totals(["CL"], ["twist"])["CL", "twist"]
    assert twist.min() > 1e-3  # each station turns the lower side further into the stream


def test_a_wing_flies_with_su2_as_the_page_says(tmp_path, monkeypatch):
    """With a stand-in for SU2; `tests/flow/test_su2_flow.py` runs SU2 itself where it is there."""
    su2_stand_in.install(tmp_path / "bin", monkeypatch)
    monkeypatch.chdir(tmp_path)
    problem = run_blocks("howto/su2.rst")["problem"]
    assert (tmp_path / "su2_wing" / "restart_adj_cfz.csv").exists()
    assert np.abs(problem.compute_totals(["CL"], ["twist"])["CL", "twist"]).min() > 0.0


def test_an_optimisation_for_several_conditions_runs_as_the_page_says():
    contents = run_blocks("howto/multipoint.rst")
    problem, conditions = contents["problem"], contents["conditions"]
    for name, values in conditions.items():
        assert problem.get_val(f"{name}.CL").item() == pytest.approx(values["CL_target"], abs=1e-8)
    assert np.abs(problem.get_val("twist")).max() > 0.1


def test_a_design_begins_with_few_control_points_as_the_page_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    problem = run_blocks("howto/levels.rst")["problem"]
    areas = [float(part) for part in re.findall(r"\[([\d.]+)\]", capsys.readouterr().out)]
    assert len(areas) == 3
    assert areas[0] > areas[1] > areas[2]
    assert problem.get_val("volume") > 1.1 - 1e-6


def test_flows_and_optimisations_go_on_as_the_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    contents = run_blocks("howto/restart.rst")
    assert len(contents["second"].model.state.solution.history) == 1  # no step, but for the look at the residual
    assert contents["problem"].get_val("surface_area") <= contents["stopped"].get_val("surface_area")


def masked(text):
    """Words of a printed text, and its numbers, but for times."""
    text = re.sub(r".*e-1\d .*|\d[\d.]* s\b", "", text)  # increments, with times and round-off, and other times
    number = r"(?<![\w.])[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?"
    return re.sub(r"[\s─]+", " ", re.sub(number, "#", text)), [
        float(n.replace(",", "")) for n in re.findall(number, text)
    ]


def test_the_tutorial_prints_what_it_shows_and_its_cases_are_read(tmp_path, monkeypatch, capsys):
    sys.path.insert(0, str(DOCS))
    from record_tutorial import COLUMNS, SCRIPTS, run, steps

    def called(program, arguments, folder):
        """Run a script or a command in this process, which has imported all already."""
        capsys.readouterr()
        if program != "python":
            assert cli(arguments) == 0
        elif arguments[0] == "-c":
            exec(arguments[1], {})
        else:
            runpy.run_path(arguments[0], run_name="__main__")
        return capsys.readouterr().out

    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("COLUMNS", COLUMNS)
    assert len(steps()) == 7
    printed = run(tmp_path, called)
    assert len(printed) == 7
    for name, text in printed.items():
        words, numbers = masked(text)
        shown_words, shown = masked((SCRIPTS / name).read_text(encoding="utf-8"))
        assert words == shown_words, f"{name}: run python docs/record_tutorial.py"
        off = [pair for pair in zip(numbers, shown) if abs(pair[0] - pair[1]) > 1e-4 + 0.05 * abs(pair[1])]
        assert off == [], f"{name}: run python docs/record_tutorial.py"
    the_report_of_the_tutorial_shows_all()
    the_optimum_of_the_tutorial_is_where_another_run_starts(printed["optimise.txt"])


def the_report_of_the_tutorial_shows_all():
    (report,) = code_blocks("tutorial.rst", "shell")
    if find_spec("plotly"):
        assert cli([*shlex.split(report)[1:], "--json", "report.json"]) == 0
        numbers = json.loads(Path("report.json").read_text())
        assert numbers["missing"] == []
        assert numbers["triangles"] == numbers["triangles_of_walls"] > 0


def the_optimum_of_the_tutorial_is_where_another_run_starts(printed):
    problem = importlib.import_module("optimise").pose(FittedModel.load("wing.h5"))
    assert load_best(problem, "wing.sql") > 0
    problem.run_model()
    optimum = [float(word) for word in printed.splitlines()[2].split()[1:]]
    shown = np.concatenate([problem.get_val(name) for name in ("twist", "alpha", "CL", "CD_induced", "corner_ks")])
    np.testing.assert_allclose(shown, optimum, rtol=0, atol=0.005)
    table, recorded = design_summary(problem).entries, read_history("wing.sql").quantities
    names = {each.name: each.value_names for each in table}
    assert names == {each.name: each.value_names for each in recorded}
    assert names["twist"] == ("twist[1]", "twist[2]")


def test_the_python_examples_of_the_components_run():
    chain, nodes, spar, movers = code_blocks("components.rst", "python")
    for example in (chain + nodes, spar, movers):
        contents = {"__name__": __name__}
        exec(example, contents)
        if "wing" in contents:
            walls = contents["problem"].get_val("grid").reshape(-1, 3)[contents["wing"].rows]
            np.testing.assert_allclose(walls, contents["nodes"], rtol=0, atol=1e-12)


def test_the_python_examples_of_design_run():
    problems = []
    for example in code_blocks("design.rst", "python"):
        contents = {"__name__": __name__}
        exec(example, contents)
        problems.append(contents.get("problem"))
    optimised, _, _, checked = problems
    assert optimised.get_val("volume").item() > 1.0 - 1e-6
    assert optimised.get_val("surface_area").item() < 2.2
    assert checked.get_val("leading_edge_radius").shape == (3,)


def test_the_study_of_the_page_on_studies_runs(tmp_path, monkeypatch, capsys):
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    monkeypatch.chdir(tmp_path)
    study, several = code_blocks("studies.rst", "toml")
    (boxes,) = (block for block in code_blocks("study.rst", "toml") if 'parent = "wing"' in block)
    Path("study.toml").write_text(study.replace("15x13x11", "9x9x7"))
    assert cli(["optimize", "study.toml", "-o", "out", "--max-iterations", "9"]) == 0
    assert "twist[2] (deg)" in capsys.readouterr().out
    Path("several.toml").write_text(several)
    assert list(read_study("several.toml").conditions) == ["cruise", "climb", "pull_up"]
    for name in ("wing_box.xyz", "tip_box.xyz"):
        Path(name).touch()
    Path("boxes.toml").write_text(study.partition("[variables")[0] + boxes + '[objective]\nof = "volume"\n')
    assert read_study("boxes.toml").variables["tip"]["parent"] == "wing"


@pytest.mark.filterwarnings("ignore::openmdao.api.DistributedComponentWarning")
def test_the_python_examples_of_mphys_and_of_solvers_of_others_run(tmp_path, monkeypatch):
    pytest.importorskip("mphys", reason="MPhys is not installed")
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    from mphys_cases import stand_ins

    grid = onera_m6_grid((9, 8, 7))
    monkeypatch.chdir(tmp_path)
    write_grid("wing.cgns", grid)
    fit_grid(grid).save("wing.h5")
    for name, module in stand_ins(grid).items():
        monkeypatch.setitem(sys.modules, name, module)
    pages = ("howto/adflow.rst", "howto/dafoam.rst", "mphys.rst")
    adflow, dafoam, ours = (run_blocks(page)["problem"] for page in pages)
    for problem, of in (adflow, "cruise.aero_post.cl"), (dafoam, "cruise.aero_post.CL"):
        assert np.abs(problem.compute_totals([of], ["twist"])[of, "twist"]).min() > 1e-3
    assert ours.get_val("climb.CL") > ours.get_val("cruise.CL")


def test_the_python_example_of_the_flow_runs(capsys):
    example, *_ = code_blocks("flow.rst", "python")
    contents = {"__name__": __name__}
    exec(example, contents)
    problem = contents["problem"]
    assert problem.get_val("CL") == pytest.approx(0.15, abs=0.03)
    totals = problem.compute_totals(["CL"], ["twist", "alpha"])
    assert totals["CL", "twist"].sum() == pytest.approx(totals["CL", "alpha"].item(), rel=0.05)  # all turn the same way
    assert "flow.state: residual" in capsys.readouterr().out


def test_the_examples_of_lift_loads_and_files_of_a_flow_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    contents = {"__name__": __name__}
    for example in code_blocks("flow.rst", "python"):
        exec(example, contents)
    assert abs(contents["problem"].get_val("CM_aileron").item()) > 0.0
    assert {"wing.vtm", "wing_walls.vtm", "wing.h5"} <= {path.name for path in tmp_path.iterdir()}


def test_the_derivative_of_the_mover_in_the_documentation_is_exact():
    contents = run_blocks("howto/own_mover.rst")
    mover, random = contents["mover"], np.random.default_rng(1)
    initial, surface = mover.mesh.points, mover.mesh.points[mover.mesh.surface_ids] + [0.1, 0.2, 0.0]
    direction = mover.mesh.slide(random.standard_normal(initial.shape))
    movement, step = mover.move(initial, surface), 1e-6
    points = [mover.move(initial + h * direction, surface).points for h in (step, -step)]
    change = movement.jvp(direction, np.zeros_like(surface))
    off_plate = np.abs(initial[:, 1]) > 1e-3
    np.testing.assert_allclose((points[0] - points[1])[off_plate] / (2 * step), change[off_plate], atol=1e-8)
    bar = random.standard_normal(initial.shape)
    initial_bar, _ = movement.vjp(bar)
    assert np.vdot(bar, change) == pytest.approx(np.vdot(initial_bar, direction), rel=1e-12)


def test_notebooks_are_kept_without_what_they_show():
    """The build of the documentation runs them, and fails with them."""
    index = (DOCS / "notebooks" / "index.rst").read_text(encoding="utf-8")
    paths = sorted((DOCS / "notebooks").glob("*.ipynb"))
    assert [path.stem for path in paths] == sorted(re.findall(r"^   (\w+)$", index, re.M))
    for path in paths:
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        for cell in (cell for cell in cells if cell["cell_type"] == "code"):
            assert cell["outputs"] == [], f"{path.name}: clear all outputs"
            assert cell["execution_count"] is None, f"{path.name}: clear all outputs"
