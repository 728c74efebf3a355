"""How many recordings are processed at the same time."""

from pathlib import Path

from seaclutter_cli.threads import cores

MEMORY_PER_JOB = 400 * 2**20
"""Memory in bytes that a recording may need: four chunks of 64 MB, and the program."""

_MEMORY = Path("/proc/meminfo")
_LIMITS = (
    (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")),
    (
        Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
        Path("/sys/fs/cgroup/memory/memory.usage_in_bytes"),
    ),
)


def default_jobs(recordings: int, memory: int = MEMORY_PER_JOB) -> int:
    """Return the number of processes for a number of recordings: as many as there are cores and memory for.

    Each may need ``memory`` bytes.
    """
    available = _available_bytes()
    possible = cores() if available is None else min(cores(), available // memory)
    return max(1, min(recordings, possible))


def _available_bytes() -> int | None:
    """Return the memory that is available to this process, where it is known: on Linux, also in containers."""
    found = [_free()] + [_left(*pair) for pair in _LIMITS]
    return min((size for size in found if size is not None), default=None)


def _free() -> int | None:
    try:
        lines = _MEMORY.read_text().splitlines()
    except OSError:
        return None
    found = [line.split() for line in lines if line.startswith("MemAvailable:")]
    return int(found[0][1]) * 1024 if found else None


def _left(limit: Path, used: Path) -> int | None:
    try:
        return max(0, int(limit.read_text()) - int(used.read_text()))
    except (OSError, ValueError):  # no limit: "max"
        return None
