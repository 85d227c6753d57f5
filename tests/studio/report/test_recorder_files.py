"""Damaged and foreign case files: each is refused in one line, or read as SQLite reads it; nothing in them is run."""

import shutil
import sqlite3
import time
import warnings
import zlib
from contextlib import closing

import numpy as np
import openmdao.api as om
import pytest
from fuzz_cases import N_MUTATIONS
from recorder_cases import MUTATIONS, RECORDED, damage, opened, read_plainly, record_ball, stretched_ball

from bspline_mdao import InputError, load_best
from bspline_mdao.core.om.drivers.case_file import count_cases
from bspline_mdao.core.om.drivers.case_history import read_history
from bspline_mdao.studio.cli.main import run

pytestmark = pytest.mark.slow  # a grid is fitted, and an optimisation recorded

N_MUTANTS = max(100, N_MUTATIONS)
SECONDS = 5.0


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A case file beside its model, and a problem that can go on from it."""
    file, model = record_ball(tmp_path_factory.mktemp("ball"))
    return file, stretched_ball(model).setup()


def refusal(act, file):
    """What is said where a file is refused, in one line that names it; empty where it is read."""
    try:
        act()
    except InputError as error:
        words = str(error)
        assert words.startswith(f"{file}: ")
        assert "\n" not in words
        assert len(words) < 400
        return words
    return ""


def check_read(file):
    """Compare what is read with what SQLite and JSON read."""
    history, plain = read_history(file), read_plainly(file)
    assert history.n_evaluations == len(plain)
    for quantity in history.quantities:
        for values, (outputs, *_) in zip(quantity.values, plain):
            np.testing.assert_array_equal(values, np.ravel(outputs[RECORDED[quantity.name]]).astype(float))
    for number, (outputs, is_success, stamp) in enumerate(plain):
        own = [np.ravel(outputs[name]).astype(float) for name in RECORDED.values()]
        assert history.has_run[number] == (
            is_success and np.isfinite(np.hstack(own[:2])).all() and own[2].max() < np.inf
        )
        assert history.seconds[number] == stamp - plain[0][2]
        for name in set(outputs) & set(history.outputs):
            np.testing.assert_array_equal(history.outputs[name][number], outputs[name])


def test_damaged_case_files_are_refused_in_one_line_or_read_as_sqlite_does(recorded, tmp_path):
    (whole, problem), file, n_read = recorded, tmp_path / "cases.sql", 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number in range(N_MUTANTS):
            shutil.copy(whole, file)
            damage(file, number)
            start = time.perf_counter()
            if not refusal(lambda: read_history(file), file):
                check_read(file)
                n_read += 1
                refusal(lambda: load_best(problem, file), file)
                assert np.isfinite(problem.get_val("stretch")).all()
            refusal(lambda: count_cases(file), file)
            assert time.perf_counter() - start < SECONDS
            for left in tmp_path.iterdir():  # no file was made by what a pickle calls
                assert left.name.startswith("cases.sql")
                left.unlink()
    assert N_MUTANTS // 5 < n_read < N_MUTANTS // 2


def test_reports_of_damaged_case_files_end_well_or_in_one_line(recorded, tmp_path, capfd):
    pytest.importorskip("plotly")
    pytest.importorskip("jinja2")
    file, n_written = tmp_path / "cases.sql", 0
    shutil.copy(recorded[0].parent / "ball.h5", tmp_path)
    for number in range(0, N_MUTANTS, 2 * len(MUTATIONS) + 1):
        shutil.copy(recorded[0], file)
        damage(file, number)
        status = run(["report", str(file), "-o", str(tmp_path / "page.html")])
        said = [line for line in capfd.readouterr().err.splitlines() if line.startswith("bspline-mdao: ")]
        assert (status, len(said)) in ((0, 0), (2, 1)), said
        assert "unexpected" not in "".join(said), said
        n_written += status == 0
    assert n_written
    assert not (tmp_path / "mark").exists()


STUDY = """
[grid]
file = "@onera_m6:5x5x5"

[variables.twist]
stations = 2
lower = -3.0
upper = 3.0

[objective]
of = "surface_area"

[constraints.volume]
lower = 0.9
"""


@pytest.mark.parametrize("number", [0, 2, 3, 4, 6, 9, 10])
def test_a_restart_from_a_damaged_case_file_ends_in_one_line(recorded, tmp_path, capfd, monkeypatch, number):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "out").mkdir()
    shutil.copy(recorded[0], tmp_path / "out" / "cases.sql")
    damage(tmp_path / "out" / "cases.sql", number)
    file = tmp_path / "out" / "cases.sql"
    data = file.read_bytes()
    assert run(["optimize", "study.toml", "-o", "out", "--restart"]) == 2
    said = [line for line in capfd.readouterr().err.splitlines() if line.startswith("bspline-mdao: ")]
    assert len(said) == 1
    assert "unexpected" not in said[0]
    assert "cases.sql" in said[0] or "has no recorded case to continue from" in said[0]
    assert file.read_bytes() == data  # also where it can be read, and is of another problem
    assert not (tmp_path / "mark").exists()


@pytest.mark.parametrize("name", ["posix.system", "os.system", "builtins.open", "subprocess.Popen"])
def test_nothing_that_a_pickle_names_is_called(recorded, tmp_path, name):
    module, _, function = name.rpartition(".")
    mark = tmp_path / "mark"
    call = f"touch {mark}" if function == "system" else str(mark)
    arguments = f"V{call}\n" + "Vw\n" * (function == "open")
    stored = zlib.compress(f"c{module}\n{function}\n({arguments}tR.".encode())
    file = tmp_path / "cases.sql"
    shutil.copy(recorded[0], file)
    with opened(file) as connection:
        connection.execute("UPDATE system_metadata SET scaling_factors = ?", (stored,))
        connection.execute("UPDATE solver_metadata SET solver_options = ?", (stored,))
    check_read(file)
    with opened(file) as connection:
        connection.execute("UPDATE system_metadata SET component_metadata = ?", (stored,))
    assert "options of a system are damaged" in refusal(lambda: read_history(file), file)
    assert not mark.exists()


def test_options_are_read_of_what_is_plain_in_their_pickles(recorded, tmp_path):
    history = read_history(recorded[0])
    found = om.CaseReader(recorded[0]).list_model_options(out_stream=None)
    assert history.options.keys() == found.keys()
    assert history.options["ball"].keys() == found["ball"].keys()
    assert history.options["ball"]["axes"] == found["ball"]["axes"] == "xzy"
    assert history.options["ball"]["model_in_records"] == found["ball"]["model_in_records"]


@pytest.mark.parametrize(
    ("statement", "said"),
    [
        ("ALTER TABLE driver_iterations RENAME TO t; CREATE VIEW driver_iterations AS SELECT * FROM t", "has the view"),
        ("CREATE TRIGGER t AFTER INSERT ON metadata BEGIN SELECT 1; END", "has the trigger 't'"),
        ("CREATE TABLE t (a, b AS (a * 2))", "has the table 't'"),
    ],
)
def test_case_files_that_compute_something_are_not_read(recorded, tmp_path, statement, said):
    file = tmp_path / "cases.sql"
    shutil.copy(recorded[0], file)
    with closing(sqlite3.connect(file)) as connection:
        connection.executescript(statement)
    for act in (count_cases, read_history):
        assert said in refusal(lambda act=act: act(file), file)


def test_metadata_that_grow_beyond_their_file_are_refused(recorded, tmp_path):
    file = tmp_path / "cases.sql"
    shutil.copy(recorded[0], file)
    with opened(file) as connection:
        connection.execute("UPDATE metadata SET conns = ?", (zlib.compress(bytes(2**26 + 1)),))
    assert "grow from" in refusal(lambda: read_history(file), file)
