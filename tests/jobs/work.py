"""Tasks for engines; pickle needs them in a module."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.threads import threads


@dataclass(frozen=True)
class Square:
    number: int
    wait_s: float = 0.0

    def __call__(self, report):
        report(0.5)
        time.sleep(self.wait_s)
        return self.number**2


@dataclass(frozen=True)
class Kill:
    """Kill the own process, as a system without memory does, in the first runs."""

    marks: Path
    times: int

    def __call__(self, report):
        runs = len(list(self.marks.iterdir()))
        (self.marks / f"{runs}").touch()
        if runs < self.times:
            os.kill(os.getpid(), signal.SIGKILL)
        return "survived"


@dataclass(frozen=True)
class Fail:
    error: type[Exception]

    def __call__(self, report):
        raise self.error("no such sea")


@dataclass(frozen=True)
class Meet:
    """Wait until the other task runs, too."""

    own: Path
    other: Path

    def __call__(self, report):
        self.own.touch()
        until = time.monotonic() + 30
        while not self.other.exists() and time.monotonic() < until:
            time.sleep(0.01)
        return self.other.exists()


@dataclass(frozen=True)
class Wait:
    """Wait until interrupted, then leave a mark, as a run does that removes its incomplete files."""

    started: Path
    ended: Path

    def __call__(self, report):
        self.started.touch()
        try:
            time.sleep(60)
        finally:
            self.ended.touch()


@dataclass(frozen=True)
class Unsendable:
    """Return what pickle cannot copy."""

    def __call__(self, report):
        return lambda: None


@dataclass(frozen=True)
class Variable:
    """Return a variable of the environment."""

    def __call__(self, report):
        return os.environ.get("SEACLUTTER_TEST")


@dataclass(frozen=True)
class Ask:
    """Return what a process was given."""

    def __call__(self, report):
        return threads(), os.getpid()


@dataclass(frozen=True)
class Blocked:
    """Return the signals that are blocked in the process."""

    def __call__(self, report):
        return signal.pthread_sigmask(signal.SIG_BLOCK, [])
