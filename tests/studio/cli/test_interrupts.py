"""An interrupt from the keyboard ends what runs, wherever it arrives."""

import os
import signal
import threading
import time
import weakref

import h5py
import pytest
from component_cases import two_blocks

from bspline_mdao import FittedModel, fit_grid, read_grid, write_grid
from bspline_mdao.base.numerics.threads import run_tasks
from bspline_mdao.grids.io.disk import deferred_interrupts
from bspline_mdao.studio.cli.termination import interrupt_when_terminated

pytestmark = pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture(autouse=True)
def interrupts_arrive():
    """Interrupts as Python has them by default: a shell ignores them in what it runs in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class Dying:
    """Something whose end is noticed, as that of h5py's objects."""


def interrupted_at_once(function):
    """A function after which an interrupt arrives where h5py lets one arrive: in the callback of a weak reference."""

    def call(*arguments, **settings):
        value, dying = function(*arguments, **settings), Dying()
        reference = weakref.ref(dying, lambda _: signal.raise_signal(signal.SIGINT))
        del dying
        assert reference() is None
        return value

    return call


def save(folder):
    fit_grid(two_blocks()).save(folder / "model.h5")


def load(folder):
    save(folder)
    return lambda: FittedModel.load(folder / "model.h5")


def write_cgns(folder):
    return lambda: write_grid(folder / "grid.cgns", two_blocks())


def read_cgns(folder):
    write_cgns(folder)()
    return lambda: read_grid(folder / "grid.cgns")


CASES = {
    "save": (lambda folder: lambda: save(folder), h5py.Group, "create_dataset"),
    "close": (lambda folder: lambda: save(folder), h5py.File, "close"),
    "load": (load, h5py.Dataset, "__getitem__"),
    "write CGNS": (write_cgns, h5py.Group, "create_dataset"),
    "read CGNS": (read_cgns, h5py.Group, "__getitem__"),
}


@pytest.mark.parametrize("case", CASES)
def test_no_interrupt_is_lost_in_hdf5(tmp_path, monkeypatch, case):
    prepare, kind, name = CASES[case]
    run = prepare(tmp_path)
    before = sorted(os.listdir(tmp_path))
    monkeypatch.setattr(kind, name, interrupted_at_once(getattr(kind, name)))
    with pytest.raises(KeyboardInterrupt):
        run()
    assert sorted(os.listdir(tmp_path)) == before
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_threads_other_than_the_main_one_hold_nothing():
    seen = []

    def work():
        with deferred_interrupts():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]


def test_other_threads_stop_when_the_first_is_interrupted():
    main, done = threading.main_thread(), []

    def task(number):
        if threading.current_thread() is main:
            raise KeyboardInterrupt
        time.sleep(0.001)
        done.append(number)

    with pytest.raises(KeyboardInterrupt):
        run_tasks(task, range(100_000), 3)
    assert len(done) < 1000


@pytest.fixture
def terminations():
    """Signals that end a process, as they are by default, until the test is over."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in (signal.SIGTERM, signal.SIGHUP)}
    yield list(before)
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("handler", [signal.default_int_handler, signal.SIG_IGN])
def test_a_signal_that_ends_a_process_is_an_interrupt_also_where_those_are_ignored(terminations, handler):
    interrupt_when_terminated()
    signal.signal(signal.SIGINT, handler)
    for number in terminations:
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)


def test_a_termination_waits_where_an_interrupt_would_be_lost(terminations):
    reached = []

    def work():
        with deferred_interrupts():
            signal.raise_signal(signal.SIGTERM)
            reached.append(True)

    interrupt_when_terminated()
    with pytest.raises(KeyboardInterrupt):
        work()
    assert reached


def test_signals_that_are_ignored_stay_ignored(terminations):
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as under nohup
    interrupt_when_terminated()
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    signal.raise_signal(signal.SIGHUP)
