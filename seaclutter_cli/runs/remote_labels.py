"""Labels in object storage: copied when they are assigned to recordings."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from seaclutter_cli.errors import UsageError
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.storage.downloads import Download
from seaclutter_cli.storage.locations import Location, Url
from seaclutter_cli.storage.mirrors import Mirror, skeleton
from seaclutter_cli.storage.objects import StoredObject, find_object, list_objects
from seaclutter_cli.truth import Truth


@dataclass(frozen=True)
class StagedLabels:
    """Copied labels as `Labels` that name the objects.

    Parameters
    ----------
    inner : Labels
        The copies.
    download : Download
        Holds them.
    copy : Path
        The copied file or folder.
    """

    inner: Labels
    download: Download
    copy: Path

    def truth(self, frame: Frame) -> Truth | None:
        """Return the truth of a frame."""
        with self.download.mirror.naming():
            return self.inner.truth(frame)

    def finish(self) -> None:
        """Check that no label is left."""
        with self.download.mirror.naming():
            self.inner.finish()


@dataclass
class _Listing:
    """Objects below one of the given URLs, and a skeleton of them."""

    objects: Sequence[StoredObject]
    mirror: Mirror
    chosen: list[Path] = field(default_factory=list)

    def copied(self) -> Download:
        """Return copies of the chosen files and folders."""
        chosen = set(self.chosen)
        wanted = [(one, self.mirror.local(one.url)) for one in self.objects]
        return Download(self.mirror.base, [one for one, path in wanted if not chosen.isdisjoint((path, *path.parents))])


class LabelFinder:
    """Local stand-ins for the places of labels, which the assignment to recordings works on; then labels from copies.

    Parameters
    ----------
    places : sequence of Path or Url
        Files and folders of labels.

    Raises
    ------
    UsageError
        If there is no such object.
    """

    def __init__(self, places: Sequence[Location]) -> None:
        self._listings: list[_Listing] = []
        self.paths = [place if isinstance(place, Path) else self._look_up(place) for place in places]

    def _look_up(self, url: Url) -> Path:
        found = find_object(url)
        objects = [found] if found else list(list_objects(url))
        if not objects:
            raise UsageError(f"{url}: no such object or folder of labels")
        self._listings.append(_Listing(objects, skeleton(url.parent, objects)))
        return self._listings[-1].mirror.local(url)

    @contextmanager
    def naming(self) -> Iterator[None]:
        """Let errors name URLs, not the paths that stand for them."""
        with ExitStack() as stack:
            for listing in self._listings:
                stack.enter_context(listing.mirror.naming())
            yield

    def places(self, found: Sequence[Path]) -> list[Location]:
        """Return the places for which some of the paths stand; without copying anything."""
        listings = [self._listing(path) for path in found]
        places = [path if one is None else one.mirror.url(path) for path, one in zip(found, listings, strict=True)]
        for listing in self._listings:
            listing.mirror.folder.remove()
        return places

    def open(self, found: Sequence[Path], open_one: Callable[[int, Path], Labels]) -> list[Labels]:
        """Return the labels at some of the paths, by a function of their number and a local path."""
        where = [self._listing(path) for path in found]
        for path, listing in zip(found, where, strict=True):
            if listing is not None:
                listing.chosen.append(path)
        copies = {id(listing): listing.copied() for listing in where if listing is not None}
        opened: list[Labels] = []
        for number, (path, listing) in enumerate(zip(found, where, strict=True)):
            if listing is None:
                opened.append(open_one(number, path))
                continue
            download = copies[id(listing)]
            mirror = download.wait()
            copy = mirror.local(listing.mirror.url(path))
            with mirror.naming():
                inner = open_one(number, copy)
            opened.append(StagedLabels(inner, download, copy))
        for listing in self._listings:
            listing.mirror.folder.remove()
        return opened

    def _listing(self, path: Path) -> _Listing | None:
        return next((one for one in self._listings if one.mirror.path in path.parents), None)
