"""Ctrl-C and termination requests: each ends the run, whatever Python is doing at that moment."""

import _thread
import signal
import sys
import time
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_WAIT_FOR = ("importlib", "pydantic")
"""Packages that drop or replace an interrupt that comes within them; their work is short."""


def handle_interrupts() -> None:
    """Make a termination request a KeyboardInterrupt, as Ctrl-C is, and let neither get lost.

    During an import, Python's callbacks and the start-up code of compiled modules drop exceptions, and the program
    imports most of its modules when a command runs. An interrupt therefore waits until the import is done.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _interrupt)
    sys.unraisablehook = _interrupt_again


def _interrupt(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] in _WAIT_FOR:
            _interrupt_soon(number)
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _interrupt_again(lost: "UnraisableHookArgs") -> None:
    """Repeat an interrupt that came within a finalizer or callback, where Python prints and drops exceptions."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        _interrupt_soon(signal.SIGTERM)
    else:
        sys.__unraisablehook__(lost)


def _interrupt_soon(number: int) -> None:
    # Not threading.Thread: the interrupted code may hold its locks.
    _thread.start_new_thread(_interrupt_later, (signal.Signals(number),))


def _interrupt_later(number: signal.Signals) -> None:
    time.sleep(0.01)
    _thread.interrupt_main(number)
