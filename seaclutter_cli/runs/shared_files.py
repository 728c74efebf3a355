"""Files that workers on other machines must see under the same paths."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from time import sleep

from seaclutter_cli.buckets import mirror_of
from seaclutter_cli.errors import OutputError, opening
from seaclutter_cli.jobs.engine import Report, Task
from seaclutter_cli.parts import part_path, release, remove_stale

_MAX_FOLDERS = 100
_ATTEMPTS, _PAUSE_S = 5, 1.0


@contextmanager
def shared_files(reads: Iterable[Path], writes: Iterable[Path]) -> Iterator[Task[str | None]]:
    """Return the check that a worker sees the folders of a run; an empty file marks the folders of outputs meanwhile.

    Raise `OutputError` if a folder of outputs cannot be written.
    """
    read: dict[Path, Path] = {}
    for path in reads:
        if not mirror_of(path):
            read.setdefault(path.parent, path)
    files = [path for path in writes if not mirror_of(path)]
    written = dict.fromkeys(path.parent for path in files)
    names = frozenset(path.name for path in files)
    samples = [(path, _size(path)) for path in list(read.values())[:_MAX_FOLDERS]]
    with ExitStack() as stack:
        marks = [stack.enter_context(_marked(folder, names)) for folder in written]
        yield partial(_check, partial(_problems, samples, marks, names))


@contextmanager
def _marked(folder: Path, names: frozenset[str]) -> Iterator[Path]:
    mark = part_path(folder / "seaclutter")
    with opening(folder, OutputError, "cannot be written"):
        folder.mkdir(exist_ok=True)
        mark.touch()
    try:
        yield mark
    finally:
        with suppress(OSError):
            mark.unlink()
            release(mark)
            remove_stale(folder, names)  # of workers here that died
            folder.rmdir()  # only if it is empty


def _check(problems: Callable[[], Iterator[str]], report: Report) -> str | None:
    """Return why a worker cannot use the files of a run; None if it can. Network file systems show new ones late."""
    for _ in range(_ATTEMPTS):
        report(0.0)
        if not (reason := next(problems(), None)):
            break
        sleep(_PAUSE_S)
    return reason


def _problems(
    samples: Sequence[tuple[Path, int | None]], marks: Sequence[Path], names: frozenset[str]
) -> Iterator[str]:
    """Yield the problems with a file of each folder that is read, and its size in bytes, or a folder; and with marks.

    The latter are files in folders where files of some names are written.
    """
    for path, size in samples:
        if _size(path) != size or not path.exists():
            seen = "sees another file under" if path.exists() else "cannot see"
            yield f"{seen} {path.absolute()}; workers need the files of a run under the same paths"
    for mark in marks:
        if not mark.exists():
            yield f"cannot see the folder {mark.parent.absolute()}; outputs need a folder that all workers share"
        try:
            remove_stale(mark.parent, names)
            probe = part_path(mark)
            probe.touch()
            probe.unlink()
            release(probe)
        except OSError as error:
            yield f"cannot write to {mark.parent.absolute()} ({error.strerror})"


def _size(path: Path) -> int | None:
    try:
        return None if path.is_dir() else path.stat().st_size
    except OSError:
        return None
