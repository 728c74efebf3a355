"""Interrupts and termination requests: each ends the run, whatever Python is doing at that moment."""

import _thread
import signal
import sys
import time
import weakref
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_SIGNALS = [one for one in signal.Signals if one.name in ("SIGINT", "SIGTERM", "SIGHUP")]  # Windows has no SIGHUP
_REPEAT_S = 0.05
_WAIT_FOR = ("importlib", "pydantic", "seaclutter_cli.sinks.atomic")
"""Packages and modules that drop or replace an interrupt that comes within them, or that complete and remove files; all
of them take a short time."""

_MAY_TAKE_LONG = "_send_pieces"
"""Function that runs within one of these, but can be interrupted."""


class _Interrupt(KeyboardInterrupt):
    """The interrupt of this process; unlike its base class, it can be referred to weakly."""


_first: "weakref.ref[_Interrupt] | None" = None
_is_repeated = False
_number = int(signal.SIGINT)


def handle_interrupts() -> None:
    """Make termination requests and hang-ups a KeyboardInterrupt, as Ctrl-C is, and let none get lost.

    An interrupt that is dropped is repeated until the run ends. Compiled code that calls Python may drop it: numpy does
    so while it looks at an object that is no array, such as a member of an enumeration. So do finalizers, callbacks and
    imports, and the program imports most of its modules when a command runs; an interrupt therefore waits until an
    import is done. While the first one unwinds the run and removes incomplete files, all others are ignored.
    """
    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:  # as nohup sets it
            signal.signal(number, _interrupt)
    sys.unraisablehook = _show_unraisable


def ignore_interrupts() -> None:
    """Ignore interrupts from now on: the run has ended, only the process has not."""
    for number in _SIGNALS:
        if signal.getsignal(number) is _interrupt:
            signal.signal(number, signal.SIG_IGN)


def exit_status() -> int:
    """Return the exit status of an interrupted run: 128 and the number of the signal, as shells have it."""
    return 128 + _number


def _interrupt(number: int, frame: FrameType | None) -> None:
    global _number  # noqa: PLW0603
    if not _is_repeated:
        _number = int(number)
    _repeat(number)
    if not _is_alive() and not _must_wait(frame):
        raise _new_interrupt()  # no variable here, which its traceback would keep alive


def _new_interrupt() -> _Interrupt:
    global _first  # noqa: PLW0603
    interrupt = _Interrupt()
    _first = weakref.ref(interrupt)
    return interrupt


def _is_alive() -> bool:
    """Return whether an interrupt propagates or is handled: what is dropped is freed."""
    return _first is not None and _first() is not None


def _must_wait(frame: FrameType | None) -> bool:
    """Return whether an interrupt would be dropped at this place, or leave some files complete and others not."""
    while frame is not None and frame.f_code.co_name != _MAY_TAKE_LONG:
        module = frame.f_globals.get("__name__", "")
        if any(module == name or module.startswith(f"{name}.") for name in _WAIT_FOR):
            return True
        frame = frame.f_back
    return False


def _show_unraisable(lost: "UnraisableHookArgs") -> None:
    """Show the exception of a finalizer or callback as Python does, unless it is an interrupt, which is repeated."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        _repeat(signal.SIGTERM)
    else:
        sys.__unraisablehook__(lost)


def _repeat(number: int) -> None:
    """Repeat an interrupt, whenever it was dropped, until :func:`ignore_interrupts`."""
    global _is_repeated  # noqa: PLW0603
    if not _is_repeated:
        _is_repeated = True
        # Not threading.Thread: the interrupted code may hold its locks.
        _thread.start_new_thread(_interrupt_again, (signal.Signals(number),))


def _interrupt_again(number: signal.Signals) -> None:
    while signal.getsignal(number) is _interrupt:
        time.sleep(_REPEAT_S)
        if not _is_alive():
            _thread.interrupt_main(number)
