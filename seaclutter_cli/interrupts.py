"""Interrupts and termination requests: each ends the run, whatever Python is doing at that moment."""

import _thread
import signal
import sys
import time
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows has no SIGHUP
_WAIT_FOR = ("importlib", "pydantic", "seaclutter_cli.sinks.atomic")
"""Packages and modules that drop or replace an interrupt that comes within them, or that complete and remove files; all
of them take a short time."""

_MAY_TAKE_LONG = "seaclutter_cli.storage.uploads"
"""Module that runs within one of these, but can be interrupted."""


def handle_interrupts() -> None:
    """Make termination requests and hang-ups a KeyboardInterrupt, as Ctrl-C is, and let none get lost.

    During an import, Python's callbacks and the start-up code of compiled modules drop exceptions, and the program
    imports most of its modules when a command runs. An interrupt therefore waits until the import is done. Further
    interrupts, while the first one unwinds the run and removes incomplete files, are ignored.
    """
    for number in _known():
        if signal.getsignal(number) != signal.SIG_IGN:  # as nohup sets it
            signal.signal(number, _interrupt)
    sys.unraisablehook = _interrupt_again


def ignore_interrupts() -> None:
    """Ignore interrupts from now on: the run has ended, only the process has not."""
    for number in _known():
        if signal.getsignal(number) is _interrupt:
            signal.signal(number, signal.SIG_IGN)


def _known() -> list[signal.Signals]:
    """Return the signals that end a run, as far as this system has them."""
    return [signal.Signals[name] for name in _SIGNALS if name in signal.Signals.__members__]


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _is_unwinding():
        return
    while frame is not None and frame.f_globals.get("__name__") != _MAY_TAKE_LONG:
        if _must_wait(frame.f_globals.get("__name__", "")):
            _interrupt_soon(number)
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _must_wait(module: str) -> bool:
    return any(module == name or module.startswith(f"{name}.") for name in _WAIT_FOR)


def _is_unwinding() -> bool:
    """Return whether an interrupt is being handled: by ``except`` or ``finally`` or at the end of a context."""
    error = sys.exception()
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


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
