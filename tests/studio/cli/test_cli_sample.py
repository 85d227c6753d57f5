"""The command ``sample``: a folder with a script, designs and their card, and what it refuses."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from mesh_cases import mesh_around_a_body
from riding_cases import su2_text
from test_optimize_mesh import BOX

from bspline_mdao import FittedModel, read_grid
from bspline_mdao.errors import InputError
from bspline_mdao.files import read_mesh
from bspline_mdao.sampling import Designs
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.study.reader import read_study
from bspline_mdao.studio.study.shape_script import StudiedShape

STUDY = """[grid]
file = "@flat_plate:6x5x5"

[variables.twist]
stations = 3
values = [2, 3]
lower = -3.0
upper = 2.0

[variables.alpha]
lower = -3.0
upper = 9.0

[measures.surface_area]

[flow]
kind = "lattice"
alpha = 3.0
Mach_number = 0.3

[objective]
of = "CD_induced"

[constraints.surface_area]
lower = 0.9

[output]
report = false
"""


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """Run the command in a folder with the study and return what it prints."""
    monkeypatch.chdir(tmp_path)
    Path("study.toml").write_text(STUDY)

    def command(*arguments, status=0):
        assert run(["sample", "study.toml", *arguments]) == status
        printed = capsys.readouterr()
        return "".join(printed) if status == 0 else printed.err

    return command


def test_a_study_becomes_designs_a_card_and_a_script_that_goes_on(said):
    words = said("-n", "3", "-o", "out", "--grids", "--json", "out.json")
    assert "3 of 3 designs made, 0 refused" in words
    designs, model = Designs("out/designs.h5"), FittedModel.load("out/model.h5")
    assert list(designs.ranges) == ["twist[1]", "twist[2]"]
    assert set(designs.outputs) == {"surface_area"}
    written = read_grid("out/grids/design_00002.xyz").to_vector()
    np.testing.assert_allclose(written, designs.grid(1, model).to_vector(), rtol=0.0, atol=1e-15)
    card = Path("out/card.md").read_text()
    assert "| twist[1] | -3 | 2 | deg |" in card
    assert "3 designs of 3, 0 refused" in card
    numbers = json.loads(Path("out.json").read_text())
    assert (numbers["n_made"], numbers["refused"]) == (3, {})
    before = Path("out/designs.h5").read_bytes()
    runpy.run_path("out/sample.py", run_name="__main__")
    assert Path("out/designs.h5").read_bytes() == before
    assert "3 of 3 designs made" in said("-n", "3", "-o", "out", "--restart")


def test_the_flow_of_the_study_is_solved_on_demand(said):
    said("-n", "2", "-o", "out", "--flow", "--store", "nothing", "--plan", "latin-hypercube", "--seed", "5")
    designs = Designs("out/designs.h5")
    assert list(designs.ranges) == ["twist[1]", "twist[2]", "alpha"]
    assert designs.about["plan"] == "LatinHypercube(2, seed=5)"
    assert {"CL", "CD_induced", "surface_area"} <= set(designs.outputs)
    assert np.ptp(designs.outputs["CL"]) > 0.01


def test_designs_of_a_table_are_made_and_refusals_are_counted(said):
    Path("table.csv").write_text("twist[1],twist[2]\n1,2\n80,-170\n")
    words = said("--plan", "table.csv", "-o", "out", "--store", "control_points", "--single")
    assert "1 of 2 designs made, 1 refused" in words
    assert "1 design refused: " in words
    assert "## What was refused" in Path("out/card.md").read_text()


def test_a_mesh_without_structure_is_sampled_and_written_in_its_own_format(said):
    Path("body.su2").write_text(su2_text(mesh_around_a_body()[0]))
    assert run(["fit", "body.su2", "-o", "body.h5", "--spacing", "0.4"]) == 0
    Path("study.toml").write_text(BOX)
    assert "2 of 2 designs made" in said("-n", "2", "-o", "out", "--grids")
    written = read_mesh("out/grids/design_00001.su2").mesh.points
    np.testing.assert_allclose(written, Designs("out/designs.h5")[0][1], rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("-o", "out"), "give -n, the number of designs"),
        (("-n", "2", "--plan", "sobl", "-o", "out"), "is no file, and none of sobol, latin-hypercube"),
        (("-n", "2", "--plan", "study.toml", "-o", "out"), "leave -n out"),
        (("-n", "2", "-o", "out", "--restart"), "has no designs.h5 to continue with"),
        (("-n", "2", "-o", "study.toml"), "is a file; name a folder"),
        (("-n", "2", "-o", "."), "is not empty"),
    ],
)
def test_what_contradicts_itself_is_refused_and_nothing_is_written(said, arguments, complaint):
    words = said(*arguments, status=2)
    assert complaint in " ".join(words.split())
    assert [path.name for path in Path().iterdir()] == ["study.toml"]


def test_a_study_without_a_flow_has_none_to_solve(said):
    head, _, tail = STUDY.partition("[variables.alpha]")
    rest = tail.partition("[measures.surface_area]")[2].partition("[flow]")[0]
    Path("study.toml").write_text(f'{head}[measures.surface_area]{rest}[objective]\nof = "surface_area"\n')
    assert "has no [flow] to solve" in said("-n", "2", "-o", "out", "--flow", status=2)


@pytest.mark.parametrize("key", ["design", "fixed"])
def test_a_wall_that_is_not_there_is_named_with_file_and_line_in_every_run_of_a_study(said, capsys, key):
    Path("study.toml").write_text(STUDY.replace("[variables.twist]", f'{key} = ["wng"]\n\n[variables.twist]', 1))
    sampled = said("-n", "3", "-o", "out", status=2)
    assert f"study.toml: line 4: [grid] '{key}': " in sampled
    assert "'wng'; the patches are" in sampled
    assert run(["optimize", "study.toml", "-o", "other"]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == sampled.splitlines()[-1]
    with pytest.raises(InputError) as shown:
        StudiedShape.of(read_study(Path("study.toml")))
    assert sampled.splitlines()[-1] == f"bspline-mdao: {shown.value}"
