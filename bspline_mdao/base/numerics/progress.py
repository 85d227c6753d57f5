"""Progress of long work on a terminal: the current step, the fraction done, and the remaining time.

Work reports its progress to a `progress_bar`, and does not know how it is shown::

    with progress_bar("moving", progress) as report:
        for i in range(n):
            ...
            report((i + 1) / n, f"increment {i + 1} of {n}")

The bar is drawn by rich on standard error, if that is a terminal, in the first process; it appears once the work has
taken a moment, and disappears afterwards. While numba compiles, which it does once on a machine, the bar says so.
Nested work moves the bar of the outer work: there is never more than one. Elsewhere (a file, a notebook, a test,
continuous integration) nothing is drawn; a program may print one line when numba compiles.
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
"""Receives the fraction done, from 0 to 1, or less than 0 if unknown, and the current step."""

SWITCH = "BSPLINE_MDAO_PROGRESS"
"""Environment variable that turns bars and lines off (``0``), or bars on for any terminal (``1``, also if ``CI`` is
set)."""

COMPILING = "compiling, once"
"""Shown while numba compiles kernels, which happens when they are first needed on a machine."""

DELAY = 0.7
"""Seconds after which the bar of work is drawn: short work needs none."""

_active: list[_Bar] = []
"""The current bar, if there is one."""

_say: list[Callable[[str], None]] = []
"""Function that prints one line when numba first compiles without a bar."""


def show_progress(wanted: bool = True) -> None:
    """Turn progress bars on or off, for this process and its children.

    Parameters
    ----------
    wanted : bool
        Whether to show bars on a terminal; elsewhere there are never any.

    Examples
    --------
    >>> from bspline_mdao import show_progress
    >>> show_progress(False)
    """
    os.environ[SWITCH] = "1" if wanted else "0"


@contextmanager
def progress_bar(
    title: str = "",  # the work in a word or two; empty if nested work says it
    # receiver instead of a bar; False for none. By default a bar on a terminal
    progress: Progress | bool | None = None,
) -> Iterator[Progress]:  # takes the fraction done (less than 0 if unknown), and the current step
    """Show the progress of work while it is done.

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
    """Let nested work move the current bar from one fraction to another."""
    if not _active:
        yield
        return
    bar, before = _active[-1], _active[-1].window
    bar.window, bar.what = (start, stop), ""  # the nested work says what is done
    try:
        yield
    finally:
        bar.window = before


def is_terminal() -> bool:
    """Whether a bar can be drawn: on a terminal, by the first process, and not in continuous integration."""
    wanted = os.environ.get(SWITCH, "")
    if wanted == "0" or not getattr(sys.stderr, "isatty", lambda: False)():
        return False
    return (wanted == "1" or not os.environ.get("CI")) and world().rank == 0


def say_compilation(say: Callable[[str], None] | None) -> None:
    """Print one line when numba compiles without a bar; none for ``None``, or if `SWITCH` is off."""
    _say[:] = [] if say is None or os.environ.get(SWITCH) == "0" else [say]


def _say_once(change: int) -> None:
    """Print that numba compiles."""
    if _say:
        _say.pop()(COMPILING)


def no_progress(fraction: float, what: str) -> None:
    """Report to nobody."""


class _Bar:
    """A bar that is drawn once the work has taken a moment."""

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
        """Receiver for nested work, which names its step and moves the bar as far as `within` allows."""
        outer = self.what

        def report(fraction: float, what: str) -> None:
            if self.window is not None and fraction >= 0.0:
                start, stop = self.window
                self.fraction = start + (stop - start) * fraction
            self._draw(f"{outer} | {title}: {what}" if outer else f"{title}: {what}")

        return report

    def compiling(self, change: int) -> None:
        """Say that a kernel is being compiled, including the kernels it calls, until the outermost is ready."""
        self.n_compiling += change
        if self.n_compiling and self.display is None:
            self._open()
        self._draw(self.what)

    def close(self) -> None:
        """Remove the bar."""
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
    """Report compilation meanwhile; numba is imported only now: the commands' help does not need it."""
    from .stopwatch import compilation_noticed

    return compilation_noticed(notice)
