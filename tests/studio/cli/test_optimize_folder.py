"""What ``optimize`` does to the folder of its results: no file of the user's is lost, and no run that has cases."""

import json
import os
import runpy
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from itertools import count
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest
from test_optimize import LEAST_AREA, RESULTS, names_in, summary

import bspline_mdao
from bspline_mdao import InputError, ScipyDriver, fit_grid, write_grid
from bspline_mdao.base.numerics.progress import SWITCH
from bspline_mdao.core.om.drivers import nlopt_driver
from bspline_mdao.core.om.drivers.case_file import count_cases
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.io import run_folder
from bspline_mdao.grids.io.run_folder import MANIFEST, PREFIX, RunFolder
from bspline_mdao.studio.cli.main import run

pytestmark = pytest.mark.slow
SHORT = ("--max-iterations", "2")
AREA = LEAST_AREA.format(grid="@onera_m6:7x9x7", more="n_control = [5, 5, 5]")


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("area.toml").write_text(AREA)
    return tmp_path


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Results of a short run."""
    folder = tmp_path_factory.mktemp("finished")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("area.toml").write_text(AREA)
        assert run(["optimize", "area.toml", "-o", "out", *SHORT]) == 0
    return folder / "out"


@pytest.fixture
def done(finished, workplace):
    """A workplace where a short run has come to its end."""
    shutil.copytree(finished, "out")
    return workplace


def study(name, old, new, source="area.toml"):
    """A study that differs from another one."""
    text = Path(source).read_text()
    assert old in text
    Path(name).write_text(text.replace(old, new))
    return name


def contents(folder="."):
    """Bytes of all files in a folder."""
    return {str(path): path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}


def fails(capsys, *arguments, status=2):
    """The one line that a command says where it fails."""
    assert run(["optimize", *arguments]) == status
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line.removeprefix("bspline-mdao: ")


# Inputs and files of the user


def test_a_model_that_the_study_names_is_no_place_for_results(workplace, capsys):
    fit_grid(onera_m6_grid((7, 9, 7)), n_control=(5, 5, 5)).save("model.h5")
    write_grid("grid_before.xyz", onera_m6_grid((7, 9, 7)))
    Path("model.toml").write_text(LEAST_AREA.format(grid="model.h5", more=""))
    Path("grid.toml").write_text(LEAST_AREA.format(grid="grid_before.xyz", more='patches = "summary.csv"'))
    Path("summary.csv").write_text("patches")
    before = contents()
    for name, taken in (("model.toml", "model.h5"), ("grid.toml", "grid_before.xyz")):
        for folder in (".", "../" + workplace.name):
            words = fails(capsys, name, "-o", folder, "--overwrite")
            assert words.endswith(f"{taken}: is read by this command; choose another name or folder")
    assert contents() == before
    os.rename("grid_before.xyz", "wing.xyz")
    assert "summary.csv: is read by" in fails(capsys, study("p.toml", "grid_before", "wing", "grid.toml"), "-o", ".")


def test_files_of_the_user_are_neither_replaced_nor_removed(workplace, capsys):
    mine = {name: f"mine: {name}" for name in ("optimize.py", "report.html", "grid_after.cgns", "notes.txt")}
    for name, text in mine.items():
        Path(name).write_text(text)
    words = fails(capsys, "area.toml", "-o", ".", "--overwrite")
    assert words.startswith(".: optimize.py would be replaced, and no run wrote it")
    assert names_in(".") == {*mine, "area.toml"}
    Path("optimize.py").unlink()
    assert run(["optimize", "area.toml", "-o", ".", "--overwrite", *SHORT]) == 0
    assert names_in(".") == {*mine, "area.toml", *RESULTS}
    assert all(Path(name).read_text() == text for name, text in mine.items() if name != "optimize.py")


def test_a_result_that_was_changed_is_the_user_s(done, capsys):
    with open("out/optimize.py", "a") as file:
        file.write("print('on from here')\n")
    capsys.readouterr()
    before = contents()
    assert fails(capsys, "area.toml", "-o", "out", "--overwrite").startswith("out: optimize.py would be replaced")
    assert contents() == before


def test_a_run_replaces_what_the_last_one_wrote_and_what_it_does_not_write_goes(workplace, capsys):
    assert (
        run(["optimize", study("vtm.toml", "report = false", 'report = false\ngrid = "vtm"'), "-o", "out", *SHORT]) == 0
    )
    assert {"grid_after.vtm", "grid_after"} <= names_in("out")
    assert run(["optimize", "vtm.toml", "-o", "out", "--overwrite", *SHORT]) == 0
    Path("out/grid_after/mine.vts").write_text("mine")
    assert run(["optimize", "area.toml", "-o", "out", "--overwrite", *SHORT]) == 0
    assert names_in("out") == {*RESULTS, "grid_after"}
    assert names_in("out/grid_after") == {"mine.vts"}
    capsys.readouterr()
    assert "out: grid_after/mine.vts would be replaced" in fails(capsys, "vtm.toml", "-o", "out", "--overwrite")


def test_a_study_that_fails_at_its_start_leaves_the_old_results(done, capsys, monkeypatch):
    write_grid("wing.xyz", onera_m6_grid((7, 9, 7)))
    Path("wing.xyz").write_bytes(Path("wing.xyz").read_bytes()[:999])
    broken = study("broken.toml", "@onera_m6:7x9x7", "wing.xyz")
    capsys.readouterr()
    before = contents()
    words = fails(capsys, broken, "-o", "out", "--overwrite")
    assert words.startswith("wing.xyz: ")
    assert contents() == before
    assert fails(capsys, broken, "-o", "new/folder").startswith("wing.xyz: ")
    assert not Path("new").exists()
    monkeypatch.setattr(om.Problem, "run_model", interrupted)
    assert fails(capsys, "area.toml", "-o", "out", "--overwrite", status=130) == "interrupted; out is as it was"
    assert contents() == before


def interrupted(*arguments):
    raise KeyboardInterrupt


def test_a_run_that_fails_later_keeps_what_there_is(done, capsys, monkeypatch):
    monkeypatch.setattr(nlopt_driver, "minimise", failing)
    capsys.readouterr()
    words = fails(capsys, "area.toml", "-o", "out", "--overwrite")
    assert words == "'flow.state': no flow; out keeps cases.sql, grid_before.xyz, model.h5, optimize.py"
    assert names_in("out") == RESULTS - {"grid_after.xyz", "summary.csv"}
    monkeypatch.undo()
    monkeypatch.chdir(done)
    assert run(["optimize", "area.toml", "-o", "out", "--restart", *SHORT]) == 0


def failing(settings, functions):
    raise om.AnalysisError("'flow.state' <class TrimmedState>: no flow")


def test_a_swap_that_is_cut_short_is_no_harm(done, monkeypatch):
    """The first file alone is put in its place, and the process is killed there."""
    begin = RunFolder.begin

    def remembered(folder, about):
        monkeypatch.setattr(RunFolder, "last", folder, raising=False)
        return begin(folder, about)

    def killed(new, path):
        file = min(new.iterdir())
        os.replace(file, Path(path) / file.name)
        os.close(RunFolder.last._lock)  # as the system does
        raise SystemExit(9)

    for flag in ("--overwrite", "--restart"):
        with monkeypatch.context() as patch:
            patch.setattr(RunFolder, "begin", remembered)
            patch.setattr(run_folder, "put_files", killed)
            with pytest.raises(SystemExit):
                run(["optimize", "area.toml", "-o", "out", "--overwrite", "--max-iterations", "4"])
        assert len(list(Path("out").glob(f"{PREFIX}*"))) == 1
        assert run(["optimize", "area.toml", "-o", "out", flag, *SHORT]) == 0
        assert names_in("out") == RESULTS
    assert count_cases("out/cases.sql") > 4


# Runs that go on


LONG = """
[driver]
optimizer = "GN_ISRES"
tolerance = 1e-14
max_iterations = 100000
options = { disp = false }
"""


def start(*arguments, **settings):
    """Start the real program, where signals arrive as they do by default."""
    command = [sys.executable, "-m", "bspline_mdao", "optimize", *arguments]
    return subprocess.Popen(command, **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **settings})


def wait_for_cases(n, folder="out", seconds=200.0):
    """Wait until a run at work in a folder has recorded some cases."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if any(count_of(file) >= n for file in Path(folder).glob(f"{PREFIX}*/results/cases.sql")):
            return
        time.sleep(0.05)
    raise TimeoutError(f"no {n} cases in {seconds} s")


def count_of(file):
    try:
        with closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True)) as connection:
            return connection.execute("SELECT count(*) FROM driver_iterations").fetchone()[0]
    except sqlite3.Error:
        return 0


def best_of(file, n_last=0):
    """Least recorded area of the designs that keep the volume, but for some that were recorded last."""
    reader = om.CaseReader(str(file))
    names = reader.list_cases("driver", out_stream=None)
    cases = [reader.get_case(name) for name in names[: len(names) - n_last]]
    values = [(case["surface_area"].item(), case["volume"].item()) for case in cases]
    return min(area for area, volume in values if volume > 1.0 - 1e-6)


@pytest.fixture
def signals_arrive():
    """Signals as a program gets them by default: a shell ignores some in what it runs in the background."""
    before = {number: signal.signal(number, lambda *_: None) for number in (signal.SIGINT, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def ended(number):
    """Standard error and exit status of a run that was ended by a signal after ten cases."""
    Path("long.toml").write_text(AREA + LONG)
    program = start("long.toml", "-o", "out")
    wait_for_cases(10)
    program.send_signal(number)
    _, error = program.communicate(timeout=200)
    return error, program.returncode


@pytest.fixture(scope="module")
def killed_once(tmp_path_factory):
    """Folder of a run that was killed, its standard error and its exit status."""
    folder = tmp_path_factory.mktemp("killed")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return folder, *ended(signal.SIGKILL)


@pytest.fixture
def killed(killed_once, workplace):
    """A workplace where a run was killed: its standard error and its exit status."""
    folder, *said = killed_once
    shutil.copytree(folder, ".", dirs_exist_ok=True)
    return tuple(said)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])  # SIGHUP, handled alike: see `test_interrupts`
def test_signals_end_a_run_like_an_interrupt_with_its_best_design(workplace, signals_arrive, number):
    error, status = ended(number)
    assert status == 130
    (line,) = error.strip().splitlines()
    assert line.startswith("bspline-mdao: interrupted after ")
    assert names_in("out") == RESULTS
    # a signal between a design's record and what the driver notes of it leaves that design out, and the run at the best
    # one, which sets the model back to it, is recorded after it
    found = [best_of("out/cases.sql", n_last) for n_last in (0, 1, 2)]
    assert float(summary("out")["surface_area"]["after"]) in [pytest.approx(each, rel=1e-12) for each in found]
    n = count_cases("out/cases.sql")
    assert run(["optimize", "long.toml", "-o", "out", "--restart", "--max-iterations", "5"]) == 0
    assert count_cases("out/cases.sql") > n
    assert float(summary("out")["surface_area"]["after"]) <= best_of("out/cases.sql") * (1 + 1e-12)


def test_a_run_that_was_killed_goes_on_from_its_best_design(killed, capsys):
    assert killed == ("", -signal.SIGKILL)
    (private,) = Path("out").glob(f"{PREFIX}*")
    n, best = count_cases(private / "results/cases.sql"), best_of(private / "results/cases.sql")
    words = f"out: is not empty; give --restart to continue from the best of {n} recorded designs, --overwrite, or"
    assert fails(capsys, "long.toml", "-o", "out").startswith(words)
    assert run(["optimize", "area.toml", "-o", "out", "--restart", "--json", "out.json"]) == 0
    assert f"optimize.py from the best of {n} recorded designs" in " ".join(capsys.readouterr().out.split())
    assert names_in("out") == RESULTS
    reader = om.CaseReader("out/cases.sql")
    names = reader.list_cases("driver", out_stream=None)
    assert reader.get_case(names[n])["surface_area"].item() == pytest.approx(best, rel=1e-12)
    found = summary("out")
    assert float(found["chord[1]"]["before"]) == 1.0  # the table tells of the baseline still
    assert float(found["surface_area"]["after"]) == pytest.approx(0.928707, abs=1e-5)


def test_a_run_that_went_on_and_was_killed_goes_on_again(killed):
    n = max(count_cases(file) for file in Path("out").glob(f"{PREFIX}*/results/cases.sql"))
    program = start("long.toml", "-o", "out", "--restart")
    wait_for_cases(n + 5)
    program.kill()
    program.communicate()
    assert len(list(Path("out").glob(f"{PREFIX}*"))) == 2
    assert run(["optimize", "area.toml", "-o", "out", "--restart"]) == 0
    assert names_in("out") == RESULTS
    assert count_cases("out/cases.sql") > n + 5


def test_an_interrupted_run_of_scipy_gives_its_best_design_too(workplace, capsys, monkeypatch):
    evaluate, n = ScipyDriver._objfunc, count()

    def interrupted_once(driver, x):
        if next(n) == 5:
            raise KeyboardInterrupt
        return evaluate(driver, x)

    monkeypatch.setattr(ScipyDriver, "_objfunc", interrupted_once)
    scipy = study("scipy.toml", "[output]", '[driver]\noptimizer = "SLSQP"\n[output]')
    assert fails(capsys, scipy, "-o", "out", status=130).startswith("interrupted after 7 evaluations")
    assert names_in("out") == RESULTS
    assert float(summary("out")["surface_area"]["after"]) == pytest.approx(best_of("out/cases.sql"), rel=1e-12)
    assert run(["optimize", scipy, "-o", "out", "--restart"]) == 0
    assert float(summary("out")["surface_area"]["after"]) == pytest.approx(0.928707, abs=1e-5)


def test_two_runs_do_not_work_in_one_folder(workplace, capsys):
    folder = RunFolder("out")
    folder.begin({})
    assert "out: another run is at work in it" in fails(capsys, "area.toml", "-o", "out", "--overwrite")
    folder.discard()
    assert not Path("out").exists()


def test_what_cannot_go_on_says_why_in_one_line(finished, workplace, capsys):
    words = "out: has no recorded case to continue from; leave out --restart to begin"
    assert fails(capsys, "area.toml", "-o", "out", "--restart") == words
    assert not Path("out").exists()
    assert fails(capsys, "area.toml", "-o", "out", "--restart", "--overwrite").startswith("--overwrite starts again")
    shutil.copytree(finished, "out")
    before = contents("out")
    changes = {
        "[variables.chord] stations is 4, and was 3": ("stations = 3", "stations = 4"),
        "[variables.twist] is new, and was not": (
            "[objective]",
            "[variables.twist]\nlower = -1\nupper = 1\n[objective]",
        ),
        "[grid] n_control is [6, 5, 5], and was [5, 5, 5]": ("[5, 5, 5]", "[6, 5, 5]"),
        '[objective] of is "surface_area * volume", and was "surface_area"': (
            '"surface_area"',
            '"surface_area * volume"',
        ),
        "[constraints.corner_ks] is left out, and was": ("[constraints.corner_ks]\nlower = 0.05\n", ""),
        "[measures.planform_area] is new, and was not": ("[constraints.corner_ks]", "[constraints.planform_area]"),
    }
    for words, (old, new) in changes.items():
        said = fails(capsys, study("changed.toml", old, new), "-o", "out", "--restart")
        assert said.startswith(f"changed.toml: {words} in the run whose cases are in out; undo that")
    assert contents("out") == before
    bounds = study("bounds.toml", "upper = 1.4", "upper = 1.3\nref = 0.2")  # bounds may change
    assert run(["optimize", bounds, "-o", "out", "--restart", *SHORT]) == 0
    assert float(summary("out")["chord[1]"]["after"]) <= 1.3


def test_a_grid_that_has_changed_is_another_problem(workplace, capsys):
    for shape in ((7, 9, 7), (9, 9, 7)):
        write_grid("wing.xyz", onera_m6_grid(shape))
        if shape[0] == 7:
            assert run(["inspect", "wing.xyz", "--draft", "wing.toml"]) == 0
            Path("w.toml").write_text(LEAST_AREA.format(grid="wing.xyz", more='patches = "wing.toml"'))
            assert run(["optimize", "w.toml", "-o", "out", *SHORT]) == 0
    capsys.readouterr()
    assert "w.toml: [grid] file is not the same as in the run" in fails(capsys, "w.toml", "-o", "out", "--restart")


def test_cases_of_the_script_that_was_run_by_itself_go_on_and_are_not_dropped(done, capsys):
    runpy.run_path("out/optimize.py", run_name="__main__")  # `test_optimize` runs one in a process of its own
    Path("new").mkdir()
    os.rename("out/cases.sql", "new/cases.sql")
    n = count_cases("new/cases.sql")
    capsys.readouterr()
    assert fails(capsys, "area.toml", "-o", "new", "--overwrite").startswith("new: cases.sql would be replaced")
    assert run(["optimize", "area.toml", "-o", "new", "--restart", *SHORT]) == 0
    assert count_cases("new/cases.sql") > n


def test_damaged_cases_are_named_and_nothing_is_touched(done, capsys):
    capsys.readouterr()
    random, data = np.random.default_rng(2), Path("out/cases.sql").read_bytes()
    for damaged in (b"no database" * 99, data[: len(data) // 2], data[:5000] + random.bytes(90000) + data[95000:]):
        Path("out/cases.sql").write_bytes(damaged)
        before = contents("out")
        words = fails(capsys, "area.toml", "-o", "out", "--restart")
        assert words.startswith("out/cases.sql: ")
        assert contents("out") == before
    Path("out/cases.sql").write_bytes(data)
    (Path("out") / MANIFEST).write_text("no list")  # then nothing is known to be of a run
    assert "would be replaced" in fails(capsys, "area.toml", "-o", "out", "--restart")


# Where nothing can be written


@pytest.mark.filterwarnings("default::openmdao.utils.om_warnings.CaseRecorderWarning")
def test_a_full_disk_is_one_line_and_the_best_design_is_kept(workplace, capsys, monkeypatch):
    minimise = nlopt_driver.minimise

    def filled(settings, functions):
        (recorder,) = functions.model._driver._rec_mgr
        (n,) = recorder.connection.execute("PRAGMA page_count").fetchone()
        recorder.connection.execute(f"PRAGMA max_page_count = {n}")
        return minimise(settings, functions)

    monkeypatch.setattr(nlopt_driver, "minimise", filled)
    Path("many.toml").write_text(Path("area.toml").read_text() + LONG.replace("GN_ISRES", "LN_COBYLA"))
    assert run(["optimize", "many.toml", "-o", "out", "--json", "out.json"]) == 0
    shown = capsys.readouterr()
    words = "cases cannot be recorded (database or disk is full); the run continues, and tries again"
    assert shown.err == f"warning: out/cases.sql: {words}\n"
    assert float(summary("out")["surface_area"]["after"]) == pytest.approx(0.928707, abs=1e-5)
    assert 0 < count_cases("out/cases.sql") < json.loads(Path("out.json").read_text())["evaluations"]


def test_a_result_that_cannot_be_written_is_one_line_and_the_run_can_go_on(workplace, capsys, monkeypatch):
    def full(path, *arguments):
        if "after" in str(path):
            raise InputError(f"{path}: cannot be written (No space left on device); choose another place")
        write_grid(path, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(bspline_mdao, "write_grid", full)
        words = fails(capsys, "area.toml", "-o", "out")
    assert words.startswith(
        "out/grid_after.xyz: cannot be written (No space left on device); choose another place; out"
    )
    assert words.endswith("keeps cases.sql, grid_before.xyz, model.h5, optimize.py")
    assert run(["optimize", "area.toml", "-o", "out", "--restart"]) == 0
    assert float(summary("out")["surface_area"]["after"]) == pytest.approx(0.928707, abs=1e-5)


@pytest.mark.parametrize(
    ("output", "words"), [("", "was closed"), ("/dev/full", "cannot be written (No space left on device)")]
)
def test_a_run_goes_on_where_nothing_can_be_printed(workplace, output, words):
    place = os.open(output, os.O_WRONLY) if output else subprocess.PIPE
    program = start("area.toml", "-o", "out", stdout=place, env={**os.environ, "PYTHONUNBUFFERED": "1", SWITCH: "0"})
    if output:
        os.close(place)
    else:
        program.stdout.close()
    assert program.stderr.read() == f"standard output {words}; the run continues, and writes its results\n"
    assert program.wait(timeout=200) == 0
    assert names_in("out") == RESULTS
    assert float(summary("out")["surface_area"]["after"]) == pytest.approx(0.928707, abs=1e-5)


def test_several_processes_need_petsc(workplace, capsys, monkeypatch):
    class Two:
        rank, size = 0, 2

    monkeypatch.setattr("bspline_mdao.studio.cli.optimize.world", Two)
    monkeypatch.setitem(sys.modules, "petsc4py", None)
    words = 'a study on several processes needs petsc4py: pip install "bspline_mdao[mpi]"'
    assert fails(capsys, "area.toml", "-o", "out").startswith(words)
    assert not Path("out").exists()
