"""Folders that mirror a part of a bucket, so that code for local files can work on objects."""

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from seaclutter_cli.errors import InputError, SeaclutterError
from seaclutter_cli.storage.locations import Url
from seaclutter_cli.storage.objects import StoredObject, read_range
from seaclutter_cli.storage.scratch import ScratchFolder

_FORBIDDEN = re.compile(r'[\0/\\:*?"<>|]' if os.name == "nt" else r"[\0/]")
_HEAD_BYTES = 4096
_TOLD_BY_CONTENT = (".csv", ".yaml")


class Mirror:
    """A scratch folder in which the objects below a URL have the paths that they have there.

    Parameters
    ----------
    base : Url
        Folder of objects that the scratch folder stands for.
    """

    def __init__(self, base: Url) -> None:
        self.base = base
        self.folder = ScratchFolder()

    @property
    def path(self) -> Path:
        """The scratch folder."""
        return self.folder.path

    def local(self, url: Url) -> Path:
        """Return the path that stands for a URL; raise `InputError` if no file of this system can have its name."""
        parts = _below(url, self.base)
        if any(
            part in (".", "..") or os.sep in part or "\0" in part or (os.name == "nt" and ":" in part) for part in parts
        ):
            raise InputError(f"{url}: files of this system cannot have this name")
        return self.path.joinpath(*parts)

    def url(self, path: Path) -> Url:
        """Return the URL that a path stands for."""
        url = self.base
        for part in path.relative_to(self.path).parts:
            url /= part
        return url

    def shown(self, text: str) -> str:
        """Return text with URLs in place of the paths that stand for them."""
        base = str(self.base)
        return text.replace(f"{self.path}{os.sep}", base if base.endswith("/") else f"{base}/")

    @contextmanager
    def naming(self) -> Iterator[None]:
        """Let errors name URLs, not the paths that stand for them."""
        try:
            yield
        except SeaclutterError as error:
            error.args = tuple(self.shown(one) if isinstance(one, str) else one for one in error.args)
            raise


def _below(url: Url, base: Url) -> list[str]:
    return [part for part in url.key[len(base.key) :].split("/") if part]


def skeleton(base: Url, objects: Iterable[StoredObject]) -> Mirror:
    """Return a mirror of empty files, which shows what the objects are by their names.

    Files whose names do not suffice, tables and metadata, have the first bytes of the first such object in a folder.
    """
    mirror = Mirror(base)
    known: set[tuple[Path, str]] = set()
    for found in objects:
        file = mirror.local(found.url)
        kind = (file.parent, file.suffix.lower())
        head = b""
        if kind[1] in _TOLD_BY_CONTENT and kind not in known:
            known.add(kind)
            head = read_range(found, 0, _HEAD_BYTES)
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(head)
        except (FileExistsError, NotADirectoryError, IsADirectoryError):
            continue  # some tools mark folders by empty objects
        except OSError as error:
            raise InputError(f"{found.url}: the scratch folder cannot be used ({error.strerror})") from error
    return mirror
