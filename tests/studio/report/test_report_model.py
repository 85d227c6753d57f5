"""A report of a case file finds the model by itself, and says which it wants where it does not."""

import shutil
import subprocess
import sys

import openmdao.api as om
import pytest
from report_cases import small_model

from bspline_mdao import DesignSurface, FittedModel, fit_grid, write_report
from bspline_mdao.core.model.model_file import checksum_in
from bspline_mdao.core.om.drivers.case_history import read_history
from bspline_mdao.core.om.model_option import named_model
from bspline_mdao.design import Twist
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality
from bspline_mdao.studio.cli.main import run

pytest.importorskip("plotly", reason="plotly is not installed")
pytest.importorskip("jinja2", reason="jinja2 is not installed")


def record(model, file, includes=()):
    """Run a wing once, with a recorder on its driver."""
    problem, wing = om.Problem(reports=None), DesignSurface.of(model)
    shape = wing.grid_movement([Twist("twist", wing.axis, stations=2)], quality=["corner_ks"])
    problem.model.add_subsystem("shape", shape, promotes=["*"])
    problem.model.add_design_var("twist")
    problem.model.add_objective("corner_ks")
    problem.driver.add_recorder(om.SqliteRecorder(file))
    problem.driver.recording_options["includes"] = list(includes)
    problem.setup(mode="fwd")
    problem.run_driver()
    problem.cleanup()


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    """A folder as a script leaves it: the model, and the case file in a folder of outputs."""
    folder = tmp_path_factory.mktemp("run")
    model = small_model()
    model.save(folder / "wing.h5")
    (folder / "wing_out").mkdir()
    record(FittedModel.load(folder / "wing.h5"), folder / "wing_out/cases.sql", ["*control_points"])
    return folder


@pytest.fixture
def moved(run_folder, tmp_path):
    """The folder, moved to another place."""
    shutil.copytree(run_folder, tmp_path / "moved")
    run_folder.joinpath("wing.h5").rename(run_folder / "away.h5")
    yield tmp_path / "moved"
    run_folder.joinpath("away.h5").rename(run_folder / "wing.h5")


def not_shown(folder, case_file="wing_out/cases.sql"):
    found = write_report(folder / "r.html", folder / case_file)["missing"]
    return [line for line in found if "The grid is not shown" in line]


@pytest.mark.slow
def test_checksum_of_a_model_is_that_of_its_file_and_changes_with_it(tmp_path):
    model = small_model()
    assert model.file is None
    model.save(tmp_path / "a.h5")
    again = FittedModel.load(tmp_path / "a.h5")
    assert model.file == again.file == tmp_path / "a.h5"
    assert model.checksum == again.checksum != fit_grid(onera_m6_grid((5, 5, 6))).checksum


@pytest.mark.slow
def test_equal_fits_have_equal_checksums_and_keep_their_times(tmp_path):
    models = [small_model() for _ in range(2)]
    assert models[0].report.seconds != models[1].report.seconds
    assert models[0].checksum == models[1].checksum
    models[1].save(tmp_path / "b.h5")
    again = FittedModel.load(tmp_path / "b.h5")
    assert again.report.seconds == models[1].report.seconds > 0.0
    assert again.checksum == models[0].checksum == checksum_in(tmp_path / "b.h5")


def test_a_report_finds_the_model_that_its_case_file_names(run_folder, capsys):
    assert run(["report", str(run_folder / "wing_out/cases.sql"), "-o", str(run_folder / "r.html")]) == 0
    assert "The grid is not shown" not in capsys.readouterr().out
    assert not_shown(run_folder) == []


def test_a_case_file_that_was_moved_with_its_model_still_finds_it(moved):
    assert not_shown(moved) == []
    (moved / "wing.h5").rename(moved / "wing_out/wing.h5")
    assert not_shown(moved) == []


def test_a_model_that_is_missing_or_changed_is_named(moved, run_folder):
    (moved / "wing.h5").unlink()
    (line,) = not_shown(moved)
    assert str(run_folder / "wing.h5") in line
    assert "--model" in line
    fit_grid(onera_m6_grid((5, 5, 6))).save(moved / "wing.h5")
    (line,) = not_shown(moved)
    assert f"{moved / 'wing.h5'} is not the model" in line


@pytest.mark.slow
def test_a_model_that_was_saved_after_the_run_is_found_by_its_checksum(tmp_path):
    model = small_model()
    record(model, tmp_path / "cases.sql")
    (line,) = not_shown(tmp_path, "cases.sql")
    assert "model.save(...)" in line
    fit_grid(onera_m6_grid((5, 5, 6))).save(tmp_path / "a_other.h5")
    model.save(tmp_path / "wing.h5")
    assert not_shown(tmp_path, "cases.sql") == []


@pytest.mark.slow
def test_case_files_are_read_without_this_package(run_folder):
    assert named_model(read_history(run_folder / "wing_out/cases.sql").options).file == str(run_folder / "wing.h5")
    code = (
        "import sys, openmdao.api as om; options = om.CaseReader(sys.argv[1])._system_options; "
        "print(options['shape']['component_options']['model_in_records'], 'bspline_mdao' in sys.modules)"
    )
    found = subprocess.run(
        [sys.executable, "-c", code, str(run_folder / "wing_out/cases.sql")], capture_output=True, text=True, check=True
    )
    assert found.stdout.split()[1:] == [str(run_folder / "wing.h5"), "False"]


def test_worst_cells_of_a_report_are_those_of_the_command_quality(tmp_path):
    model = small_model()
    write_report(tmp_path / "r.html", model)
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    worst = report_quality(GridQuality.of_baseline(model.regenerate()), nodes).worst
    rows = [f"{cell.i}, {cell.j}, {cell.k}" for cell in worst]
    places = [text.index(row) for row in dict.fromkeys(rows)]
    assert places == sorted(places)
