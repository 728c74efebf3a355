"""Outputs that appear under their names only when they are complete, alone or together with others."""

import errno
import io
import os
import shutil
import weakref
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO, Self, cast

from seaclutter_cli.errors import OutputError
from seaclutter_cli.storage.locations import Location, Url
from seaclutter_cli.storage.objects import delete_object
from seaclutter_cli.storage.parts import part_path, release
from seaclutter_cli.storage.scratch import ScratchFolder
from seaclutter_cli.storage.uploads import send

if TYPE_CHECKING:
    from seaclutter_cli.storage.objects import PendingObject


class PartFile(io.FileIO):
    """A new incomplete file; its errors are `OutputError` and name the target."""

    failure: OutputError | None = None
    """Why it could not be written: some libraries raise another error instead."""

    def __init__(self, part: Path, target: Location) -> None:
        super().__init__(part, "xb")
        self._target = target

    def write(self, data: Any, /) -> int:
        """Write data, or raise `OutputError`."""
        try:
            return super().write(data)
        except OSError as error:
            self.failure = OutputError(explain(self._target, error))
            raise self.failure from error


class AtomicFile(AbstractContextManager["AtomicFile"]):
    """A file that is written in the folder of its target, then renamed on success or removed after an error.

    A file for object storage is written in the scratch folder, then uploaded.

    Parameters
    ----------
    path : Path or Url
        Target; its folder is created if necessary. If it is a symbolic link, the file it refers to is replaced.
    group : OutputGroup, optional
        Files that appear together; this one is then renamed with them.

    Raises
    ------
    OutputError
        If the file cannot be created or written, for example because the disk is full.
    """

    def __init__(self, path: Location, group: "OutputGroup | None" = None) -> None:
        self.path = path
        self._group = group
        self._pending: PendingObject | None = None
        self._scratch = ScratchFolder() if isinstance(path, Url) else None
        self._target = Path(os.path.realpath(path)) if isinstance(path, Path) else self._staged(path)
        self.part = part_path(self._target)
        """The incomplete file, for libraries that write to a path."""
        # An interrupt may come before the context is entered; then the file is removed with this object, or at exit.
        opened: list[BinaryIO] = []
        self._latest: PartFile | None = None
        self._remover = weakref.finalize(self, _remove, self.part, opened)
        try:
            self._create(opened)
        except BaseException:
            self.discard()
            raise

    def _create(self, opened: list[BinaryIO]) -> None:
        """Create the incomplete file; ``opened`` receives what must be closed before its removal."""
        self.stream = self._open()
        opened.append(self.stream)

    def _close(self) -> None:
        self.stream.close()

    def _staged(self, url: Url) -> Path:
        assert self._scratch is not None  # noqa: S101 - made for every URL
        return self._scratch.path / url.name

    def _open(self) -> BinaryIO:
        try:
            if self._target.exists() and not self._target.is_file():
                raise OutputError(f"{self.path}: not a regular file, cannot be replaced")
            self._target.parent.mkdir(exist_ok=True)
            return self._new(self.part)
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written ({error.strerror})") from error

    def _new(self, part: Path) -> BinaryIO:
        self._latest = PartFile(part, self.path)
        return cast("BinaryIO", io.BufferedWriter(self._latest))

    def __enter__(self) -> Self:
        """Return the file; write to its ``stream``."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Rename the file to its target, or leave that to its group; remove it after an error."""
        if kind is not None:
            failure = None if self._latest is None else self._latest.failure
            self.discard()
            if failure is not None and isinstance(error, Exception) and not isinstance(error, OutputError):
                raise failure from error
            _note_removal(error, self.path)
            return
        try:
            self._close()
            if self._group is None:
                self._send()
                self.publish()
            else:
                self._group.add(self)
        except BaseException as failure:
            self.discard()
            if isinstance(failure, OSError):
                raise OutputError(explain(self.path, failure)) from failure
            raise

    def prepare(self, *, replace: bool = True) -> None:
        """Do all work before the file can appear.

        Raises
        ------
        OutputError
            If the target can no longer be written, or exists and may not be replaced.
        """
        self._send()
        if self._target.is_dir() or not os.access(self._target.parent, os.W_OK):
            raise OutputError(f"{self.path}: can no longer be written; the incomplete file was removed")
        if not replace and os.path.lexists(self._target):
            raise OutputError(appeared(self.path))

    def _send(self) -> None:
        if isinstance(self.path, Url):
            self._pending = send(self.part, self.path)

    def publish(self, *, replace: bool = True) -> None:
        """Rename the complete file to its target, or let the uploaded object appear.

        Raises
        ------
        OutputError
            If the target exists and may not be replaced.
        """
        if self._pending is not None:
            self._pending.complete()
            self._pending = None
            self.discard()
            return
        try:
            if replace:
                self.part.replace(self._target)
            else:
                _rename_to_new(self.part, self._target)
        except FileExistsError as error:
            raise OutputError(appeared(self.path)) from error
        except OSError as error:
            raise OutputError(explain(self.path, error)) from error
        self._remover.detach()
        release(self.part)

    def discard(self) -> None:
        """Remove the incomplete file, and what was uploaded of it."""
        pending, self._pending = self._pending, None
        if pending is not None:
            pending.abort()
        self._remover()
        if self._scratch is not None:
            self._scratch.remove()


class CompleteFile(AtomicFile):
    """A file that another process has completed, and that appears under its name with a group.

    Parameters
    ----------
    part : Path
        The file, in a folder of the same file system.
    path : Path
        Target.
    """

    def __init__(self, part: Path, path: Path) -> None:
        self.path, self.part = path, part
        self._target, self._group = Path(os.path.realpath(path)), None
        self._pending = self._scratch = None
        self._remover = weakref.finalize(self, _remove, part, [])


class Leftover(AtomicFile):
    """A file or object of an earlier run that the files of a group replace although it has another name."""

    def __init__(self, path: Location) -> None:
        self.path = path

    def publish(self, *, replace: bool = True) -> None:
        """Remove it, if files may be replaced."""
        if not replace:
            return
        if isinstance(self.path, Url):
            delete_object(self.path)
        else:
            self.path.unlink(missing_ok=True)

    def prepare(self, *, replace: bool = True) -> None:
        """Do nothing."""

    def discard(self) -> None:
        """Do nothing: the file stays."""


class OutputGroup(AbstractContextManager["OutputGroup"]):
    """Files that appear under their names together, when all are complete, or not at all.

    They are renamed in the order of their completion. A run completes its main output last; once that has appeared, all
    others have. Everything for object storage is uploaded before the first file appears.

    Parameters
    ----------
    group : OutputGroup, optional
        Larger group, which the files join when this one is complete, and which replaces files or not.
    replace : bool, optional
        Whether existing files may be replaced. Otherwise those that appear while a group is written, from another run
        for example, are an error at its end.
    """

    def __init__(self, group: "OutputGroup | None" = None, *, replace: bool = True) -> None:
        self._outer = group
        self._replace = replace
        self._files: list[AtomicFile] = []

    def add(self, file: AtomicFile) -> None:
        """Add a complete file."""
        self._files.append(file)

    def discard(self) -> None:
        """Remove the files added so far."""
        while self._files:
            self._files.pop().discard()

    def __enter__(self) -> Self:
        """Return the group."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Rename all files to their targets, or remove them after an error."""
        try:
            if kind is None:
                self._complete()
            elif self._files:
                _note_removal(error, self._files[-1].path)
        finally:
            self.discard()

    def _complete(self) -> None:
        if self._outer is None:
            for file in self._files:
                file.prepare(replace=self._replace)
        while self._files:
            if self._outer is None:
                self._files[0].publish(replace=self._replace)
            else:
                self._outer.add(self._files[0])
            del self._files[0]


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


def _rename_to_new(part: Path, target: Path) -> None:
    """Rename a file; `FileExistsError` if the target exists, also if it appears at the same moment."""
    if os.name == "nt":  # there, renaming never replaces
        part.rename(target)
        return
    try:
        os.link(part, target)
    except FileExistsError:
        raise
    except OSError:  # file systems without hard links
        with target.open("xb"):
            pass
        part.replace(target)
    else:
        part.unlink()


def _note_removal(error: BaseException | None, path: Location) -> None:
    if isinstance(error, KeyboardInterrupt):
        error.add_note(f"{path}: the incomplete file was removed")


def appeared(path: Location) -> str:
    """Return the message about an output that appeared while it was written."""
    return f"{path}: appeared while this run was writing it; use --force to replace it; this run's file was removed"


def explain(path: Location, error: OSError) -> str:
    """Return the message about an output that cannot be written."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        where = "scratch folder" if isinstance(path, Url) else "disk"
        return f"{path}: the {where} is full; the incomplete file was removed"
    return f"{path}: writing failed ({error.strerror or error}); the incomplete file was removed"
