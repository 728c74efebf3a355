"""Going on where a run stopped: the record of a run in its output, by which a later run recognises it."""

import hashlib
import json
import os
from abc import abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from time import time
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader

from seaclutter_cli import __version__
from seaclutter_cli.buckets import copies_removed, mirror_of
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import InputError, OutputError, SeaclutterError, UsageError
from seaclutter_cli.frame import WATER_COLUMNS, Reason, Rings
from seaclutter_cli.paths import open_regular
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.records import Damage, Metadata
from seaclutter_cli.registry import packages
from seaclutter_cli.runs.batch import RecordingWork, Work
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options import ReadOptions
from seaclutter_cli.runs.recordings import O, open_recording
from seaclutter_cli.sinks.options import McapOptions
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.threads import in_threads

if TYPE_CHECKING:  # imports all filters, which tiles do not need
    from seaclutter_cli.config import Config

_MIB = 2**20
_MAX_COUNT = 2**53
_MAX_DIGESTS = 64
_PARTS = {
    "version": "another version of seaclutter",
    "input": "another input",
    "config": "another configuration",
    "options": "other options",
    "labels": "other labels",
    "method": "another version of the method",
    "plugins": "other packages with plug-ins",
}

_SUMS = ("frames", "points_in", "counts", "rings", "scenes", "water", "water_frames")
"""Fields of a tally in a record."""

_LATER = ("split", "include", "exclude")
"""Fields that count only if they are set, so that the records of earlier versions stay valid."""


def run_identity(*, method: str = "", **digests: str) -> dict[str, str]:
    """Return what the bytes of an output depend on, as entries of a record: digests, and the version of the program.

    The digest of the code of a ``method`` that is not registered, and the packages that add something with their
    versions, are entries only if there are any.
    """
    more = {"method": method, "plugins": ", ".join(packages())}
    return {**digests, "version": __version__, **{name: text for name, text in more.items() if text}}


def identity_of(
    work: RecordingWork[Any], written: McapOptions, config: "Config | None", **others: Any
) -> dict[str, str]:
    """Return what the output of work on a recording depends on; ``others`` are options.

    Digests are of the sizes, and beginnings and ends of the files of the recording; of the effective configuration with
    its models, of all other options, and of the labels.
    """
    named = [getattr(config.filter, key, None) for key in ("scene_model", "mask")] if config else []
    files = [Path(name) for name in named if name and Path(name).is_file()]
    reading, labels = work.reading, work.labels
    # What came later counts only if it is given, for equal bytes of earlier versions.
    read = {name: value for name, value in asdict(reading).items() if name not in ("columns", "merge") or value}
    options = {
        "reading": {**read, "calibration": digest_of_paths(reading.beside()) if reading.beside() else None},
        "written": {
            k: v
            for k, v in vars(written).items()
            if k not in ("as_is", "config", "water", "scene", "objects", "record", "method") and (v or k not in _LATER)
        },
        **others,
    }
    label_parts = [digest_of_paths([labels.path]), asdict(labels.options)] if labels else []
    return run_identity(
        input=digest_of_paths(work.recording.paths),
        config=digest_of([config.as_dict(), digest_of_paths(files)] if config else []),
        options=digest_of(options),
        labels=digest_of(label_parts),
        method=getattr(config.method, "code", "") if config else "",
    )


class RecordedWork(Work[O]):
    """Work whose output has a record of its run, by which a later run recognises it."""

    verb: ClassVar[str] = "filtered"
    """What was done, in messages."""
    options: Any
    """Those of the run: at least ``force``."""

    @abstractmethod
    def identity(self) -> Mapping[str, str]:
        """Return what the output depends on."""

    @abstractmethod
    def records(self) -> Sequence[Mapping[str, Any]]:
        """Return the records of runs in the output, the last one of which counts."""

    @abstractmethod
    def restore(self, outcome: O, record: Mapping[str, Any]) -> str | None:
        """Store what a record has in an outcome; return what the earlier run left out, if anything."""

    def earlier(self) -> tuple[O | None, str]:
        """Return the outcome of an earlier run whose output is complete; otherwise None, and what differs if any.

        No file that it read may have been changed since. Raise `UsageError` if the output is not that of a run, and may
        not be replaced.
        """
        if not self.writes[0].exists():
            return None, ""
        try:
            record = self._record()
        except UsageError:
            if self.options.force:
                return None, ""
            raise
        outcome = self.without_result(None)
        outcome.skipped = True
        try:
            own = self.identity()
            difference = next((text for part, text in _PARTS.items() if record.get(part) != own.get(part)), None)
            difference = difference or self.restore(outcome, record)
        except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
            difference = f"incomplete record: {error!r}"
        if not difference and _changed_after(self.reads, self.writes[0]):
            difference = "an input that was changed since"
        return (None, f"the earlier output is of {difference}") if difference else (outcome, "")

    def _record(self) -> Mapping[str, Any]:
        output, remedy = self.writes[0], "use --force to replace it"
        try:
            found = self.records()
        except (McapError, SeaclutterError, OSError, ValueError, EOFError) as error:
            kind = "log" if self.noun == "recording" else self.noun
            raise UsageError(f"{output}: not a {self.verb} {kind}, not replaced ({error}); {remedy}") from error
        if not found:
            raise UsageError(f"{output}: without a record of its run, not replaced; {remedy}")
        return found[-1]


def earlier_outcomes(works: Sequence[RecordedWork[O]], observer: Observer) -> list[O | None]:
    """Return the outcomes of earlier runs whose outputs are complete; None for recordings that must be done again."""

    def look(work: RecordedWork[O]) -> tuple[O | None, str]:
        with copies_removed():
            return work.earlier()

    found = in_threads(look, works)
    for work, (outcome, difference) in zip(works, found, strict=True):
        if difference:
            observer.note(f"{work.recording.name}: {work.verb} again; {difference}")
        if outcome is not None:
            observer.damage(outcome.damage)
    return [outcome for outcome, _ in found]


@contextmanager
def same_output_accepted(work: Work[O]) -> Iterator[None]:
    """Accept an output that another process has completed, which died or was given up before its answer came."""
    try:
        yield
    except OutputError:
        with suppress(UsageError, OSError):  # not an output of a run, or none at all
            if isinstance(work, RecordedWork) and not mirror_of(work.writes[0]) and work.earlier()[0] is not None:
                return
        raise


def metadata_in(output: Path) -> list[Metadata]:
    """Return the metadata records in a log. Of an MCAP file, only the end is read."""
    if output.suffix.lower() != ".mcap" or output.is_dir():
        with closing(open_recording(Recording((output,)), ReadOptions())) as source:
            return list(source.metadata)
    mirror = mirror_of(output)
    with mirror.open(output) if mirror else open_regular(output) as stream:
        return [Metadata(record.name, record.metadata) for record in make_reader(stream).iter_metadata()]


def digest_of_paths(paths: Iterable[Path]) -> str:
    """Return a digest of files by their sizes, and first and last MiB; of folders, by their files and names.

    Of more than 64 files, the beginnings and ends are shorter, 128 MiB together. Objects have the digest that their
    copies would have; of more than 64, what identifies their content for the service counts instead.

    Raise `InputError` if a file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        found = [file for path in paths for file in _files(path)]
        length = _MIB * _MAX_DIGESTS // max(len(found), _MAX_DIGESTS)
        for name, path in found:
            mirror = mirror_of(path)
            size = path.stat().st_size
            digest.update(os.fsencode(f"{name}\0{size}\0"))  # the same in every locale
            if mirror and length < _MIB:
                digest.update(f"{mirror.version(path)}\0".encode())
                continue
            if mirror:
                mirror.fetch_ends(path)
            digest.update(hashlib.sha256(_ends(path, size, length)).digest())
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror})") from error
    return digest.hexdigest()


def _files(path: Path) -> list[tuple[str, Path]]:
    if mirror := mirror_of(path):
        mirror.know(path)
    inside = sorted(path.rglob("*")) if path.is_dir() else [path]
    return [
        ("" if one == path else one.relative_to(path).as_posix(), one) for one in inside if one == path or one.is_file()
    ]


def _ends(path: Path, size: int, length: int) -> bytes:
    with path.open("rb") as file:
        first = file.read(length)
        file.seek(max(size - length, 0))
        return first + file.read(length)


def _changed_after(paths: Iterable[Path], output: Path) -> bool:
    """Return whether a local file, or one in a folder, was changed after an output was complete; not in the future."""
    if mirror_of(output):
        return False
    written = max((file.stat().st_mtime for file in ([output] if output.is_file() else output.iterdir())), default=0.0)
    now = time()
    files = (file for path in paths if not mirror_of(path) for _, file in _files(path))
    return any(written < file.stat().st_mtime <= now for file in files)


def digest_of(value: Any) -> str:
    """Return a digest of JSON-compatible data; other values count by their text."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


def outcome_entry(topics: Mapping[str, TopicTally], damage: Iterable[Damage]) -> dict[str, str]:
    """Return the entry of a record with the sums over the frames of each topic, and the damage."""
    outcome = {
        "topics": {topic: _tally_as_json(tally) for topic, tally in topics.items()},
        "damage": [{**asdict(item), "path": item.path.name} for item in damage],
    }

    def as_json(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray) else vars(value)

    return {"outcome": json.dumps(outcome, sort_keys=True, default=as_json)}


def from_entries(entries: Mapping[str, str], paths: Iterable[Path]) -> tuple[dict[str, TopicTally], list[Damage]]:
    """Return the sums over the frames of each topic, and the damage, that the entries of a record contain.

    ``paths`` are the files of the recording.
    """
    by_name = {path.name: path for path in paths}
    outcome = load_json(entries["outcome"])
    topics = {topic: _tally_from_json(tally) for topic, tally in outcome["topics"].items()}
    return topics, [_damage_from_json(item, by_name) for item in outcome["damage"]]


def _tally_as_json(tally: TopicTally) -> dict[str, Any]:
    sums = {name: getattr(tally, name) for name in _SUMS}
    end = None if tally.counts[Reason.MIRRORED] else Reason.MIRRORED  # as written before there was this reason
    undecided = {"undecided": tally.undecided.reshape(-1)} if tally.undecided.any() else {}
    return {**sums, **undecided, "counts": tally.counts[:end]}


def _damage_from_json(stored: Mapping[str, Any], by_name: Mapping[str, Path]) -> Damage:
    _require_counts(stored["offset"] or 0, stored["lost_messages"] or 0, stored["lost_bytes"])
    path = by_name.get(stored["path"], Path(stored["path"]))
    return Damage(**{**stored, "path": path, "problem": str(stored["problem"])})


def _tally_from_json(stored: Mapping[str, Any]) -> TopicTally:
    counts, rings, scenes = _array(stored["counts"], "i"), stored["rings"], dict(stored["scenes"])
    numbers = {name: stored[name] for name in ("frames", "points_in", "water_frames")}
    _require_counts(*numbers.values(), *scenes.values())
    tally = TopicTally(**numbers, water=_array(stored["water"], "if"), scenes=Counter(scenes))
    if not 0 <= len(tally.counts) - len(counts) <= 1 or len(tally.water) != len(WATER_COLUMNS):
        raise ValueError("numbers are missing")
    tally.counts[: len(counts)] = counts
    tally.undecided[:] = _array(stored.get("undecided", [0] * tally.undecided.size), "i").reshape(tally.undecided.shape)
    if rings is not None:
        tally.rings = Rings(**{name: _array(values, "if") for name, values in rings.items()})
        sizes = {len(values) for name, values in vars(tally.rings).items() if name != "beyond"}
        if len(sizes) != 1 or len(tally.rings.beyond) != len(("before", "after")):
            raise ValueError("numbers are missing")
    return tally


def _require_counts(*values: Any) -> None:
    if not all(type(value) is int and 0 <= value < _MAX_COUNT for value in values):
        raise ValueError("not a count")


def _array(values: Any, kinds: str) -> Any:
    """Return numbers of a record, an array of one dimension and of one of some kinds."""
    array = np.array(values)
    if array.ndim != 1 or array.dtype.kind not in kinds or (np.abs(array) >= _MAX_COUNT).any():
        raise ValueError("not a row of numbers")
    return array
