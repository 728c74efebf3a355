"""Incomplete files and scratch folders: their names, and the removal of those that killed processes left behind."""

import os
import platform
import re
import shutil
from contextlib import suppress
from pathlib import Path

SCRATCH = "SEACLUTTER_SCRATCH"
"""Environment variable for the scratch folder. It belongs to the machine, so workers elsewhere have their own."""

_MAX_NAME_BYTES = 255
_MAX_HOST = 40
_INITIAL_PID_NAMESPACE = 0xEFFFFFFC
_PART = re.compile(r"\..*\.(?P<host>[^.]+)-(?P<pid>[1-9]\d*)-(?P<random>[0-9a-f]{8})\.part", re.DOTALL)
_IN_USE: set[str] = set()
"""Random parts of the names that this process has given out, and not yet released."""


def part_path(target: Path) -> Path:
    """Return a new name for an incomplete file beside its target: ``.NAME.HOST-PID-RANDOM.part``.

    The name of the target is cut if the new name would be longer than file systems allow.
    """
    random = os.urandom(4).hex()  # the module secrets takes long to import
    _IN_USE.add(random)
    end = f".{_host()}-{os.getpid()}-{random}.part"
    base = os.fsencode(target.name)[: _MAX_NAME_BYTES - 1 - len(end.encode())]
    # A character cut in half is left out: some file systems only take valid text.
    name = base.decode(errors="ignore") if len(base) < len(os.fsencode(target.name)) else target.name
    return target.with_name(f".{name}{end}")


def release(part: Path) -> None:
    """Forget a name of `part_path` that has no file any more."""
    if found := _PART.fullmatch(part.name):
        _IN_USE.discard(found["random"])


def remove_stale(folder: Path) -> int:
    """Remove the incomplete files and scratch folders of dead processes of this host, and return their number.

    Files of other hosts stay, because their processes cannot be seen from here.
    """
    removed = 0
    with suppress(OSError):
        for name in os.listdir(folder):  # noqa: PTH208 - names only: the folder may be large
            found = _PART.fullmatch(name)
            if found and found["host"] == _host() and not _in_use(int(found["pid"]), found["random"]):
                with suppress(OSError):
                    path = folder / name
                    shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
                    removed += 1
    return removed


def _in_use(pid: int, random: str) -> bool:
    if pid == os.getpid():  # containers give every run the same number
        return random in _IN_USE
    if os.name != "posix":
        return True  # there, signal 0 would end the process
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def _host() -> str:
    """Return the name of this host; in a container, also its number, since its processes have numbers of their own."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", platform.node().partition(".")[0])[:_MAX_HOST] or "host"
    with suppress(OSError):
        namespace = os.stat("/proc/self/ns/pid").st_ino  # noqa: PTH116 - not a file
        if namespace != _INITIAL_PID_NAMESPACE:
            name += f"_{namespace:x}"
    return name
