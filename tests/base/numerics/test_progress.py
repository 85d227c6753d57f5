"""Long work shows its progress on a terminal, and nowhere else."""

import os
import pty
import select
import subprocess
import sys
import time

import numpy as np
import pytest
from numba import njit

from bspline_mdao.base.numerics import progress
from bspline_mdao.base.numerics.progress import (
    SWITCH,
    is_terminal,
    progress_bar,
    say_compilation,
    show_progress,
    within,
)
from bspline_mdao.base.numerics.stopwatch import working_seconds

FIT = """
from bspline_mdao import fit_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.base.numerics import progress
progress.DELAY = 0.0
from bspline_mdao.movers import LinearElasticity
model = fit_grid(onera_m6_grid((7, 6, 5)))
mesh = moving_mesh(model)
surface = model.control_points[mesh.surface_ids] + [0.0, 0.01, 0.0]
LinearElasticity(mesh, n_increments=3).move(model.control_points, surface)
print("done")
"""


def on_terminal(code: str) -> str:
    """What a program writes to a terminal that is its standard error."""
    ours, theirs = pty.openpty()
    kept = {name: value for name, value in os.environ.items() if name not in ("CI", SWITCH)}
    kept |= {"TERM": "xterm", "COLUMNS": "120"}
    running = subprocess.Popen([sys.executable, "-c", code], stderr=theirs, stdout=subprocess.PIPE, env=kept)
    os.close(theirs)
    text, end = b"", time.monotonic() + 120.0
    while time.monotonic() < end:
        if select.select([ours], [], [], 0.2)[0]:
            try:
                text += os.read(ours, 65536)
            except OSError:  # closed: the program has ended
                break
        elif running.poll() is not None:
            break
    assert running.wait(10) == 0
    assert running.stdout.read() == b"done\n"  # what is printed into a file stays in it
    running.stdout.close()
    os.close(ours)
    return text.decode()


@pytest.fixture
def as_terminal(monkeypatch):
    """A place where bars would be drawn, on something that keeps what they are told."""
    drawn = []
    monkeypatch.setattr(progress, "is_terminal", lambda: True)
    monkeypatch.setattr(progress._Bar, "_draw", lambda bar, what: drawn.append((round(bar.fraction, 6), what)))
    return drawn


@pytest.mark.slow
def test_a_fit_and_a_move_show_a_bar_on_a_terminal_and_leave_nothing_behind():
    text = on_terminal(FIT)
    assert "fitting" in text
    assert "moving the control mesh: increment 3 of 3" in text
    assert text.rstrip().endswith("\x1b[2K")  # the last line is wiped out


@pytest.mark.parametrize("environment", [{SWITCH: "0"}, {"CI": "true"}])
def test_bars_are_off_where_they_are_not_wanted(environment, monkeypatch):
    for name in ("CI", SWITCH):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert is_terminal()
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert not is_terminal()
    with progress_bar("work") as tell:
        assert tell is progress.no_progress


@pytest.mark.slow
def test_without_a_terminal_nothing_is_drawn_or_imported():
    code = "import sys\n" + FIT + "assert 'rich.progress' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("done\n", "")


def test_work_inside_other_work_moves_its_bar_as_far_as_it_may(as_terminal):
    with progress_bar("outer") as tell:
        tell(0.25, "first")
        with progress_bar("inner") as tell_inner:
            tell_inner(0.5, "half")
        with within(0.4, 0.8), progress_bar("inner") as tell_inner:
            tell_inner(0.5, "half")
        tell(1.0, "last")
    assert as_terminal == [
        (0.25, "first"),
        (0.25, "first | inner: half"),
        (0.6, "inner: half"),
        (1.0, "last"),
    ]
    assert not progress._active


def test_a_bar_goes_away_with_an_error(as_terminal):
    with pytest.raises(ZeroDivisionError), progress_bar("work"):
        raise ZeroDivisionError
    assert not progress._active


def test_false_is_for_nobody_and_a_function_is_told(as_terminal):
    told = []
    with progress_bar("work", False) as tell:
        tell(0.5, "half")
    with progress_bar("work", lambda *what: told.append(what)) as tell:
        tell(0.5, "half")
    assert (as_terminal, told) == ([], [(0.5, "half")])


def test_compilation_is_named_while_it_lasts(monkeypatch):
    names = []
    monkeypatch.setattr(progress, "is_terminal", lambda: True)
    monkeypatch.setattr(progress._Bar, "_open", lambda bar: setattr(bar, "display", _Display(names)))
    with progress_bar("work") as tell:
        tell(0.5, "half")
        assert njit(lambda x: x + 1)(2) == 3
    assert any(progress.COMPILING in name for name in names)
    assert names[-1] == "work: half"


def test_compilation_is_named_in_one_line_where_no_bar_is_if_a_program_asks_for_that(monkeypatch):
    monkeypatch.setattr(progress, "is_terminal", lambda: False)
    for name, expected in (("asked", [progress.COMPILING]), ("not asked", []), ("off", [])):
        said = []
        monkeypatch.setenv(SWITCH, "0" if name == "off" else "")
        say_compilation(None if name == "not asked" else said.append)
        with progress_bar("work"), progress_bar("inside"):
            assert njit(lambda x: x + 1)(2) == 3
            assert njit(lambda x: x + 2)(2) == 4
        assert said == expected, name


def test_the_clock_of_work_leaves_compilation_out():
    began, work_began = time.perf_counter(), working_seconds()
    assert njit(lambda x: np.linalg.norm(x) + np.sort(x)[0])(np.arange(3.0)) > 2.0
    time.sleep(0.05)
    took, worked = time.perf_counter() - began, working_seconds() - work_began
    assert 0.05 <= worked < 0.5 * took


class _Display:
    """Keeps what a bar says."""

    def __init__(self, names):
        self.names = names

    def update(self, task, description, **how):
        self.names.append(description)

    def stop(self):
        """Nothing to do."""


def test_one_call_turns_bars_off(monkeypatch):
    monkeypatch.setenv(SWITCH, "1")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert is_terminal()
    show_progress(False)
    assert not is_terminal()
    show_progress()
    assert is_terminal()
