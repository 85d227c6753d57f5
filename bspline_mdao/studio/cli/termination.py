"""Signals that end a process, made interrupts from the keyboard: what an interrupt leaves behind, they leave too."""

from __future__ import annotations

import signal
import threading
from types import FrameType

__all__ = ["interrupt_when_terminated"]

SIGNALS = ("SIGTERM", "SIGHUP")
"""What batch systems and ``kill`` send, and a terminal that is closed."""


def interrupt_when_terminated() -> None:
    """Treat `SIGNALS` as an interrupt from now on, but for those that are ignored, as under ``nohup``."""
    if threading.current_thread() is not threading.main_thread():
        return
    for name in SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Do what an interrupt does here; where a shell has it ignored, as in the background, what it does by default."""
    handler = signal.getsignal(signal.SIGINT)
    if not callable(handler):
        raise KeyboardInterrupt
    handler(number, frame)
