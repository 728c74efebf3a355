"""Recordings in object storage: found by their names, copied to the scratch folder when they are opened."""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from glob import escape
from itertools import takewhile
from pathlib import Path

from seaclutter_cli.errors import UsageError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Channel, Damage, Message, Metadata, Record, SensorFacts
from seaclutter_cli.sensors.packets import CALIBRATION_SUFFIXES, DecoderOptions
from seaclutter_cli.sources import Recording, Search, find_recordings, has_metadata_beside, metadata_beside, require_one
from seaclutter_cli.sources.mcap.excerpt import Excerpt, excerpt
from seaclutter_cli.storage.downloads import Prefetcher
from seaclutter_cli.storage.locations import Url, is_url, location
from seaclutter_cli.storage.mirrors import Mirror, skeleton
from seaclutter_cli.storage.objects import StoredObject, find_object, is_folder_of_objects, list_objects, read_range

_WORTH_AN_EXCERPT = 16 * 2**20
_MAGIC = re.compile(r"[*?\[]")


@dataclass(frozen=True)
class RemoteRecording(Recording):
    """A recording in object storage; `open` copies it.

    Parameters
    ----------
    paths : tuple of Url
        Object or folder of objects, or several objects in order.
    title : str
        Name of the recording.
    base : Url
        Folder that contains all of its objects.
    objects : tuple of StoredObject
        Its objects, and those that belong to it, as metadata of a sensor.
    frame_folder : bool
        Whether it is a folder of frames.
    prefetcher : Prefetcher
        Fetches the recordings of a run in their order.
    search : Search
        How it was found.
    """

    title: str
    base: Url
    objects: tuple[StoredObject, ...]
    frame_folder: bool
    prefetcher: Prefetcher = field(compare=False, repr=False)
    search: Search = field(default_factory=Search)

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.title

    @property
    def size(self) -> int:
        """Size of its objects in bytes."""
        return sum(one.size for one in self.objects)

    @property
    def is_frame_folder(self) -> bool:
        """Whether the recording is a folder of frames."""
        return self.frame_folder

    def open(self, *, rate_hz: float = 10.0, decoding: DecoderOptions | None = None) -> Source:
        """Copy the recording and open the copy."""
        download = self.prefetcher.take(self.base, self.objects)
        mirror = download.mirror
        try:
            with mirror.naming():
                copies = tuple(mirror.local(url) for url in self.paths if isinstance(url, Url))
                if self.search.join is None:
                    require_one(copies)
                source = Recording(copies).open(rate_hz=rate_hz, decoding=decoding)
        except BaseException:
            download.remove()
            raise
        return StagedSource(source, mirror, lambda: self.prefetcher.give_back(download), copies)

    def excerpt(self) -> "RemoteExcerpt | None":
        """Return the first frames of a large MCAP file and its summary, without copying the rest.

        None if the recording is something else, or its summary cannot be used.
        """
        found = self.objects[0]
        if len(self.objects) > 1 or found.url != self.paths[0] or found.size < _WORTH_AN_EXCERPT:
            return None
        part = excerpt(lambda start, stop: read_range(found, start, stop), found.size)
        return RemoteExcerpt(self.paths, self.title, part) if part else None


@dataclass(frozen=True)
class RemoteExcerpt(Recording):
    """First frames of a recording in object storage.

    Parameters
    ----------
    title : str
        Name of the recording.
    part : Excerpt
        The frames, and the summary of the recording.
    """

    title: str
    part: Excerpt

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.title

    def open(self, *, rate_hz: float = 10.0, decoding: DecoderOptions | None = None) -> Source:
        """Open the excerpt."""
        url = self.paths[0]
        assert isinstance(url, Url)  # noqa: S101 - made from one
        mirror = Mirror(url.parent)
        try:
            file = mirror.local(url)
            file.write_bytes(self.part.data)
            with mirror.naming():
                source = Recording((file,)).open(rate_hz=rate_hz, decoding=decoding)
        except BaseException:
            mirror.folder.remove()
            raise
        return StagedSource(source, mirror, mirror.folder.remove)


class StagedSource:
    """A copy of a recording as a `Source` that names the objects.

    Parameters
    ----------
    inner : Source
        The copy.
    mirror : Mirror
        Holds the copy.
    release : callable
        Called when the copy is closed.
    copies : tuple of Path, optional
        Copies of the paths of the recording, if all of it was copied.
    """

    def __init__(
        self, inner: Source, mirror: Mirror, release: Callable[[], object], copies: tuple[Path, ...] = ()
    ) -> None:
        self._inner, self._mirror, self._release = inner, mirror, release
        self.copies = copies
        self.name, self.format = inner.name, inner.format
        self.profile, self.compression = inner.profile, inner.compression
        self.damage: list[Damage] = []
        self.warnings: list[str] = []
        self._update()

    def _update(self) -> None:
        mirror = self._mirror
        self.damage[:] = [_named(item, mirror) for item in self._inner.damage]
        self.warnings[:] = [mirror.shown(text) for text in self._inner.warnings]

    @property
    def metadata(self) -> Sequence[Metadata]:
        """Metadata records of the copy."""
        return self._inner.metadata

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels of the copy."""
        return self._inner.channels

    @property
    def counts(self) -> dict[int, int]:
        """Counts of the copy."""
        return self._inner.counts

    @property
    def facts(self) -> Mapping[str, SensorFacts]:
        """Facts from the copy."""
        return self._inner.facts

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield the records of the copy."""
        try:
            with self._mirror.naming():
                yield from self._inner.records(start_ns, end_ns)
        finally:
            self._update()

    def skipped(self, start_ns: int) -> Mapping[int, int]:
        """Return the numbers of messages that `records` leaves out."""
        with self._mirror.naming():
            return self._inner.skipped(start_ns)

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message of the copy."""
        with self._mirror.naming():
            return self._inner.span_ns

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels of the copy."""
        with self._mirror.naming():
            return self._inner.latest(channels, before_ns)

    def close(self) -> None:
        """Close the copy; that of a recording is removed when the next is needed, or at the end of the run."""
        self._inner.close()
        self._release()


def _named(item: Damage, mirror: Mirror) -> Damage:
    if isinstance(item.path, Path) and mirror.path in item.path.parents:
        return replace(item, path=mirror.url(item.path))
    return item


def find_anywhere(
    patterns: Iterable[str],
    search: Search | None = None,
    note: Callable[[str], object] = lambda _: None,
    *,
    ahead: bool = True,
) -> list[Recording]:
    """Return the recordings that names, folders and globs refer to, here or in object storage.

    Parameters
    ----------
    patterns : iterable of str
        Names, folders and globs.
    search : Search, optional
        How folders are searched. Numbered objects are joined by their names; if their times and topics do not fit,
        opening them is an error.
    note : callable, optional
        Receives lines about what is joined or left out.
    ahead : bool, optional
        Whether opening one begins to copy the next.

    Raises
    ------
    UsageError
        If a glob or a folder contains no recording, or a path or object does not exist.
    InputError
        If there is no such bucket, or no access.
    """
    prefetcher, search = Prefetcher(), search or Search()
    found: dict[object, Recording] = {}
    for pattern in patterns:
        place = location(pattern) if is_url(pattern) else None
        if isinstance(place, Url):
            recordings: Sequence[Recording] = _find(place, prefetcher, search, note)
        else:
            recordings = find_recordings([pattern], search, note)
        for recording in recordings:
            found.setdefault(recording.key, recording)
    for recording in found.values():
        if ahead and isinstance(recording, RemoteRecording):
            prefetcher.add(recording.base, recording.objects)
    return list(found.values())


def _find(url: Url, prefetcher: Prefetcher, search: Search, note: Callable[[str], object]) -> list[RemoteRecording]:
    base, pattern, objects = _look_up(url)
    mirror = skeleton(base, objects)
    try:
        with mirror.naming():
            is_glob = _MAGIC.search(pattern) and not (mirror.path / pattern).exists()
            root = escape(str(mirror.path)) if is_glob else str(mirror.path)
            found = find_recordings([f"{root}/{pattern}"], search, lambda text: note(mirror.shown(text)))
        return [_remote(recording, mirror, objects, prefetcher, search) for recording in found]
    finally:
        mirror.folder.remove()


def _look_up(url: Url) -> tuple[Url, str, list[StoredObject]]:
    """Return a folder, a name or pattern in it, and the objects that may belong to what these denote."""
    found = find_object(url)
    if found is not None:
        beside = list_objects(url.parent, deep=False) if has_metadata_beside(url.name) else ()
        return url.parent, url.name, list({one.url: one for one in (found, *beside)}.values())
    if not _MAGIC.search(url.key) or is_folder_of_objects(url):
        objects = list(list_objects(url))
        if not objects:
            raise UsageError(f"{url}: no such object or folder")
        return url.parent, url.key.rpartition("/")[2], objects
    parts = url.key.split("/")
    fixed = next(number for number, part in enumerate(parts) if _MAGIC.search(part))
    base, wanted = Url(url.scheme, url.bucket, "/".join(parts[:fixed])), parts[fixed:]
    metadata = tuple(CALIBRATION_SUFFIXES.values())
    objects = [one for one in list_objects(base) if _begins_as(one.url, base, wanted) or one.url.suffix in metadata]
    if not objects:
        raise UsageError(f"{url}: no file matches this pattern")
    return base, "/".join(wanted), objects


def _begins_as(url: Url, base: Url, wanted: Sequence[str]) -> bool:
    """Return whether the first parts of a name below a folder match those of a pattern, as far as there are any."""
    parts = url.key[len(base.key) :].removeprefix("/").split("/")
    fixed = takewhile(lambda part: part != "**", wanted)
    return all(fnmatchcase(part, one) for part, one in zip(parts, fixed, strict=False))


def _remote(
    recording: Recording, mirror: Mirror, objects: Sequence[StoredObject], prefetcher: Prefetcher, search: Search
) -> RemoteRecording:
    files = [path for path in recording.paths if isinstance(path, Path)]
    wanted = {*files, *(beside for file in files for beside in metadata_beside(file))}
    is_folder = files[0].is_dir()
    own = [
        one
        for one in objects
        if (path := mirror.local(one.url)) in wanted or (is_folder and files[0] in path.parents and path.is_file())
    ]
    first = mirror.url(files[0])
    base = first if is_folder and not first.key else first.parent
    urls = tuple(map(mirror.url, files))
    title = first.name if is_folder else recording.name
    return RemoteRecording(
        urls, title, base, tuple(own), recording.is_frame_folder, prefetcher, search, inside=recording.inside
    )
