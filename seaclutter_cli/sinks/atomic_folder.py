"""Folders that appear under their names only when they are complete."""

import os
import shutil
from typing import TYPE_CHECKING, BinaryIO

from seaclutter_cli.errors import OutputError
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup, appeared, explain
from seaclutter_cli.storage.locations import Location, Url
from seaclutter_cli.storage.objects import delete_object, is_folder_of_objects, list_objects
from seaclutter_cli.storage.parts import part_path, release
from seaclutter_cli.storage.uploads import send

if TYPE_CHECKING:
    from seaclutter_cli.storage.objects import PendingObject


class AtomicFolder(AtomicFile):
    """A folder that is written beside its target, then renamed on success or removed after an error.

    An existing folder is moved aside before the new one appears, and removed after. A folder for object storage is
    written in the scratch folder, then uploaded. There, the file that shows that a folder is complete is deleted first
    and appears last, so that a folder that has it is never a mixture of two.

    Parameters
    ----------
    path : Path or Url
        Target.
    group : OutputGroup, optional
        Outputs that appear together.
    last : str, optional
        Name of the file that appears last in object storage, and shows that the folder is complete.

    Raises
    ------
    OutputError
        If the folder cannot be created, for example because there is a file of this name.
    """

    def __init__(self, path: Location, group: OutputGroup | None = None, *, last: str = "") -> None:
        self._last = last
        self._uploads: dict[Url, PendingObject] = {}
        super().__init__(path, group)

    def open(self, name: str) -> BinaryIO:
        """Create a file in the folder."""
        try:
            return self._new(self.part / name)
        except OSError as error:
            raise OutputError(explain(self.path, error)) from error

    def _create(self, opened: list[BinaryIO]) -> None:  # noqa: ARG002 - files are closed by those who opened them
        try:
            if self._target.exists() and not self._target.is_dir():
                raise OutputError(f"{self.path}: not a folder, cannot be replaced")
            self._target.parent.mkdir(exist_ok=True)
            self.part.mkdir()
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written ({error.strerror})") from error

    def _close(self) -> None:
        """Do nothing: the files in the folder are already closed."""

    def prepare(self, *, replace: bool = True) -> None:
        """Do all work before the folder can appear.

        Raises
        ------
        OutputError
            If the target can no longer be written, or exists and may not be replaced.
        """
        self._send()
        if not os.access(self._target.parent, os.W_OK):
            raise OutputError(f"{self.path}: can no longer be written; the incomplete folder was removed")
        there = is_folder_of_objects(self.path) if isinstance(self.path, Url) else os.path.lexists(self._target)
        if not replace and there:
            raise OutputError(appeared(self.path))

    def _send(self) -> None:
        if isinstance(self.path, Url):
            for file in sorted(self.part.iterdir(), key=lambda file: (file.name == self._last, file.name)):
                self._uploads[self.path / file.name] = send(file, self.path / file.name)

    def publish(self, *, replace: bool = True) -> None:
        """Rename the complete folder to its target, or let the uploaded objects appear.

        Raises
        ------
        OutputError
            If the target exists and may not be replaced.
        """
        if isinstance(self.path, Url):
            self._appear(self.path)
            self.discard()
            return
        try:
            self._rename(replace=replace)
        except OSError as error:
            raise OutputError(explain(self.path, error)) from error
        self._remover.detach()
        release(self.part)

    def _appear(self, folder: Url) -> None:
        """Let the uploaded objects appear, and delete all others in the folder."""
        urls = list(self._uploads)
        others = {found.url for found in list_objects(folder)} - set(urls[:-1])
        if urls[-1] in others:
            delete_object(urls[-1])
        for url in urls[:-1]:
            self._uploads.pop(url).complete()
        for url in sorted(others - {urls[-1]}, key=str):
            delete_object(url)
        self._uploads.pop(urls[-1]).complete()

    def _rename(self, *, replace: bool) -> None:
        if not os.path.lexists(self._target):
            self.part.rename(self._target)
            return
        if not replace:
            raise OutputError(appeared(self.path))
        aside = part_path(self._target)
        self._target.rename(aside)
        try:
            self.part.rename(self._target)
        except BaseException:
            aside.rename(self._target)
            raise
        finally:
            shutil.rmtree(aside, ignore_errors=True)
            release(aside)

    def discard(self) -> None:
        """Remove the incomplete folder, and what was uploaded of it."""
        while self._uploads:
            self._uploads.popitem()[1].abort()
        super().discard()
