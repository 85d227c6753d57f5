"""Programs of OpenFOAM that fail, in whatever way: one error, which names program, place, reason and the log's end."""

import errno
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from openfoam_stand_ins import stand_in

from bspline_mdao import InputError
from bspline_mdao.errors import SolverError
from bspline_mdao.flow import solver_process
from bspline_mdao.flow.openfoam.case_folder import CaseFolder
from bspline_mdao.flow.openfoam.program import run_program

FATAL = r"""echo 'Time = 1'
printf -- '--> FOAM FATAL ERROR: \nMaximum number of iterations\nexceeded\n\n'
printf -- '    From function T()\n    in file t.C.\n'
echo FOAM exiting
exit 1"""

FAILURES = {
    "an error of OpenFOAM": (FATAL, "Maximum number of iterations exceeded; check the case", "FOAM exiting"),
    "a number that overflows": ("echo 'Time = 7'; kill -FPE $$", "the flow diverged; take a smaller step", "Time = 7"),
    "a core dump of a shell": ("echo 'Time = 7'; exit 136", "the flow diverged; take a smaller step", "Time = 7"),
    "somebody's kill": ("echo 'Time = 7'; kill -KILL $$", "was ended by SIGKILL, by a user or for lack", "Time = 7"),
    "a status": ("echo odd; exit 3", "ended with status 3; check the case", "odd"),
    "a full disk": ("echo 'cat: No space left on device'; exit 1", "the disk is full; free some space", "device"),
}


@pytest.mark.parametrize("name", FAILURES)
def test_a_failure_is_said_with_the_end_of_the_log(name, tmp_path, monkeypatch):
    script, reason, last = FAILURES[name]
    stand_in(tmp_path / "bin", monkeypatch, "simpleFoam", script)
    with pytest.raises(SolverError) as error:
        run_program("simpleFoam", tmp_path)
    first, place, *lines = str(error.value).splitlines()
    assert first.startswith(f"simpleFoam in {tmp_path}: {reason}")
    assert place == f"The end of {tmp_path / 'log.simpleFoam'}:"
    assert lines[-1].endswith(last)


def test_a_program_that_is_missing_is_said_with_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(
        SolverError, match=r"simpleFoam is not on the PATH; install OpenFOAM .*apt-get install openfoam"
    ):
        run_program("simpleFoam", tmp_path)


def test_a_program_that_hangs_ends_at_its_limit_with_all_that_it_began(tmp_path, monkeypatch):
    monkeypatch.setattr(solver_process, "GRACE", 0.1)
    stand_in(tmp_path / "bin", monkeypatch, "simpleFoam", "trap '' TERM; sleep 60 & echo $! > $2/child; echo on; wait")
    start = time.monotonic()
    with pytest.raises(SolverError, match=r"stopped at its time limit of 0.5 s; give it more time.*\n.*\n +on"):
        run_program("simpleFoam", tmp_path, time_limit=0.5)
    assert time.monotonic() - start < 5.0
    child = int((tmp_path / "child").read_text())
    assert _ends(child)


def _ends(process):
    """Whether a process is gone or a zombie within a second."""
    for _ in range(100):
        try:
            state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
        except FileNotFoundError:
            return True
        if state == "Z":
            return True
        time.sleep(0.01)
    return False


def test_the_log_can_be_followed_while_a_program_runs_and_is_what_comes_back(tmp_path, monkeypatch):
    script = "echo first; sleep 0.1; cp $2/log.simpleFoam $2/seen; echo second >&2"
    stand_in(tmp_path / "bin", monkeypatch, "simpleFoam", script)
    assert run_program("simpleFoam", tmp_path) == "first\nsecond\n"
    assert (tmp_path / "seen").read_text() == "first\n"


def test_a_disk_that_is_full_before_the_program_starts_is_said(tmp_path, monkeypatch):
    stand_in(tmp_path / "bin", monkeypatch, "simpleFoam", "exit 0")

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "log")

    monkeypatch.setattr(subprocess, "Popen", full)
    with pytest.raises(SolverError, match=r"simpleFoam in .*: No space left on device \(log\); free some space"):
        run_program("simpleFoam", tmp_path)


def test_a_case_of_somebody_else_is_refused_and_left_as_it_is(tmp_path):
    theirs = tmp_path / "100" / "p"
    theirs.parent.mkdir()
    theirs.write_text("their pressure")
    refused = pytest.raises(InputError, match="has files of other programs, such as 100; name a new or empty folder")
    with refused, CaseFolder(tmp_path).locked():
        pass
    assert [path.name for path in tmp_path.rglob("*")] == ["100", "p"]


def test_a_second_run_in_a_folder_is_refused_and_one_after_it_is_not(tmp_path):
    first, second = CaseFolder(tmp_path / "case"), CaseFolder(tmp_path / "case")
    refused = pytest.raises(InputError, match="case: another run is at work in it; wait for its end")
    with first.locked(), refused, second.locked():
        pass
    with second.locked():
        pass


def test_a_folder_stays_locked_while_the_program_of_a_run_that_was_killed_goes_on(tmp_path, monkeypatch):
    stand_in(tmp_path / "bin", monkeypatch, "simpleFoam", "echo $$ > $2/solver; exec sleep 30")
    begin = (
        "import os, sys, threading, time; from pathlib import Path\n"
        "from bspline_mdao.flow.openfoam.case_folder import CaseFolder\n"
        "case = CaseFolder(sys.argv[1])\n"
        "def leave():\n"
        "    while not (case.path / 'solver').is_file(): time.sleep(0.01)\n"
        "    os._exit(9)\n"
        "threading.Thread(target=leave, daemon=True).start()\n"
        "with case.locked(): case.solve('simpleFoam')\n"
    )
    case = CaseFolder(tmp_path / "case")
    assert subprocess.run([sys.executable, "-c", begin, case.path], check=False).returncode == 9
    solver = int((case.path / "solver").read_text())
    with pytest.raises(InputError, match="another run is at work"), case.locked():
        pass
    os.kill(solver, 9)
    assert _ends(solver)
    with case.locked():
        pass


def fields(folder, name, value):
    """Write a field with values in cells and a boundary."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(
        f"dimensions [0 0 0 0 0 0 0];\ninternalField {value};\nboundaryField {{ {folder.name} }}\n"
    )


def test_a_run_starts_from_the_cells_of_the_last_solution_with_its_own_boundary_conditions(tmp_path):
    case = CaseFolder(tmp_path)
    last = {"p": "nonuniform List<scalar> \n3\n(\n1\n2\n3\n)\n", "U": "nonuniform List<vector> 1((1 2 3))"}
    for name, value in last.items():
        fields(tmp_path / "40", name, value)
        fields(tmp_path / "0", name, "uniform 0")
    fields(tmp_path / "9", "p", "uniform 9")
    assert not case.start_from_solution("case A")
    case.keep_solution("case A")
    case.remove_times()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0", "solution"]
    assert not case.start_from_solution("case B")
    assert case.start_from_solution("case A")
    for name, value in last.items():
        text = (tmp_path / "0" / name).read_text()
        assert re.search(rf"internalField {re.escape(value)};\nboundaryField {{ 0 }}", text)


def test_what_wrote_no_fields_is_said(tmp_path):
    with pytest.raises(SolverError, match="no fields were written; check the logs"):
        CaseFolder(tmp_path).keep_solution("case A")
