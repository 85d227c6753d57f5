"""Signals that end a process, turned into keyboard interrupts, so both leave the same state behind."""

from __future__ import annotations

import signal
import threading
from types import FrameType

__all__ = ["interrupt_when_terminated"]

SIGNALS = ("SIGTERM", "SIGHUP")
"""Signals of batch systems, of ``kill``, and of a terminal that is closed."""


def interrupt_when_terminated() -> None:
    """Treat `SIGNALS` as an interrupt from now on, except for ignored ones, as under ``nohup``."""
    if threading.current_thread() is not threading.main_thread():
        return
    for name in SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Act as an interrupt; if a shell has it ignored, as in the background, act as the signal by default."""
    handler = signal.getsignal(signal.SIGINT)
    if not callable(handler):
        raise KeyboardInterrupt
    handler(number, frame)
