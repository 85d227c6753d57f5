"""Progress of long work on a terminal: what is being done, how far it is, and how long it may still take.

Work reports its progress to a `progress_bar`, and knows nothing of who shows it::

    with progress_bar("moving", progress) as report:
        for i in range(n):
            ...
            report((i + 1) / n, f"increment {i + 1} of {n}")

A bar is drawn by rich on standard error, where that is a terminal, in the first process; it comes when the work has
taken a moment, and leaves nothing behind. While numba compiles, which it does once on a machine, it says so. Work
inside other work moves the bar of that one: there is never more than one. Elsewhere (a file, a notebook, a test,
continuous integration) nothing is drawn; a program may have one line say that numba compiles.
"""

from __future__ import annotations

import importlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from .processes import world

__all__ = [
    "COMPILING",
    "SWITCH",
    "Progress",
    "is_terminal",
    "no_progress",
    "progress_bar",
    "say_compilation",
    "show_progress",
    "within",
]

Progress = Callable[[float, str], None]
"""What is told the fraction done, from 0 to 1, or less than 0 where it is not known, and what is being done."""

SWITCH = "BSPLINE_MDAO_PROGRESS"
"""Environment variable that turns bars and lines off (``0``), or bars on wherever there is a terminal (``1``, also
where ``CI`` is)."""

COMPILING = "compiling, once"
"""Shown while numba compiles kernels, which it does when they are first needed on a machine."""

DELAY = 0.7
"""Seconds that work has taken before its bar is drawn: what is done at once needs none."""

_active: list[_Bar] = []
"""The bar that is there, if there is one."""

_say: list[Callable[[str], None]] = []
"""Who prints one line when numba compiles where no bar is, until that has happened."""


def show_progress(wanted: bool = True) -> None:
    """Turn progress bars on or off, for this process and its children.

    Parameters
    ----------
    wanted : bool
        Whether there are bars, on a terminal; elsewhere there are none in any case.

    Examples
    --------
    >>> from bspline_mdao import show_progress
    >>> show_progress(False)
    """
    os.environ[SWITCH] = "1" if wanted else "0"


@contextmanager
def progress_bar(
    title: str = "",  # what the work is, in a word or two; empty where the work inside says it
    # who is told instead of a bar; False for nobody. By default there is a bar where a terminal is
    progress: Progress | bool | None = None,
) -> Iterator[Progress]:  # to be told the fraction done (less than 0 where it is not known), and what is being done
    """Show how far work has come, while it is done.

    Examples
    --------
    >>> reported = []
    >>> with progress_bar("counting", lambda fraction, what: reported.append((fraction, what))) as report:
    ...     report(0.5, "one of two")
    >>> reported
    [(0.5, 'one of two')]
    """
    if callable(progress):
        yield progress
    elif progress is False:
        yield no_progress
    elif _active:
        yield _active[-1].inner(title)
    elif not is_terminal():
        with _noticed_compilation(_say_once) if _say else nullcontext():
            yield no_progress
    else:
        bar = _Bar(title)
        _active.append(bar)
        try:
            with _noticed_compilation(bar.compiling):
                yield bar.move
        finally:
            _active.remove(bar)
            bar.close()


@contextmanager
def within(start: float, stop: float) -> Iterator[None]:
    """Let work inside move the bar that is there from one fraction to another."""
    if not _active:
        yield
        return
    bar, before = _active[-1], _active[-1].window
    bar.window, bar.what = (start, stop), ""  # the work inside says what is done
    try:
        yield
    finally:
        bar.window = before


def is_terminal() -> bool:
    """Tell whether a bar can be drawn: on a terminal, by the first process, and not in continuous integration."""
    wanted = os.environ.get(SWITCH, "")
    if wanted == "0" or not getattr(sys.stderr, "isatty", lambda: False)():
        return False
    return (wanted == "1" or not os.environ.get("CI")) and world().rank == 0


def say_compilation(say: Callable[[str], None] | None) -> None:
    """Have one line say that numba compiles, where no bar can; none for ``None``, or where `SWITCH` is off."""
    _say[:] = [] if say is None or os.environ.get(SWITCH) == "0" else [say]


def _say_once(change: int) -> None:
    """Print that numba compiles."""
    if _say:
        _say.pop()(COMPILING)


def no_progress(fraction: float, what: str) -> None:
    """Tell nobody."""


class _Bar:
    """A bar that is drawn when the work has taken a moment."""

    def __init__(self, title: str):
        self.title, self.what, self.fraction = title, "", -1.0
        self.window: tuple[float, float] | None = None
        self.began, self.n_compiling = time.monotonic(), 0
        self.display: Any = None
        self.task: Any = None

    def move(self, fraction: float, what: str) -> None:
        """Move the bar and say what is being done."""
        self.fraction, self.what = fraction, what
        self._draw(what)

    def inner(self, title: str) -> Progress:
        """What work inside is to tell: it says what it does, and moves the bar as far as `within` allows."""
        outer = self.what

        def report(fraction: float, what: str) -> None:
            if self.window is not None and fraction >= 0.0:
                start, stop = self.window
                self.fraction = start + (stop - start) * fraction
            self._draw(f"{outer} | {title}: {what}" if outer else f"{title}: {what}")

        return report

    def compiling(self, change: int) -> None:
        """Say that a kernel is compiled, one that calls others those in between, until the outermost is ready."""
        self.n_compiling += change
        if self.n_compiling and self.display is None:
            self._open()
        self._draw(self.what)

    def close(self) -> None:
        """Take the bar away."""
        if self.display is not None:
            self.display.stop()

    def _draw(self, what: str) -> None:
        if self.display is None:
            if time.monotonic() - self.began < DELAY:
                return
            self._open()
        text = COMPILING if self.n_compiling else what
        total = 1.0 if self.fraction >= 0.0 else None
        text = f"{self.title}: {text}" if text and self.title else text or self.title
        left = {"left": "left" if total else ""}
        self.display.update(self.task, completed=max(0.0, self.fraction), total=total, description=text, **left)

    def _open(self) -> None:
        """Draw the bar; rich is imported only now."""
        rich, console = importlib.import_module("rich.progress"), importlib.import_module("rich.console")
        text = rich.TextColumn("{task.description}", markup=False)
        done = rich.BarColumn(bar_width=24), rich.TaskProgressColumn(), rich.TimeElapsedColumn()
        left = rich.TextColumn("{task.fields[left]}"), rich.TimeRemainingColumn(compact=True)
        # what is printed goes above the bar, but not if it goes into a file
        how = {"transient": True, "redirect_stdout": getattr(sys.stdout, "isatty", lambda: False)()}
        self.display = rich.Progress(text, *done, *left, console=console.Console(stderr=True), **how)
        self.task = self.display.add_task(self.title, total=None, left="")
        self.display.start()


def _noticed_compilation(notice: Callable[[int], None]) -> AbstractContextManager[None]:
    """Tell of compilation meanwhile; numba is imported only now: the help of commands does without."""
    from .stopwatch import compilation_noticed

    return compilation_noticed(notice)
