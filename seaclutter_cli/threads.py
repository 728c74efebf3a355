"""Threads that this process may use."""

import os

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

from seaclutter_cli.errors import UsageError

VARIABLE = "SEACLUTTER_THREADS"
"""Environment variable that limits the threads of a process."""


def threads() -> int:
    """Return the number of threads that may compute at the same time: the cores of this process, or less.

    It is one where the address space is limited: each thread takes some, and OpenMP ends the process if it cannot start
    one. The environment variable ``SEACLUTTER_THREADS`` sets it, so that processes beside each other share the cores.

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
    if resource is not None and resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY:
        return 1
    return cores()


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
