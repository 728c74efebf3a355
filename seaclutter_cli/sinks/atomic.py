"""Outputs that appear under their names only when they are complete, alone or together with others."""

import errno
import io
import os
import re
import shutil
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from seaclutter_cli.buckets import copies_removed, fetch, look, mirror_of
from seaclutter_cli.documents import DocumentError, load_yaml, read_document
from seaclutter_cli.errors import InputError, OutputError, opening
from seaclutter_cli.messages.metadata import RUN, SIDECAR, from_custom_data, from_text
from seaclutter_cli.parts import exchange, part_path, release
from seaclutter_cli.records import Metadata
from seaclutter_cli.sinks.options import ROSBAG2_METADATA, TIMES

if TYPE_CHECKING:
    from seaclutter_cli.buckets import Pending

_MANY = 100
"""Files that are not flushed one by one."""
_FRAME = re.compile(r"\d{6,}\.(pcd|las|laz|npz)")


class PartFile(io.FileIO):
    """A new incomplete file; its errors are `OutputError` and name the target."""

    failure: OutputError | None = None
    """Why it could not be written: some libraries raise another error instead."""

    def __init__(self, part: Path, target: Path) -> None:
        super().__init__(part, "xb")
        self._target = target

    def write(self, data: Any, /) -> int:
        """Write data, or raise `OutputError`."""
        try:
            with _writing(self._target):
                return super().write(data)
        except OutputError as error:
            self.failure = error
            raise


class AtomicFile(AbstractContextManager["AtomicFile"]):
    """A file that is written in the folder of its target, then renamed on success or removed after an error.

    The context is the file; write to its ``stream``. The folder is created if necessary. In a group, the file is
    renamed with the others. If the target is a symbolic link, what it refers to is replaced. ``last`` is the file of a
    folder that appears last in object storage, and shows that the folder is complete. Raise `OutputError` if it cannot
    be created or written, for example if the disk is full.
    """

    def __init__(self, path: Path, group: "OutputGroup | None" = None, *, last: str = "") -> None:
        self.path, self._target, self._last = path, Path(os.path.realpath(path)), last
        self.part = part_path(self._target)
        self._opened: list[BinaryIO] = []  # to be closed before the removal
        self._remover = weakref.finalize(self, _remove, self.part, self._opened)
        self._pending: Pending | None = None
        self._group = group
        # An interrupt may come before the context is entered; then the file is removed with this object, or at exit.
        self._latest: PartFile | None = None
        try:
            with opening(path, OutputError, "cannot be written"):
                self._target.parent.mkdir(parents=mirror_of(path) is not None, exist_ok=True)
                self._create()
        except BaseException:
            self.discard()
            raise

    def prepare(self, *, replace: bool = True) -> None:
        """Do all work before it can appear, such as uploads; `OutputError` if it may not be written or replaced."""
        is_folder = self.part.is_dir()
        if mirror := mirror_of(self._target):
            self._pending = mirror.send(self.part, self._target, self._last)
        else:
            with _writing(self.path):
                _flush(self.part)
        if (self._target.is_dir() and not is_folder) or not os.access(self._target.parent, os.W_OK):
            kind = "folder" if is_folder else "file"
            raise OutputError(f"{self.path}: can no longer be written; the incomplete {kind} was removed")
        if replace and self._last and self._target.is_dir() and (problem := why_kept(self._target, self._last)):
            raise OutputError(f"{self.path}: {problem}, so it was not replaced; this run's folder was removed")
        if not replace:
            if is_folder:
                look(self._target)
            if os.path.lexists(self._target):
                raise OutputError(_appeared(self.path))

    def publish(self, *, replace: bool = True) -> None:
        """Rename it to its target, or let what was uploaded appear; `OutputError` if it may not be replaced."""
        if self._pending is not None:
            self._pending.complete()
            self._pending = None
            self.discard()
            return
        with _writing(self.path):
            try:
                _rename(self.part, self._target, replace=replace)
            except FileExistsError as error:
                raise OutputError(_appeared(self.path)) from error
        with suppress(OSError):  # not every system flushes the names in a folder
            _sync(self._target.parent, os.O_RDONLY)
        self._remover()  # of a folder that was replaced

    def discard(self) -> None:
        """Remove it, and what was uploaded of it."""
        pending, self._pending = self._pending, None
        if pending is not None:
            pending.abort()
        self._remover()

    def _create(self) -> None:
        if self._target.exists() and not self._target.is_file():
            raise OutputError(f"{self.path}: not a regular file, cannot be replaced")
        self.stream = self._new(self.part)
        self._opened.append(self.stream)

    def _new(self, part: Path) -> BinaryIO:
        self._latest = PartFile(part, self.path)
        return cast("BinaryIO", io.BufferedWriter(self._latest))

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        """Rename the file to its target, or leave that to its group; remove it after an error."""
        if error is not None:
            failure = None if self._latest is None else self._latest.failure
            self.discard()
            if failure is not None and isinstance(error, Exception) and not isinstance(error, OutputError):
                raise failure from error
            _note_removal(error, self.path)
            return
        try:
            with _writing(self.path):
                for stream in self._opened:
                    stream.close()
                with nullcontext(self._group) if self._group else OutputGroup() as group:
                    group.files.append(self)
        except BaseException:
            self.discard()
            raise


class AtomicFolder(AtomicFile):
    """A folder that is written as an `AtomicFile` is; an existing one is moved aside while the new one appears."""

    def _create(self) -> None:
        if self._target.exists() and not self._target.is_dir():
            raise OutputError(f"{self.path}: not a folder, cannot be replaced")
        self.part.mkdir()

    def open(self, name: str) -> BinaryIO:
        """Create a file in the folder; who opens it closes it."""
        with _writing(self.path):
            return self._new(self.part / name)


class OutputGroup(AbstractContextManager["OutputGroup"]):
    """Files that appear under their names together, when all are complete, or not at all.

    They are renamed in the order of their completion. A run completes its main output last; once that has appeared, all
    others have. Everything for object storage is uploaded before the first file appears. They join a larger ``group``
    when this one is complete. Unless ``replace``, files that appear while a group is written, from another run for
    example, are an error at its end.
    """

    def __init__(self, group: "OutputGroup | None" = None, *, replace: bool = True) -> None:
        self._outer, self._replace = group, replace
        self.files: list[AtomicFile] = []
        """Files that are complete."""
        self.replaced: list[Path] = []
        """Files of an earlier run with other names, which are removed before these appear, if files may be replaced."""

    def discard(self) -> None:
        """Remove the files added so far."""
        self.replaced.clear()
        while self.files:
            self.files.pop().discard()

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        try:
            if error is None:
                self._complete()
            elif self.files:
                _note_removal(error, self.files[-1].path)
        finally:
            self.discard()

    def _complete(self) -> None:
        if self._outer is not None:
            self._outer.replaced += self.replaced
            self._outer.files += self.files
            self.files.clear()
            return
        for file in self.files:
            file.prepare(replace=self._replace)
        for path in self.replaced if self._replace else ():
            if mirror := mirror_of(path):
                mirror.delete(path)
            path.unlink(missing_ok=True)
        while self.files:
            self.files[0].publish(replace=self._replace)
            del self.files[0]


def _remove(part: Path, opened: list[BinaryIO]) -> None:
    for stream in opened:
        with suppress(OSError, OutputError):
            stream.close()
    with suppress(OSError):
        if part.is_dir() and not part.is_symlink():
            shutil.rmtree(part, ignore_errors=True)
        else:
            part.unlink(missing_ok=True)
    release(part)


def _rename(part: Path, target: Path, *, replace: bool) -> None:
    """Rename a file or folder; `FileExistsError` if the target exists, even just now, and may not be replaced."""
    if part.is_dir():
        if not os.path.lexists(target):
            part.rename(target)
        elif replace:
            exchange(part, target)
        else:
            raise FileExistsError
    elif replace:
        part.replace(target)
    elif os.name == "nt":  # there, renaming never replaces
        part.rename(target)
    else:
        try:
            os.link(part, target)
        except OSError:  # the target exists, or the file system has no hard links
            target.touch(exist_ok=False)
            part.replace(target)
        else:
            part.unlink()


def _flush(part: Path) -> None:
    """Let the disk have a file or those in a folder, so that a power failure cannot leave a name without content."""
    inner = [file for file in part.rglob("*") if file.is_file()] if part.is_dir() else []
    if len(inner) > _MANY and hasattr(os, "sync"):
        os.sync()
        return
    for file in inner or [part]:
        _sync(file, os.O_RDWR)  # Windows flushes only what may be written


def _sync(path: Path, access: int) -> None:
    number = os.open(path, access)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def _note_removal(error: BaseException | None, path: Path) -> None:
    if isinstance(error, KeyboardInterrupt):
        error.add_note(f"{path}: the incomplete file was removed")


def _appeared(path: Path) -> str:
    return f"{path}: appeared while this run was writing it; use --force to replace it; this run's file was removed"


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Raise `OutputError` that names the target if the system cannot do what the context does."""
    try:
        yield
    except OSError as error:
        problem = f"writing failed ({error.strerror or error})"
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            problem = f"the {'scratch folder' if mirror_of(path) else 'disk'} is full"
        raise OutputError(f"{path}: {problem}; the incomplete file was removed") from error


def why_kept(folder: Path, marker: str) -> str:
    """Return why a folder may not be replaced; nothing if it is the output of a run, and has no other files.

    ``marker`` is the file with the records of the run.
    """
    try:
        look(folder)
        with copies_removed():
            fetch(folder / marker, *([folder / TIMES] if marker == SIDECAR else []))
            metadata, is_own = _content(folder, marker)
        names = sorted(file.name for file in folder.iterdir() if file.name != marker)
    except (InputError, DocumentError, OSError, LookupError, TypeError, ValueError):
        metadata, is_own, names = [], bool, []
    if not any(record.name == RUN for record in metadata):
        return f"is a folder of something else ({marker} has no record of a run)"
    foreign = next((name for name in names if not is_own(name)), "")
    return foreign and f"is a folder with a file that is not of the run that wrote it, {foreign}"


def _content(folder: Path, marker: str) -> tuple[Sequence[Metadata], Callable[[str], object]]:
    """Return the records of a folder, and which files a ROS 2 recording has, or as many frames as there are times."""
    text = read_document(folder / marker)
    if marker == ROSBAG2_METADATA:
        found: Any = load_yaml(text.decode())["rosbag2_bagfile_information"]
        return from_custom_data(found["custom_data"]), set(found["relative_file_paths"]).__contains__
    frames = sum(1 for file in folder.iterdir() if _FRAME.fullmatch(file.name))
    fits = frames == (folder / TIMES).read_bytes().count(b"\n")
    return from_text(text), lambda name: name == TIMES or (fits and _FRAME.fullmatch(name))
