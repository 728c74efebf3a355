"""Incomplete files and scratch folders: their names, how they replace others, and what killed processes left behind."""

import os
import platform
import re
import shutil
import sys
import zlib
from collections.abc import Collection, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

SCRATCH = "SEACLUTTER_SCRATCH"
"""Environment variable for the scratch folder. It belongs to the machine, so workers elsewhere have their own."""

_MAX_NAME_BYTES = 255
_MIN_CUT = 100
"""Bytes of a name that may have been cut."""
_MAX_HOST = 40
_INITIAL_PID_NAMESPACE = 0xEFFFFFFC
_PART = re.compile(
    r"\.(?P<name>.*)\.(?P<host>[^.]+)-(?P<pid>[1-9]\d*)-(?P<random>[0-9a-f]{8})\.(?P<kind>part|old)", re.DOTALL
)
_NUMBER = re.compile(r"_\d+(?=\.|$)")
_EXCHANGE = {"linux": ("renameat2", -100), "darwin": ("renameatx_np", -2)}
"""Function of the system that can exchange two names, and its number for the working folder."""
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


def exchange(part: Path, target: Path) -> None:
    """Exchange a complete folder and the one that it replaces, which then has the name of the part.

    Where this takes more than one step, the old folder is in a folder ``.NAME.HOST-PID-RANDOM.old`` meanwhile.
    """
    if _exchanged(part, target):
        return
    aside = part.with_suffix(".old")
    aside.mkdir()
    try:
        target.rename(aside / target.name)
        part.rename(target)
    except BaseException:
        _take_back(aside)
        raise
    (aside / target.name).rename(part)
    aside.rmdir()


def _exchanged(part: Path, target: Path) -> bool:
    """Exchange two names in one step; return False if the system or the file system cannot."""
    import ctypes  # takes memory

    name, here = _EXCHANGE.get(sys.platform, ("", 0))
    call = getattr(ctypes.CDLL(None), name, None) if name else None
    return call is not None and call(here, os.fsencode(part), here, os.fsencode(target), 2) == 0


def _take_back(aside: Path) -> Path | None:
    """Give a folder that was moved aside its name again, unless another has it; return what came back."""
    back = None
    with suppress(OSError):
        for old in aside.iterdir():
            target = aside.parent / old.name
            if not os.path.lexists(target):
                back = old.rename(target)
            elif not os.path.lexists(part := aside.with_suffix(".part")):  # the exchange was complete
                old.rename(part)
        aside.rmdir()
    return back


def take_back(folder: Path) -> list[Path]:
    """Undo what dead processes of this host did not finish in `exchange`; return what has its name again."""
    return [back for path in list(_left(folder, "old")) if (back := _take_back(path))]


def remove_stale(folder: Path, names: Collection[str]) -> int:
    """Remove the incomplete files and scratch folders of dead processes of this host, and return their number.

    Only those for targets of some names are removed, or for other numbered parts of them. Files of other hosts stay,
    because their processes cannot be seen from here.
    """
    removed, wanted = 0, {_NUMBER.sub("", name) for name in names}
    for path in list(_left(folder, "part", wanted)):
        with suppress(OSError):
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
            removed += 1
    return removed


def _left(folder: Path, kind: str, names: Collection[str] | None = None) -> Iterator[Path]:
    """Yield what dead processes of this host left in a folder; not what belongs to an unfinished exchange."""
    with suppress(OSError):
        for entry in os.listdir(folder):  # noqa: PTH208 - names only: the folder may be large
            found = _PART.fullmatch(entry)
            if not found or found["kind"] != kind or found["host"] != _host():
                continue
            if names is not None and not _is_cut_from(_NUMBER.sub("", found["name"]), names):
                continue
            path = folder / entry
            is_free = kind == "old" or not os.path.lexists(path.with_suffix(".old"))
            if is_free and not _in_use(int(found["pid"]), found["random"]):
                yield path


def _is_cut_from(name: str, names: Collection[str]) -> bool:
    return name in names or (len(os.fsencode(name)) > _MIN_CUT and any(one.startswith(name) for one in names))


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


@cache
def _host() -> str:
    """Return what identifies the processes that this one sees: name of the host, and a digest of what distinguishes it.

    In a container, this is the number of its processes' namespace and of the start of the machine.
    """
    name = re.sub(r"[^A-Za-z0-9_]", "_", platform.node().partition(".")[0])[:_MAX_HOST] or "host"
    file, seen = "/etc/machine-id", ""
    with suppress(OSError):
        number = os.stat("/proc/self/ns/pid").st_ino  # noqa: PTH116 - not a file
        if number != _INITIAL_PID_NAMESPACE:
            file, seen = "/proc/sys/kernel/random/boot_id", str(number)
    with suppress(OSError):
        seen += Path(file).read_text()
    return f"{name}_{zlib.crc32(seen.encode()):08x}" if seen else name
