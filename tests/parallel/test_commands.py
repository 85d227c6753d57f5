"""Commands on several ranks give what they give on one, and one rank prints."""

import json
import os

import numpy as np
import openmdao.api as om
import pytest
from overset_cases import overset_grid, two_cylinders
from parallel_cases import run_ranks
from periodic_cases import passage
from riding_cases import plane_su2_text

from bspline_mdao import read_grid, write_grid
from bspline_mdao.core.model.fitted_model import FittedModel
from bspline_mdao.core.om.drivers.case_file import count_cases
from bspline_mdao.generators import ball_grid
from bspline_mdao.grids.io.run_folder import MANIFEST

pytestmark = pytest.mark.slow


def numbers_of(n, file, *arguments):
    """What a command writes as JSON on some ranks."""
    first, *others = run_ranks("cases/command.py", n, *map(str, arguments), "--json", str(file))
    assert first.endswith("\n0\n")
    assert all(text == "0\n" for text in others)
    return json.loads(file.read_text())


def fitted(n, folder):
    return numbers_of(n, folder / f"fit{n}.json", "fit", "@onera_m6:9x9x7", "-o", folder / f"{n}.h5")


def moved(n, folder):
    return numbers_of(
        n, folder / f"move{n}.json", "move", folder / "3.h5", "--deform", "twist=5deg", "-o", folder / f"{n}.xyz"
    )


@pytest.fixture(scope="module")
def wing(tmp_path_factory):
    """Folder of a wing that was fitted by three ranks and twisted by two."""
    folder = tmp_path_factory.mktemp("wing")
    fitted(3, folder)
    moved(2, folder)
    return folder


def test_a_fit_on_three_ranks_is_that_on_one(wing):
    one, three = fitted(1, wing), json.loads((wing / "fit3.json").read_text())
    for name in ("rms", "max_error", "blocks", "worst_node", "n_invalid_control_elements", "warnings"):
        assert three[name] == pytest.approx(one[name], rel=1e-12) if name == "rms" else three[name] == one[name]
    models = [FittedModel.load(wing / f"{n}.h5") for n in (1, 3)]
    np.testing.assert_array_equal(models[0].control_points, models[1].control_points)


def test_a_move_on_two_ranks_is_that_on_one(wing):
    moved(1, wing)
    assert (wing / "1.xyz").read_bytes() == (wing / "2.xyz").read_bytes()


@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize("name", ["3.h5", "2.xyz"])
def test_quality_of_several_ranks_is_that_of_one(wing, name, n):
    files = [wing / f"{name}_{ranks}.json" for ranks in (1, n)]
    for ranks, file in zip((1, n), files):
        numbers_of(ranks, file, "quality", wing / name, "--baseline", wing / "3.h5")
    assert files[0].read_bytes() == files[1].read_bytes()


def test_gaps_of_periodic_sides_are_those_of_one_rank(tmp_path):
    write_grid(tmp_path / "passage.cgns", passage())
    files = [tmp_path / f"{ranks}.json" for ranks in (1, 3)]
    found = [numbers_of(n, file, "quality", tmp_path / "passage.cgns") for n, file in zip((1, 3), files)]
    assert files[0].read_bytes() == files[1].read_bytes()
    assert len(found[1]["periodic"]) == 1


@pytest.mark.parametrize("lattice", [(), ("--lattice",)])
def test_blocks_that_a_lattice_moves_are_fitted_and_moved_on_two_ranks_as_on_one(tmp_path, lattice):
    grid = ball_grid((5, 6, 5, 4), far=3.0, octant=True) if lattice else overset_grid(4, 9)
    write_grid(tmp_path / "grid.cgns", grid)
    found = {}
    for n in (1, 2):
        model, moved = tmp_path / f"{n}.h5", tmp_path / f"{n}.cgns"
        fit = ("fit", tmp_path / "grid.cgns", *lattice, "--spacing", "0.5", "-o", model)
        found[n] = [numbers_of(n, tmp_path / "numbers.json", *fit)]
        move = ("move", model, "--deform", "stretch=1.05", "-o", moved)
        found[n].append(numbers_of(n, tmp_path / "numbers.json", *move))
        found[n].append(read_grid(moved).to_vector())
    for key in ("lattice", "n_wall_nodes", "markers"):
        assert found[1][0][key] == found[2][0][key]
    assert found[1][1].get("overlap") == found[2][1].get("overlap")
    np.testing.assert_array_equal(found[1][2], found[2][2])


def test_a_study_of_component_grids_on_two_ranks_is_that_on_one(tmp_path):
    write_grid(tmp_path / "grid.cgns", two_cylinders())
    numbers_of(1, tmp_path / "fit.json", "fit", tmp_path / "grid.cgns", "-o", tmp_path / "grid.h5")
    (tmp_path / "study.toml").write_text(OVERSET_STUDY)
    found = {}
    for n in (1, 2):
        numbers = numbers_of(n, tmp_path / f"{n}.json", "optimize", tmp_path / "study.toml", "-o", tmp_path / f"of{n}")
        moved = read_grid(tmp_path / f"of{n}" / "grid_after.cgns").to_vector()
        found[n] = moved, numbers["min_volume"]["after"], numbers["after"]["surface_area"]["values"][0]
    np.testing.assert_allclose(found[2][0], found[1][0], rtol=0.0, atol=1e-9)
    assert found[2][1:] == pytest.approx(found[1][1:], rel=1e-9)
    assert np.abs(found[1][0] - read_grid(tmp_path / "grid.cgns").to_vector()).max() > 1e-5


OVERSET_STUDY = """\
[grid]
file = "grid.h5"
[variables.shape]
kind = "lattice"
n = [4, 2, 2]
where = "1:-1, :, 0"
direction = "y"
lower = -0.02
upper = 0.02
[objective]
of = "surface_area"
ref = 0.01
[constraints.volume]
lower = 1.0
[constraints.volume_ks]
lower = 0.05
[driver]
max_iterations = 2
[output]
report = false
"""


def test_a_mesh_is_fitted_and_measured_on_two_ranks_as_on_one(tmp_path):
    (tmp_path / "wing.su2").write_text(plane_su2_text())
    found = {}
    for n in (1, 2):
        fit = numbers_of(n, tmp_path / "fit.json", "fit", tmp_path / "wing.su2", "-o", tmp_path / f"{n}.h5")
        found[n] = fit["lattice"], numbers_of(n, tmp_path / "quality.json", "quality", tmp_path / "wing.su2")
    assert found[1] == found[2]


TWO_CONDITIONS = """\
[grid]
file = "@onera_m6:7x7x5"
n_control = [5, 5, 5]
[variables.twist]
lower = -3.0
upper = 3.0
[variables.alpha]
lower = 0.0
upper = 6.0
[flow]
kind = "euler"
[conditions.cruise]
Mach_number = 0.4
CL_target = 0.2
[conditions.climb]
alpha = 3.0
[objective]
of = "CD_induced"
[constraints.climb.CL]
lower = 0.1
[driver]
max_iterations = 2
[output]
report = false
"""


def test_a_study_of_two_conditions_on_two_ranks_is_that_on_one(tmp_path):
    (tmp_path / "two.toml").write_text(TWO_CONDITIONS)
    found = {}
    for n in (1, 2):
        folder = tmp_path / f"of{n}"
        numbers = numbers_of(n, tmp_path / f"{n}.json", "optimize", tmp_path / "two.toml", "-o", folder)
        assert {path.name for path in folder.iterdir()} == {
            *("optimize.py", "model.h5", "grid_before.xyz", "grid_after.xyz", "cases.sql", "summary.csv", MANIFEST)
        }
        n_cases = len(om.CaseReader(str(folder / "cases.sql")).list_cases("driver", out_stream=None))
        found[n] = numbers["after"], read_grid(folder / "grid_after.xyz").to_vector(), n_cases
    for name, entry in found[1][0].items():
        assert found[2][0][name]["values"] == pytest.approx(entry["values"], rel=1e-7, abs=1e-9)
    np.testing.assert_allclose(found[2][1], found[1][1], rtol=0.0, atol=1e-8)
    assert found[1][2] == found[2][2] > 1
    assert found[1][0]["cruise.CL"]["values"] == pytest.approx([0.2])


def test_what_is_wrong_is_said_once_and_all_ranks_end_alike(wing):
    first, second = run_ranks("cases/command.py", 2, "quality", str(wing / "nothing.xyz"))
    assert first.splitlines()[1:] == ["2"]
    assert "does not exist" in first
    assert second == "2\n"


def test_a_report_and_an_improvement_on_two_ranks_are_those_on_one(wing):
    for n in (1, 2):
        numbers_of(n, wing / f"report{n}.json", "report", wing / "3.h5", "-o", wing / f"{n}.html")
        numbers_of(
            n, wing / f"improve{n}.json", "improve", wing / "3.h5", "-o", wing / f"better{n}.xyz", "--iterations", 2
        )
    assert (wing / "better1.xyz").read_bytes() == (wing / "better2.xyz").read_bytes()
    reports = [json.loads((wing / f"report{n}.json").read_text()) for n in (1, 2)]
    assert reports[0]["triangles"] == reports[1]["triangles"] > 0


def test_a_report_of_a_missing_file_is_refused_on_all_ranks(tmp_path):
    first, *others = run_ranks(
        "cases/command.py", 2, "report", str(tmp_path / "none.h5"), "-o", str(tmp_path / "r.html")
    )
    assert first.endswith("2\n")
    assert others == ["2\n"]


def test_a_run_of_one_rank_goes_on_with_two_in_one_history(tmp_path):
    (tmp_path / "two.toml").write_text(TWO_CONDITIONS)
    command = ("optimize", tmp_path / "two.toml", "-o", tmp_path / "out")
    numbers_of(1, tmp_path / "1.json", *command)
    n = count_cases(tmp_path / "out" / "cases.sql")
    assert numbers_of(2, tmp_path / "2.json", *command, "--restart")["evaluations_before"] == n
    reader = om.CaseReader(str(tmp_path / "out" / "cases.sql"))
    cases = [reader.get_case(name) for name in reader.list_cases("driver", out_stream=None)]
    assert len(cases) > n
    twists = [case["twist"].item() for case in cases]
    assert min(abs(twists[n] - twist) for twist in twists[:n]) < 1e-12


def test_several_ranks_without_petsc_say_so_once(tmp_path, monkeypatch):
    (tmp_path / "petsc4py").mkdir()
    (tmp_path / "petsc4py" / "__init__.py").write_text("raise ImportError('libpetsc.so: no such file')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    (tmp_path / "two.toml").write_text(TWO_CONDITIONS)
    command = ("optimize", str(tmp_path / "two.toml"), "-o", str(tmp_path / "out"))
    first, second = run_ranks("cases/command.py", 2, *command, afresh=True)
    words = "bspline-mdao: a study on several processes needs petsc4py, which is installed but cannot be imported"
    assert [first.startswith(words), first.endswith("\n2\n"), second] == [True, True, "2\n"]
    assert not (tmp_path / "out").exists()
