"""Scratch folders in which objects have paths, so that code for local files can work on them; copies of objects."""

import os
import re
import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from functools import partial
from glob import escape
from itertools import pairwise, takewhile
from pathlib import Path
from threading import Thread
from typing import BinaryIO

from seaclutter_cli.errors import InputError, OutputError, SeaclutterError, UsageError, opening
from seaclutter_cli.parts import SCRATCH, part_path, release, remove_stale
from seaclutter_cli.storage import objects as stored
from seaclutter_cli.storage.objects import StoredObject, Upload, list_objects, read_range
from seaclutter_cli.urls import SCHEMES, WEB, Url

_MAGIC = re.compile(r"[*?\[]")
_HEAD_BYTES = 4096
_END_BYTES = 2**20
_RANGE = 4 * 2**20
_AT_ONCE, _WAKE_SECONDS = 8, 0.5
_FAILED = "the copy in the scratch folder failed"
_TOLD_BY_CONTENT = (".csv", ".yaml")
_WORTH_AN_EXCERPT = 16 * 2**20
_MANY, _SMALL = 64, 16 * 2**20
"""Files, and bytes, up to which several recordings are fetched ahead."""


class Download:
    """Copies of objects, complete after `wait`.

    Every range is requested with the version of the object, so a copy never mixes two of them. The files are pairs of
    an object and what becomes its copy.
    """

    def __init__(self, files: list[tuple[StoredObject, Path]]) -> None:
        self._error: BaseException | None = None
        self._stopped = False
        for found, path in files:
            with opening(found.url, problem=_FAILED):
                path.write_bytes(b"")
        ranges = [(*file, start) for file in files for start in range(0, file[0].size, _RANGE)]
        self._ranges = iter(ranges)
        self._threads = [Thread(target=self._run, daemon=True) for _ in ranges[:_AT_ONCE]]
        for thread in self._threads:
            thread.start()

    def wait(self) -> None:
        """Return when all copies are complete; raise the error that prevented it."""
        for thread in self._threads:
            while thread.is_alive():
                thread.join(_WAKE_SECONDS)  # lets Windows handle Ctrl-C
        if self._error:
            raise self._error

    def stop(self) -> None:
        """Stop the transfer; a thread that waits for the service writes nothing any more."""
        self._stopped = True

    def _run(self) -> None:
        for found, path, start in self._ranges:
            try:
                self._fetch(found, path, start)
            except BaseException as error:  # noqa: BLE001 - it must not get lost with the thread
                failed = InputError(f"{found.url}: the copy failed ({type(error).__name__})")
                self._error = self._error or (error if isinstance(error, SeaclutterError) else failed)
                self._stopped = True
            if self._stopped:
                return

    def _fetch(self, found: StoredObject, path: Path, start: int) -> None:
        data = read_range(found, start, start + _RANGE)
        if not self._stopped:
            # It is not open while waiting: some systems do not remove open files.
            with opening(found.url, problem=_FAILED), path.open("r+b") as file:
                file.seek(start)
                file.write(data)


class Mirror:
    """The objects of a run as files of a scratch folder: ``SCRATCH/SCHEME/BUCKET/KEY``.

    Objects that were only found are files without content (of their size, where the system has files with holes), so
    names, sizes and kinds are those of the objects. `fetch` copies them. The folder is only for this user, and removed
    by `close`, with this object, or when the program ends; those that killed runs left behind are removed, too. Raise
    `OutputError` if the scratch folder cannot be used.
    """

    def __init__(self) -> None:
        root = Path(os.environ.get(SCRATCH) or tempfile.gettempdir()).absolute()
        with opening(root, OutputError, "the scratch folder cannot be used"):
            root.mkdir(exist_ok=True)
            root = root.resolve()  # errors of libraries name files by their resolved paths
            remove_stale(root, ["seaclutter"])
            self.path = part_path(root / "seaclutter")
            self.path.mkdir(mode=0o700)
        self._remove = weakref.finalize(self, _remove, self.path)
        self._objects: dict[Path, StoredObject] = {}
        self._known_below: set[Path] = set()
        self._listed: set[Path] = set()
        self._complete: set[Path] = set()
        self._after: dict[tuple[Path, ...], Sequence[Path]] = {}
        self._next: Download | None = None
        self._waiting: set[tuple[StoredObject, Path]] = set()
        schemes = "|".join(SCHEMES)
        self._shown = re.compile(rf"{re.escape(str(self.path) + os.sep)}({schemes}){re.escape(os.sep)}")

    def close(self) -> None:
        """Stop what is being fetched, and remove all copies."""
        if self._next is not None:
            self._next.stop()
        self._remove()

    def local(self, url: Url) -> Path:
        """Return the path that stands for a URL; raise `InputError` if no file of this system can have its name."""
        parts = [url.scheme, url.bucket, *filter(None, url.key.split("/"))]
        for part in parts:
            if part in (".", "..") or os.sep in part or "\0" in part or (os.name == "nt" and ":" in part):
                raise InputError(f"{url}: files of this system cannot have this name")
        return self.path.joinpath(*parts)

    def url(self, path: Path) -> Url:
        """Return the URL that a path stands for."""
        scheme, bucket, *parts = path.relative_to(self.path).parts
        return Url(scheme, bucket, "/".join(parts))

    def has(self, path: Path) -> bool:
        """Return whether a path stands for a URL."""
        return self.path in path.parents and path.parent != self.path

    def shown(self, text: str) -> str:
        """Return text with URLs in place of the paths that stand for them."""
        return self._shown.sub(r"\1://", text)

    def find(self, pattern: str, also: Sequence[str]) -> str:
        """List what the path or pattern of logs may refer to, and return it for `glob`.

        ``also`` are suffixes of objects that belong to those that a pattern matches. Raise `UsageError` if there is no
        such object or folder.
        """
        path = Path(pattern)
        url = self.url(path)
        if self.look_below(path, sized=False):
            return str(path)
        if url.scheme in WEB:
            raise UsageError(f"{url}: no such file; web servers list no folders, so name each file")
        if not _MAGIC.search(url.key):
            raise UsageError(f"{url}: no such object or folder")
        parts = url.key.split("/")
        fixed = next(number for number, part in enumerate(parts) if _MAGIC.search(part))
        base, wanted = Url(url.scheme, url.bucket, "/".join(parts[:fixed])), parts[fixed:]
        objects = [one for one in list_objects(base) if _begins_as(one.url, base, wanted) or one.url.suffix in also]
        if not objects:
            raise UsageError(f"{url}: no file matches this pattern")
        self._add(objects, sized=False)
        return f"{escape(str(self.local(base)))}/{'/'.join(wanted)}"

    def settle(self, recordings: Sequence[Sequence[Path]]) -> None:
        """Give files that were found the sizes of their objects: while recordings are found, they must be empty.

        The files of each recording are fetched while those of the one before are read, if there is space.
        """
        for path, found in self._objects.items():
            if path not in self._complete:
                _resize(path, found.size)
        self._after |= {tuple(paths): after for paths, after in pairwise(recordings)}

    def look(self, path: Path) -> None:
        """Let a path be what there is: a file, or a folder with what is directly in it."""
        if found := stored.find_object(self.url(path)):
            self._add([found])
        else:
            self.list_folder(path)

    def list_folder(self, folder: Path) -> None:
        """Let a folder contain what there is directly in it."""
        url = self.url(folder)
        objects, folders = stored.list_folder(url)
        self._listed.add(folder)
        if objects or folders or not url.key:
            folder.mkdir(parents=True, exist_ok=True)
        self._add(objects)
        for inner in folders:
            self.local(inner).mkdir(exist_ok=True)

    def look_beside(self, path: Path) -> None:
        """Let what is beside a file be there, too."""
        if path.parent not in self._listed and self._known_below.isdisjoint(path.parents):
            self.list_folder(path.parent)

    def know(self, path: Path) -> None:
        """Look below a path, unless that was done."""
        if path not in self._objects and self._known_below.isdisjoint((path, *path.parents)):
            self.look_below(path)

    def look_below(self, path: Path, *, sized: bool = True) -> list[StoredObject]:
        """Let a path be what there is: a file, or a folder with all that is below it; return the objects."""
        url = self.url(path)
        found = stored.find_object(url)
        objects = [found] if found else list(list_objects(url))
        self._add(objects, sized=sized)
        self._known_below.add(path)
        return objects

    def _add(self, objects: Iterable[StoredObject], *, sized: bool = True) -> None:
        """Add files without content, or the first bytes of the first file of a folder whose name does not suffice."""
        told: set[tuple[Path, str]] = set()
        for found in objects:
            path = self.local(found.url)
            if self._objects.get(path) == found:
                continue
            kind, head = (path.parent, path.suffix.lower()), b""
            if kind[1] in _TOLD_BY_CONTENT and kind not in told and not sized:
                told.add(kind)
                head = read_range(found, 0, _HEAD_BYTES)
            with opening(found.url, problem="the scratch folder cannot be used"):
                try:
                    path.parent.mkdir(parents=True, exist_ok=True)
                    path.write_bytes(head)
                except (FileExistsError, NotADirectoryError, IsADirectoryError):
                    continue  # some tools mark folders by empty objects
            self._objects[path] = found
            self._complete.discard(path)
            if sized:
                _resize(path, found.size)

    def fetch(self, paths: Sequence[Path], at_most: int | None = None) -> None:
        """Copy the objects at some paths that are not copied yet, and those of the next recording ahead.

        Raise `InputError` if there is no such object, one has more than ``at_most`` bytes, or they do not fit into the
        scratch folder.
        """
        files = self._missing(paths)
        for found, _ in files:
            if at_most is not None and found.size > at_most:
                raise InputError(f"{found.url}: {found.size:,} bytes are too many for this kind of file")
        if files:
            self._copy(files)
        if (after := self._after.get(tuple(paths))) is not None:
            self._fetch_ahead(after)

    def _missing(self, paths: Iterable[Path]) -> list[tuple[StoredObject, Path]]:
        found = {one: None for path in paths for one in self._files_at(path)}
        return [(self._objects[one], one) for one in found if one not in self._complete]

    def _files_at(self, path: Path) -> list[Path]:
        if path in self._objects:
            return [path]
        self.know(path)
        files = [one for one in (path, *sorted(path.rglob("*"))) if one in self._objects]
        if not files:
            raise InputError(f"{self.url(path)}: no such object")
        return files

    def _copy(self, files: list[tuple[StoredObject, Path]]) -> None:
        if self._next is not None and self._waiting.issuperset(files):
            try:
                self._next.wait()
            except SeaclutterError:  # perhaps of another file
                self._forget_next()
        if not self._waiting.issuperset(files):
            self._require(files)
            download = Download(files)
            try:
                download.wait()
            except BaseException:
                download.stop()
                self._reset(files)
                raise
        self._waiting.difference_update(files)
        self._complete.update(path for _, path in files)

    def _fetch_ahead(self, paths: Sequence[Path]) -> None:
        files = self._missing(paths)
        if self._waiting.issuperset(files):
            return
        self._forget_next()
        later = self._after.get(tuple(paths))
        while later is not None and len(files) < _MANY and sum(found.size for found, _ in files) < _SMALL:
            files += self._missing(later)
            later = self._after.get(tuple(later))
        with suppress(SeaclutterError):  # it says so when it is its turn
            self._require(files)
            self._next, self._waiting = Download(files), set(files)

    def _forget_next(self) -> None:
        """Stop what is fetched ahead, and remove what is not used yet."""
        if self._next is not None:
            self._next.stop()
        self._reset(self._waiting)
        self._next, self._waiting = None, set()

    def is_small(self, path: Path) -> bool:
        """Return whether what a path stands for is an object that takes longer to ask for than to copy."""
        return path in self._objects and self._objects[path].size < _SMALL // _MANY

    def _require(self, files: Sequence[tuple[StoredObject, Path]]) -> None:
        """Raise `InputError` if there is no space for copies."""
        size, free = sum(found.size for found, _ in files), shutil.disk_usage(self.path).free
        if free < size:
            raise InputError(
                f"{files[0][0].url}: needs {size / 1e9:.2f} GB in the scratch folder {self.path.parent}, which has "
                f"{free / 1e9:.2f} GB free; choose another with {SCRATCH}"
            )

    def fetch_ends(self, path: Path) -> None:
        """Copy the first and the last MiB of a file that is not copied."""
        for found, _ in self._missing([path]):
            with path.open("r+b") as stream:
                for start in sorted({0, max(found.size - _END_BYTES, 0)}):
                    stream.seek(start)
                    stream.write(read_range(found, start, start + _END_BYTES))

    def version(self, path: Path) -> str:
        """Return what identifies the content of an object, if the service says so."""
        return self._objects[path].etag or ""

    def parts(self, path: Path) -> tuple[Callable[[int, int], bytes], int] | None:
        """Return a function that reads from a large object, and its size; None if a path is something else."""
        found = self._objects[self._files_at(path)[0]]
        if found.url != self.url(path) or found.size < _WORTH_AN_EXCERPT:
            return None
        return partial(read_range, found), found.size

    def fill(self, path: Path, data: bytes) -> None:
        """Let a file have other content than its object, as a copy."""
        path.write_bytes(data)
        self._complete.add(path)

    @contextmanager
    def copies_removed(self) -> Iterator[None]:
        """Remove the content of copies that are made within the context."""
        before = set(self._complete)
        try:
            yield
        finally:
            made = self._complete - before
            self._complete -= made
            self._reset((self._objects[path], path) for path in made)

    def _reset(self, files: Iterable[tuple[StoredObject, Path]]) -> None:
        for found, path in files:
            with suppress(OSError):
                path.write_bytes(b"")
                _resize(path, found.size)

    def open(self, path: Path) -> BinaryIO:
        """Return an object as a file of which only what is read is fetched."""
        return stored.open_object(self._objects[path])

    def send(self, part: Path, path: Path, last: str) -> Upload:
        """Upload a complete file, or a folder of files; it does not appear yet."""
        return Upload(part, self.url(path), last)

    def delete(self, path: Path) -> None:
        """Delete an object, if there is one."""
        stored.delete_object(self.url(path))


def _remove(path: Path) -> None:
    shutil.rmtree(path, ignore_errors=True)
    release(path)


def _begins_as(url: Url, base: Url, wanted: Sequence[str]) -> bool:
    """Return whether the first parts of a name below a folder match those of a pattern, as far as there are any."""
    parts = url.key[len(base.key) :].removeprefix("/").split("/")
    fixed = takewhile(lambda part: part != "**", wanted)
    return all(fnmatchcase(part, one) for part, one in zip(parts, fixed, strict=False))


def _resize(path: Path, size: int) -> None:
    """Give a file its size without using space; on Windows, files with holes are not usual."""
    if os.name == "posix":
        with suppress(OSError):
            os.truncate(path, size)
