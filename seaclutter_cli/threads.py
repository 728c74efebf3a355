"""Threads that this process may use."""

import os

from seaclutter_cli.errors import UsageError

VARIABLE = "SEACLUTTER_THREADS"
"""Environment variable that limits the threads of a process."""


def threads() -> int:
    """Return the number of threads that may compute at the same time: the cores of this process, or less.

    The environment variable ``SEACLUTTER_THREADS`` sets it. Processes that work beside each other share the cores by
    this variable.

    Raises
    ------
    UsageError
        If the variable is not a positive whole number.
    """
    given = os.environ.get(VARIABLE)
    if given is not None:
        if not (given.isascii() and given.isdigit() and len(given) <= 4 and int(given)):
            raise UsageError(f"{VARIABLE}: expected a positive whole number, got {given[:20]!r}")
        return int(given)
    return cores()


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
