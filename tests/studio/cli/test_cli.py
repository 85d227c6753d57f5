"""The command line: numbers, tables, exit statuses and what it never does to files."""

import json
import math
import os
import re
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from component_cases import two_blocks

from bspline_mdao import FittedModel, Grid, __version__, read_grid, write_grid
from bspline_mdao.base.numerics.progress import SWITCH
from bspline_mdao.core.fit.options import EXPONENTS, METHODS
from bspline_mdao.core.generators.built_in import BUILT_IN
from bspline_mdao.generators import airfoil_grid, onera_m6_grid
from bspline_mdao.grids.cells.aggregates import AGGREGATES
from bspline_mdao.grids.topology.grid import Block
from bspline_mdao.studio.cli import fit
from bspline_mdao.studio.cli.commands import bspline_mdao as program
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.cli.output import written_json
from bspline_mdao.studio.cli.sources import load_grid

COMMANDS = ("inspect", "fit", "refine", "ride", "quality")


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def grid_file(workplace):
    write_grid("two.xyz", two_blocks())
    return "two.xyz"


@pytest.fixture(scope="module")
def model_bytes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    write_grid(folder / "two.xyz", two_blocks())
    assert run(["fit", str(folder / "two.xyz"), "-o", str(folder / "two.h5")]) == 0
    return (folder / "two.h5").read_bytes()


@pytest.fixture
def model_file(workplace, model_bytes):
    (workplace / "two.h5").write_bytes(model_bytes)
    return "two.h5"


def numbers(path):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(Path(path).read_text(), parse_constant=refuse)


def fails(arguments, capsys, *words):
    """Assert that a command ends with status 2 and one line, after warnings, that holds the words."""
    capsys.readouterr()
    assert run(arguments) == 2
    *warnings, error = capsys.readouterr().err.splitlines()
    assert error.startswith("bspline-mdao: ")
    assert all(line.startswith("warning: ") for line in warnings)
    for word in words:
        assert word in error, error
    return error


def fails_as_expected(arguments, capsys, *words):
    """Assert the same, and that it was foreseen."""
    assert "unexpected" not in fails(arguments, capsys, *words)


@pytest.mark.slow
def test_inspect_tells_the_spacings_at_walls(workplace, capsys):
    assert run(["inspect", "@flat_plate:9x8x7", "--reynolds", "1e6", "--json", "i.json"]) == 0
    upper, lower = numbers("i.json")["walls"]
    assert (upper["patch"], lower["patch"]) == ("wing_upper", "wing_lower")
    assert upper["height_min"] > 0.0
    assert upper["growth_median"] > 1.0
    assert upper["y_plus"] > 100.0
    assert "y+" in capsys.readouterr().out


@pytest.mark.slow
def test_inspect_guesses_what_is_a_wall_where_nothing_is_declared(workplace, capsys):
    write_grid("bare.xyz", replace(onera_m6_grid((9, 8, 7)), patches=()))
    assert run(["inspect", "bare.xyz", "--json", "i.json"]) == 0
    assert [wall["patch"] for wall in numbers("i.json")["walls"]] == ["wall (guessed)"]
    assert "y+" not in capsys.readouterr().out


def test_inspect_tells_what_the_grid_is(grid_file, capsys):
    assert run(["inspect", grid_file, "--json", "i.json"]) == 0
    found = numbers("i.json")
    assert found["blocks"] == [[7, 8, 6], [9, 8, 6]]
    assert found["n_nodes"] == 7 * 8 * 6 + 9 * 8 * 6
    assert (found["n_interfaces"], found["n_boundary_faces"], found["n_collapsed_faces"]) == (1, 10, 0)
    assert found["near_misses"] == []
    table = capsys.readouterr().out
    assert "7 x 8 x 6" in table
    assert "block 2 imax" in table


def test_a_near_miss_is_reported_with_its_place(workplace, capsys):
    grid = two_blocks()
    grid.blocks[1].nodes[0] += 2e-4
    write_grid("near.xyz", grid)
    assert run(["inspect", "near.xyz", "--json", "i.json"]) == 0
    (miss,) = numbers("i.json")["near_misses"]
    assert {miss["block"], miss["other"]["block"]} == {1, 2}
    assert miss["gap"] == pytest.approx(2e-4 * math.sqrt(3.0), rel=1e-6)
    assert "near miss: block 1 imax and block 2 imin" in capsys.readouterr().out


def test_a_collapsed_face_is_counted(workplace):
    grid = two_blocks()
    grid.blocks[0].nodes[0] = grid.blocks[0].nodes[0, :1]
    write_grid("pole.xyz", grid)
    assert run(["inspect", "pole.xyz", "--json", "i.json"]) == 0
    assert numbers("i.json")["n_collapsed_faces"] == 1


def test_a_draft_can_be_passed_on_as_patches(grid_file, capsys):
    assert run(["inspect", grid_file, "--draft", "two.toml"]) == 0
    assert run(["inspect", grid_file, "--patches", "two.toml", "--json", "i.json"]) == 0
    found = numbers("i.json")
    assert found["n_interfaces"] == 1
    assert sum(len(patch["windows"]) for patch in found["patches"]) == 10


@pytest.mark.slow
def test_a_draft_shows_its_guesses_and_how_sure_it_is(workplace, capsys):
    write_grid("bare.xyz", replace(onera_m6_grid((9, 8, 7)), patches=()))
    assert run(["inspect", "bare.xyz"]) == 0
    assert "--draft FILE.toml shows the guesses" in capsys.readouterr().out
    assert run(["inspect", "bare.xyz", "--draft", "bare.toml", "--json", "i.json"]) == 0
    guesses = {guess["name"]: guess for guess in numbers("i.json")["guesses"]}
    assert {name: guess["sureness"] for name, guess in guesses.items()} == {
        "symmetry_z": "likely",
        "wall": "sure",
        "farfield": "sure",
    }
    assert all(guess["sure"] + guess["likely"] + guess["unsure"] > 0 for guess in guesses.values())
    out, draft = capsys.readouterr().out, Path("bare.toml").read_text()
    assert "least sure" in out
    assert all(guess["reason"] in draft for guess in guesses.values())


def test_a_draft_without_a_wall_says_so(workplace, capsys):
    x = np.stack(np.meshgrid(*[np.linspace(1.0, 2.0, 5)] * 3, indexing="ij"), axis=-1)
    write_grid("box.xyz", Grid((Block(x, "box"),), source="box"))
    assert run(["inspect", "box.xyz", "--draft", "box.toml"]) == 0
    assert "no face looks like a wall" in "".join(capsys.readouterr())


def test_numbers_of_one_have_no_plural(grid_file, capsys):
    assert run(["inspect", grid_file]) == 0
    assert "1 interface, 10 boundary faces, 0 collapsed faces, 0 near misses" in capsys.readouterr().out


def test_folders_that_are_missing_are_made_and_a_failure_leaves_none(model_file, capsys):
    assert run(["refine", model_file, "--factor", "2", "-o", "a/b/fine.xyz", "--json", "c/n.json"]) == 0
    assert Path("a/b/fine.xyz").is_file()
    assert Path("c/n.json").is_file()
    fails_as_expected(["refine", model_file, "--factor", "1e6", "-o", "d/e/fine.xyz", "--json", "f/n.json"], capsys)
    assert not Path("d").exists()
    assert not Path("f").exists()


def test_fit_warns_of_a_far_field_that_is_declared_symmetry_and_not_plane(workplace, capsys):
    grid = airfoil_grid("naca0012", 24, 8)
    for name, kind in (("usual", "farfield"), ("wrong", "symmetry")):
        patches = tuple(replace(patch, kind=kind) if patch.kind == "farfield" else patch for patch in grid.patches)
        write_grid(f"{name}.cgns", replace(grid, patches=patches))
        assert run(["fit", f"{name}.cgns", "-o", f"{name}.h5"]) == 0
        error = capsys.readouterr().err
        assert (" is of kind symmetry, but leaves its plane by " in error) == (name == "wrong")
    assert run(["move", "wrong.h5", "--deform", "pitch=1", "-o", "moved.xyz"]) == 2
    assert error.splitlines()[-1].removeprefix("warning: ") in capsys.readouterr().err  # as move says
    assert run(["fit", "@flat_plate:5x5x5", "-o", "plane.h5"]) == 0
    assert "leaves its plane" not in capsys.readouterr().err


def test_fit_says_before_it_fits_what_a_grid_without_walls_is_not_good_for(workplace, capsys):
    grid = two_blocks()
    write_grid("bare.xyz", grid)
    assert run(["fit", "bare.xyz", "-o", "a.h5"]) == 0
    (warning,) = capsys.readouterr().err.splitlines()
    assert warning.startswith("warning: bare.xyz has no patches")
    assert "inspect bare.xyz --draft patches.toml" in warning
    Path("p.toml").write_text(
        '[[patch]]\nname = "side"\nkind = "other"\nfaces = [{block = 1, face = "kmin"}]\n', encoding="utf-8"
    )
    assert run(["fit", "bare.xyz", "--patches", "p.toml", "-o", "a.h5", "--overwrite"]) == 0
    assert capsys.readouterr().err.startswith("warning: no patch of bare.xyz is a wall (side)")
    assert run(["fit", "@flat_plate:5x5x5", "-o", "b.h5", "--overwrite"]) == 0
    assert "is a wall" not in "".join(capsys.readouterr())


def test_fit_tells_how_good_it_is(grid_file, capsys):
    assert run(["fit", grid_file, "-o", "two.h5", "--n-control", "5x6x4", "--json", "f.json"]) == 0
    found = numbers("f.json")
    assert found["n_nodes"] == 768
    assert found["n_control_points"] == (5 + 5 - 1) * 6 * 4
    assert [block["n_control"] for block in found["blocks"]] == [[[5, 6, 4]], [[5, 6, 4]]]
    assert 0.0 < found["rms"] < 1e-2
    assert len(found["max_error"]) == 3
    assert max(found["max_error"]) >= found["rms"] / math.sqrt(3.0)
    assert 0.0 < found["relative_rms"] < 0.05
    assert found["seconds"] > 0.0
    assert found["certificate"]["status"] == "valid"
    assert [block["n"] for block in found["certificate"]["splines"]] == [2 * 3 * 1] * 2
    table = capsys.readouterr().out
    assert all(text in table for text in ("worst node", "9 x 8 x 6", "5 x 6 x 4"))
    worst = found["worst_local"]
    place = f"block {worst['block']}, ({worst['i']}, {worst['j']}, {worst['k']})"
    assert f"largest by the width of the cells there: anywhere {worst['in_widths']:.3g} at {place}" in table
    assert worst["in_widths"] == worst["error"] / worst["width"]
    assert found["worst_on_walls"] is None
    assert (
        "all 12 spline elements valid: their Jacobian is proved positive everywhere between neighbouring knots" in table
    )
    model = FittedModel.load("two.h5")
    assert model.report.rms == found["rms"]
    np.testing.assert_allclose(model.regenerate().to_vector(), read_grid(grid_file).to_vector(), atol=1e-14)


def test_inspect_of_a_model_shows_its_grid_and_its_fit(workplace, capsys):
    assert run(["fit", "@onera_m6:9x9x7", "-o", "wing.h5", "--json", "fit.json"]) == 0
    shown = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("largest by the width"))
    assert "; on walls" in shown
    assert run(["inspect", "wing.h5", "--json", "inspect.json"]) == 0
    out = capsys.readouterr().out
    assert shown in out
    assert "23 interfaces" in out or "interfaces, " in out
    found, fitted = numbers("inspect.json"), numbers("fit.json")
    assert found["n_nodes"] == fitted["n_nodes"]
    fit = found["fit"]
    assert fit.pop("certificate") is None
    fitted.pop("certificate")
    assert fit == fitted
    assert fit["worst_on_walls"]["patch"] == "wing_lower"
    assert run(["inspect", "wing.h5", "--patches", "wing.toml"]) == 2
    assert "leave wing.toml out" in capsys.readouterr().err


def test_fit_takes_control_points_of_single_blocks(grid_file, capsys):
    assert run(["fit", grid_file, "-o", "two.h5", "--n-control", "5x6x20", "--n-control", "2=7x6x5"]) == 0
    assert [volume.n_control for volume in FittedModel.load("two.h5").mesh.volumes] == [(5, 6, 5), (7, 6, 5)]
    assert "warning: no more control points than nodes where more were asked for (1): block 1 k (6)" in "".join(
        capsys.readouterr()
    )


@pytest.mark.slow
def test_fit_options_reach_the_fit(grid_file):
    base = ["fit", grid_file, "--n-control", "5x6x5"]
    assert run([*base, "-o", "a.h5", "--json", "a.json"]) == 0
    assert run([*base, "-o", "b.h5", "--json", "b.json", "--correct", "2", "--order", "3", "--no-residual"]) == 0
    assert run([*base, "-o", "c.h5", "--json", "c.json", "--correct", "2", "--no-certify"]) == 0
    assert FittedModel.load("b.h5").residual is None
    assert FittedModel.load("b.h5").mesh.volumes[0].orders == (3, 3, 3)
    assert numbers("c.json")["rms"] < 0.9 * numbers("a.json")["rms"]
    assert numbers("c.json")["certificate"] is None


def test_a_fit_is_shown_before_its_splines_are_proved(grid_file, capsys, monkeypatch):
    seen, proof = [], fit.splines_certificate
    monkeypatch.setattr(fit, "splines_certificate", lambda model: seen.append(capsys.readouterr().out) or proof(model))
    assert run(["fit", grid_file, "-o", "two.h5"]) == 0
    assert ["RMS error" in text and "written" not in text for text in seen] == [True]
    after = capsys.readouterr().out
    assert "RMS error" not in after
    assert after.index("proved positive everywhere") < after.index("two.h5 written")


@pytest.mark.slow
def test_fit_knows_the_built_in_grids_by_name(workplace, capsys):
    assert run(["inspect", "@flat_plate", "--json", "i.json"]) == 0
    assert len(numbers("i.json")["blocks"]) == 12
    fails_as_expected(["inspect", "@boing"], capsys, "boing", "flat_plate", "onera_m6")


@pytest.mark.parametrize(("factor", "cells"), [(2.0, [[13, 15, 11], [17, 15, 11]]), (1.0, [[7, 8, 6], [9, 8, 6]])])
def test_refine_writes_the_family_member(model_file, factor, cells):
    assert run(["refine", model_file, "--factor", str(factor), "-o", "fine.xyz", "--json", "r.json"]) == 0
    assert numbers("r.json")["blocks"] == cells
    assert [list(shape) for shape in read_grid("fine.xyz").shapes] == cells


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_an_example(command, capsys):
    assert run([command, "--help"]) == 0
    assert f"  bspline-mdao {command} wing" in capsys.readouterr().out


def test_help_defines_what_is_measured(capsys):
    for command in ("quality", "move"):
        assert run([command, "--help"]) == 0
        text = capsys.readouterr().out
        assert all(f"{word}:" in text for word in ("Corner", "Corner Jacobian", "Q", "KS"))
        assert {name for name in ("corner_ks", "quality_ks") if name in text} <= set(AGGREGATES)


@pytest.mark.slow
def test_help_waits_for_nothing_heavy():
    code = (
        "import sys\nfrom bspline_mdao.studio.cli.main import run\n"
        "assert run(['fit', '--help']) == 0\nassert 'numpy' not in sys.modules, 'numpy'\n"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60).returncode == 0


def test_without_a_command_help_is_shown(capsys):
    assert run([]) == 0
    assert all(command in capsys.readouterr().out for command in ("Usage",))


def test_version_is_that_of_the_package(capsys):
    assert run(["--version"]) == 0
    assert __version__ in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["inspekt"], ["inspekt", "--help"]),
        (["fit", "two.xyz"], ["-o", "bspline-mdao fit --help"]),
        (["fit", "two.xyz", "-o", "a.h5", "--n-control", "5xxx5"], ["--n-control", "'5xxx5'", "2=13x9x7"]),
        (["fit", "two.xyz", "-o", "a.h5", "--n-control", "5x6x5", "--n-control", "5x6x6"], ["all blocks twice"]),
        (["fit", "two.xyz", "-o", "b.h5", "--n-control", "3=5x5x5"], ["two.xyz", "block 3", "1 to 2"]),
        (["fit", "two.xyz", "-o", "a.h5", "--order", "1"], ["--order", "1"]),
        (["fit", "two.xyz", "-o", "a.h5", "--zoom"], ["--zoom"]),
        (["fit", "missing.xyz", "-o", "a.h5"], ["missing.xyz"]),
        (["fit", ".", "-o", "a.h5"], ["."]),
        (["fit", "two.xyz", "-o", "two.xyz/a.h5"], ["two.xyz/a.h5", "no folder"]),
        (["fit", "two.xyz", "-o", "."], ["folder"]),
        (["fit", "two.xyz", "-o", "two.xyz"], ["two.xyz", "another name"]),
        (["fit", "two.xyz", "-o", "a.h5", "--json", "a.h5"], ["a.h5", "twice"]),
        (["fit", "two.xyz", "-o", "a.h5", "--patches", "none.toml"], ["none.toml"]),
        (["fit", "two.xyz", "-o", "b.h5", "--n-control", "50x1x50"], ["two.xyz", "1 control point"]),
        (["fit", "two.xyz", "-o", "a.h5", "--method", "smooth"], ["--method", "quasi_interpolant"]),
        (["inspect", "two.xyz", "--json", "two.xyz"], ["two.xyz", "another name"]),
        (["refine", "two.xyz", "--factor", "2", "-o", "a.xyz"], ["two.xyz"]),
        (["refine", "missing.h5", "--factor", "2", "-o", "a.xyz"], ["missing.h5"]),
        (["refine", "two.xyz", "--factor", "0", "-o", "a.xyz"], ["--factor"]),
        (["inspect", "@flat_plate:999x999x999"], ["997,002,999 nodes per block", "lower"]),
    ],
)
def test_what_is_wrong_is_said_in_one_line(grid_file, capsys, arguments, words):
    before = sorted(os.listdir())
    fails_as_expected(arguments, capsys, *words)
    assert sorted(os.listdir()) == before


def test_a_damaged_model_is_refused(model_file, capsys):
    Path("half.h5").write_bytes(Path(model_file).read_bytes()[:3000])
    fails_as_expected(["refine", "half.h5", "--factor", "2", "-o", "a.xyz"], capsys, "half.h5")


@pytest.mark.parametrize("factor", ["1e6", "nan", "inf", "1e300"])
def test_a_factor_that_makes_no_grid_is_refused(model_file, capsys, factor):
    fails_as_expected(["refine", model_file, "--factor", factor, "-o", "a.xyz"], capsys, "factor")


@pytest.mark.parametrize("command", [["fit", "two.xyz", "-o"], ["inspect", "two.xyz", "--json"]])
def test_a_device_is_not_replaced_by_a_file(grid_file, capsys, command):
    os.mkfifo("pipe")
    fails_as_expected([*command, "pipe"], capsys, "pipe", "device")
    assert Path("pipe").is_fifo()


@pytest.mark.slow
@pytest.mark.parametrize("limit", [0, 3_000])
def test_a_full_disk_is_reported_in_one_line_and_leaves_existing_outputs_alone(grid_file, limit):
    for name in ("two.h5", "f.json"):
        Path(name).write_text("precious")

    def limit_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    program = start("fit", grid_file, "-o", "two.h5", "--json", "f.json", preexec_fn=limit_files)
    _, error = program.communicate(timeout=120)
    assert (program.returncode, error.count("\n")) == (2, 1), error
    assert "two.h5" in error or "f.json" in error
    assert all(Path(name).read_text() == "precious" for name in ("two.h5", "f.json"))
    assert sorted(os.listdir()) == ["f.json", "two.h5", "two.xyz"]


def test_a_successful_command_replaces_an_existing_output(grid_file):
    Path("i.json").write_text("old")
    assert run(["inspect", grid_file, "--json", "i.json"]) == 0
    assert numbers("i.json")["n_interfaces"] == 1


def test_an_unexpected_error_is_one_line_too(grid_file, capsys, monkeypatch):
    def broken(*arguments):
        raise ZeroDivisionError("first line\nsecond line")

    monkeypatch.setattr("bspline_mdao.studio.cli.inspect.find_topology", broken)
    fails(["inspect", grid_file], capsys, "unexpected ZeroDivisionError", "--verbose")


def test_numbers_that_are_not_finite_become_null(workplace):
    with written_json(workplace / "n.json", {"a": math.nan, "b": [1.0, (math.inf, np.int64(2))]}):
        pass
    assert numbers("n.json") == {"a": None, "b": [1.0, [None, 2]]}


def test_truth_values_of_python_and_numpy_are_those_of_json(workplace):
    with written_json(workplace / "n.json", {"a": True, "b": (np.bool_(False), np.bool_(True), 1, 0.0)}):
        pass
    assert "".join(Path("n.json").read_text().split()) == '{"a":true,"b":[false,true,1,0.0]}'


def test_an_interrupted_command_exits_with_130(grid_file, capsys, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("bspline_mdao.studio.cli.inspect.find_topology", interrupted)
    assert run(["inspect", grid_file, "--json", "i.json"]) == 130
    assert capsys.readouterr().err.strip() == "bspline-mdao: interrupted; each output is complete or as it was before"
    assert os.listdir() == ["two.xyz"]


def start(*arguments, **settings):
    """Start the real program."""
    command = [sys.executable, "-m", "bspline_mdao", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **settings)


@pytest.mark.slow
def test_the_program_itself_fails_in_one_line(workplace):
    program = start("fit", "missing.xyz", "-o", "a.h5")
    _, error = program.communicate(timeout=120)
    assert program.returncode == 2
    assert error.count("\n") == 1
    assert "Traceback" not in error


@pytest.mark.slow
def test_the_program_survives_a_closed_pipe(grid_file):
    program = start("inspect", grid_file, env={**os.environ, "PYTHONUNBUFFERED": "1", SWITCH: "0"})
    program.stdout.close()
    assert program.stderr.read() == ""
    assert program.wait(timeout=120) == 0


@pytest.mark.slow
def test_the_program_prints_names_that_the_terminal_cannot_show(workplace):
    write_grid("flügel.xyz", two_blocks())
    program = start("inspect", "flügel.xyz", env={**os.environ, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"})
    output, error = program.communicate(timeout=120)
    assert (program.returncode, error) == (0, "")
    assert "2 blocks" in output


def test_choices_of_fit_are_those_that_there_are():
    choices = {option.name: getattr(option.type, "choices", ()) for option in program.commands["fit"].params}
    assert tuple(choices["method"]) == tuple(METHODS)
    assert tuple(choices["parametrization"]) == tuple(EXPONENTS)


@pytest.mark.slow
def test_every_built_in_grid_is_made_in_its_usual_size():
    for name, (_, shape) in BUILT_IN.items():
        assert set(load_grid(f"@{name}").shapes) == {shape}


def test_refine_writes_curved_elements(model_file, capsys):
    for name in ("curved.cgns", "curved.msh"):
        assert run(["refine", model_file, "--degree", "2", "-o", name, "--json", "c.json"]) == 0
        numbers = json.loads(Path("c.json").read_text())
        assert numbers["degree"] == 2
        assert numbers["n_inverted"] == 0 < numbers["worst_jacobian"] < 1
        assert sum(numbers["patches"].values()) > 0
        assert Path(name).stat().st_size > 27 * numbers["n_elements"]
    assert "curved hexahedra of degree 2" in capsys.readouterr().out
    fails_as_expected(["refine", model_file, "--factor", "1", "--degree", "2", "-o", "a.xyz"], capsys, ".cgns or .msh")
    fails_as_expected(["refine", model_file, "--factor", "1", "--allow-invalid", "-o", "a.xyz"], capsys, "--degree")


def test_inspect_shows_what_undeclared_faces_are_guessed_to_be(workplace, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    write_grid("bare.xyz", onera_m6_grid((7, 9, 7)))
    assert run(["inspect", "bare.xyz"]) == 0
    shown = capsys.readouterr().out
    assert re.findall(r"\w+, guessed", shown) == ["symmetry, guessed", "wall, guessed", "farfield, guessed"]
    assert " - " not in shown
