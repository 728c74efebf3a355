"""The record of a run in its output, by which a later run recognises it."""

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli import __version__
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import InputError
from seaclutter_cli.frame import Rings
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.records import Damage
from seaclutter_cli.storage.locations import Location, Url
from seaclutter_cli.storage.objects import find_object, list_objects, read_range

NAME = "seaclutter.run"
"""Name of the metadata record in a filtered MCAP file."""

_MIB = 2**20
_MAX_DIGESTS = 64
_PARTS = {
    "version": "another version of seaclutter",
    "input": "another input",
    "config": "another configuration",
    "options": "other options",
    "labels": "other labels",
}


@dataclass(frozen=True)
class RunIdentity:
    """What the bytes of an output depend on.

    Parameters
    ----------
    input : str
        Digest of the sizes, and first and last MiB of the files of the recording.
    config, options, labels : str
        Digests of the effective configuration with its models, of all other options, and of the labels.
    version : str
        Version of the program.
    """

    input: str
    config: str
    options: str
    labels: str
    version: str = __version__

    def difference(self, other: Mapping[str, str]) -> str | None:
        """Return how a record differs; None if it is of the same run."""
        own = asdict(self)
        return next((text for part, text in _PARTS.items() if other.get(part) != own[part]), None)


def digest_of_paths(paths: Iterable[Location]) -> str:
    """Return a digest of files by their sizes, and first and last MiB; of folders, by their files and names.

    Of more than 64 files, names and sizes are enough. Objects have the digest that their copies would have.

    Raises
    ------
    InputError
        If a file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        found = [file for place in paths for file in _files(place)]
        for file in found:
            digest.update(os.fsencode(f"{file.name}\0{file.size}\0"))  # the same in every locale
            if len(found) <= _MAX_DIGESTS:
                ends = file.read(0, _MIB) + file.read(max(file.size - _MIB, 0), file.size)
                digest.update(hashlib.sha256(ends).digest())
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror})") from error
    return digest.hexdigest()


@dataclass(frozen=True)
class _File:
    """A file or an object: its name within what was given, its size, and a function that reads from it."""

    name: str
    size: int
    read: Callable[[int, int], bytes]


def _files(place: Location) -> list[_File]:
    if isinstance(place, Url):
        found = find_object(place)
        inside = [] if found else sorted(list_objects(place), key=lambda one: one.url.key.split("/"))
        start = len(place.key) + 1 if place.key else 0
        return [
            _File(one.url.key[start:], one.size, partial(read_range, one)) for one in ([found] if found else inside)
        ]
    inner = sorted(place.rglob("*")) if place.is_dir() else [place]
    return [
        _File("" if path == place else path.relative_to(place).as_posix(), path.stat().st_size, partial(_read, path))
        for path in inner
        if path == place or path.is_file()
    ]


def _read(path: Path, start: int, stop: int) -> bytes:
    with path.open("rb") as file:
        file.seek(start)
        return file.read(stop - start)


def digest_of(value: Any) -> str:
    """Return a digest of JSON-compatible data; other values count by their text."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


def to_entries(identity: RunIdentity, topics: Mapping[str, TopicTally], damage: Iterable[Damage]) -> dict[str, str]:
    """Return the entries of the metadata record of a run."""
    outcome = {
        "topics": {topic: _tally_to_json(tally) for topic, tally in topics.items()},
        "damage": [{**asdict(item), "path": item.path.name} for item in damage],
    }
    return {**asdict(identity), "outcome": json.dumps(outcome, sort_keys=True)}


def from_entries(entries: Mapping[str, str], paths: Iterable[Location]) -> tuple[dict[str, TopicTally], list[Damage]]:
    """Return the sums over the frames of each topic, and the damage, that a record contains.

    Parameters
    ----------
    entries : mapping of str to str
        Entries of the record.
    paths : iterable of Path
        Files of the recording.

    Raises
    ------
    ValueError
        If the record is not complete.
    """
    by_name = {path.name: path for path in paths}
    try:
        outcome = load_json(entries["outcome"])
        topics = {topic: _tally_from_json(tally) for topic, tally in outcome["topics"].items()}
        damage = [
            Damage(**{**item, "path": by_name.get(item["path"], Path(item["path"]))}) for item in outcome["damage"]
        ]
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"incomplete record: {error!r}") from error
    return topics, damage


def _tally_to_json(tally: TopicTally) -> dict[str, Any]:
    rings = tally.rings
    return {
        "frames": tally.frames,
        "points_in": tally.points_in,
        "counts": tally.counts.tolist(),
        "rings": None if rings is None else {item.name: getattr(rings, item.name).tolist() for item in fields(rings)},
        "scenes": dict(sorted(tally.scenes.items())),
        "water": tally.water.tolist(),
        "water_frames": tally.water_frames,
    }


def _tally_from_json(stored: Mapping[str, Any]) -> TopicTally:
    tally = TopicTally(frames=stored["frames"], points_in=stored["points_in"], water_frames=stored["water_frames"])
    tally.counts, tally.water = np.array(stored["counts"], np.int64), np.array(stored["water"], np.float64)
    tally.scenes.update(stored["scenes"])
    if stored["rings"] is not None:
        tally.rings = Rings(**{name: np.array(values) for name, values in stored["rings"].items()})
    return tally
