"""The record of a run in its output, by which a later run recognises it."""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli import __version__
from seaclutter_cli.buckets import mirror_of
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import InputError
from seaclutter_cli.frame import Rings
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.records import Damage

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


def digest_of_paths(paths: Iterable[Path]) -> str:
    """Return a digest of files by their sizes, and first and last MiB; of folders, by their files and names.

    Of more than 64 files, names and sizes are enough. Objects have the digest that their copies would have.

    Raises
    ------
    InputError
        If a file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        found = [file for path in paths for file in _files(path)]
        for name, path in found:
            mirror = mirror_of(path)
            if mirror and len(found) <= _MAX_DIGESTS:
                mirror.fetch_ends(path)
            size = path.stat().st_size
            digest.update(os.fsencode(f"{name}\0{size}\0"))  # the same in every locale
            if len(found) <= _MAX_DIGESTS:
                digest.update(hashlib.sha256(_ends(path, size)).digest())
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror})") from error
    return digest.hexdigest()


def _files(path: Path) -> list[tuple[str, Path]]:
    """Return a file, or those in a folder, with their names in it."""
    if mirror := mirror_of(path):
        mirror.know(path)
    inside = sorted(path.rglob("*")) if path.is_dir() else [path]
    return [
        ("" if one == path else one.relative_to(path).as_posix(), one) for one in inside if one == path or one.is_file()
    ]


def _ends(path: Path, size: int) -> bytes:
    with path.open("rb") as file:
        first = file.read(_MIB)
        file.seek(max(size - _MIB, 0))
        return first + file.read(_MIB)


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


def from_entries(entries: Mapping[str, str], paths: Iterable[Path]) -> tuple[dict[str, TopicTally], list[Damage]]:
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
