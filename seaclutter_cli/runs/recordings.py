"""Runs over recordings: finding and opening them and their labels; outcomes, errors and warnings."""

import math
import os
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, fields, is_dataclass, replace
from datetime import UTC, datetime
from operator import attrgetter
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from seaclutter_cli.buckets import fetch, mirror_of
from seaclutter_cli.errors import FieldError, InputError, SeaclutterError, SelectionError, UsageError
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.options import Options
from seaclutter_cli.records import Channel, Damage, SensorFacts
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.options import Decoding, LabelSources, OfLabelledLogs, OfLogs, ReadOptions
from seaclutter_cli.selection import Selection
from seaclutter_cli.sensors.packets import CALIBRATION_SUFFIXES, DecoderOptions
from seaclutter_cli.sources.recordings import Recording, Search, find_recordings, has_metadata_beside, metadata_beside
from seaclutter_cli.sources.shared.integration import Integrated
from seaclutter_cli.text import count, duration, listed, printable

if TYPE_CHECKING:
    from seaclutter_cli.labels import LabelOptions

LABEL_SUFFIX = ".labels.csv"
MAX_NAMED = 10
"""Maximum number of names in a message."""
NOT_PROCESSED = "not processed"
"""Error of a recording that a run which stopped after an error did not come to."""
_STATUSES = ("done", "damaged", "failed", NOT_PROCESSED, "skipped", "do", "skip", "refuse")


def data_of(item: Any, names: str) -> dict[str, Any]:
    """Return attributes and results of methods as JSON-compatible data.

    ``names`` are those of attributes, or have a name and its attribute, as in ``frames=found.frames``.
    """
    pairs = (name.partition("=") for name in names.split())
    return {name: _plain(attrgetter(path or name)(item)) for name, _, path in pairs}


def _plain(value: Any) -> Any:
    if callable(value):
        value = value()
    if hasattr(value, "as_dict"):
        return value.as_dict()
    if isinstance(value, Path | Damage):
        return str(value)
    if is_dataclass(value):
        value = {one.name: getattr(value, one.name) for one in fields(value)}
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


class WithData:
    """Base of classes whose data are attributes: those that ``data`` names, in the form of `data_of`."""

    data: ClassVar[str] = ""

    def as_dict(self) -> Any:
        """Return JSON-compatible data."""
        return data_of(self, self.data)


@dataclass(kw_only=True)
class Outcome(WithData):
    """Outcome of a run over one recording, by its name.

    ``damage`` are parts that could not be used; ``error`` says why there is no result. If ``skipped``, the result is
    that of an earlier run, or there is nothing to do, as ``reason`` says. ``facts`` are about the sensor of each topic,
    from packets or metadata. ``listed`` names columns of the manifest of a run, in the form of `data_of`.
    """

    data = "recording error damage"
    listed: ClassVar[str] = ""

    recording: str
    damage: list[Damage] = field(default_factory=list)
    seconds: float = 0.0
    error: str | None = None
    skipped: bool = False
    reason: str = ""
    facts: dict[str, SensorFacts] = field(default_factory=dict, repr=False)

    @property
    def has_nothing(self) -> bool:
        """Whether the recording has no frame in the selected time."""
        return self.skipped and bool(self.reason)

    @property
    def status(self) -> str:
        """How the run over the recording ended: ``done``, ``damaged``, ``failed`` or ``skipped``."""
        if self.skipped:
            return "skipped"
        return "failed" if self.error else "damaged" if self.damage else "done"

    @property
    def rounded_s(self) -> float:
        """Duration in seconds, rounded to milliseconds."""
        return round(self.seconds, 3)

    def manifest_rows(self) -> list[dict[str, Any]]:
        """Return what the manifest has about the outcome beside its status, in rows."""
        return [data_of(self, self.listed)]

    def line(self) -> str:
        """Return a line about the outcome, for runs over several recordings."""
        if self.error:
            return f"{printable(self.recording)}: failed: {self.error}"
        if self.has_nothing:
            return f"{printable(self.recording)}: skipped: {self.reason}"
        more = f" and {count(len(self.damage) - 1, 'other part')}" if len(self.damage) > 1 else ""
        damaged = f"; damaged: {self.damage[0]}{more}" if self.damage else ""
        return f"{printable(self.recording)}: {self.figures()}{damaged}"

    def figures(self) -> str:
        """Return the main figures of the outcome, for a line about it."""
        return f"{self.seconds:.1f} s"

    def as_text(self) -> str:
        """Return the outcome as human-readable text; empty if the text of the result says it all."""
        return ""


O = TypeVar("O", bound=Outcome)  # noqa: E741 - an outcome


class Result(ABC, WithData):
    """Result of a run, as text and as data."""

    is_summary: ClassVar[bool] = False
    """Whether the text sums up what was written to files, so that quiet output leaves it out."""

    @property
    def failed(self) -> bool:
        """Whether any recording could not be processed."""
        return False

    @property
    def damaged(self) -> bool:
        """Whether parts of the input were damaged and left out."""
        return False

    @abstractmethod
    def as_text(self) -> str:
        """Return the result as human-readable text; empty if there is nothing to report."""

    def details(self) -> str:
        """Return the details of several recordings as text, which verbose output shows first."""
        return ""

    def as_detailed_text(self) -> str:
        """Return the result with its details, as verbose output shows it."""
        return "\n\n".join(filter(None, dict.fromkeys((self.details(), self.as_text()))))


@dataclass(frozen=True)
class RecordingsResult(Result, Generic[O]):
    """Result of a run over several recordings: the outcome of each."""

    outcomes: Sequence[O]

    @property
    def failed(self) -> bool:
        """Whether any recording could not be processed."""
        return any(outcome.error for outcome in self.outcomes)

    @property
    def damaged(self) -> bool:
        """Whether parts of any recording were damaged and left out."""
        return any(outcome.damage for outcome in self.outcomes)

    def as_dict(self) -> Any:
        """Return JSON-compatible data, by default the outcomes."""
        return super().as_dict() if self.data else [outcome.as_dict() for outcome in self.outcomes]

    def details(self) -> str:
        """Return the outcomes without an error as human-readable text."""
        done = (outcome for outcome in self.outcomes if not outcome.error and not outcome.has_nothing)
        return "\n\n".join(filter(None, (outcome.as_text() for outcome in done)))

    def as_text(self) -> str:
        """Return the result as human-readable text, by default its details."""
        return self.details()


def statuses(outcomes: Sequence[Outcome], before: str = "") -> str:
    """Return how many recordings ended in each way, with a word before it, such as ``1 done, 1 failed``."""
    found = Counter(one.error if one.error == NOT_PROCESSED else one.status for one in outcomes)
    return ", ".join(f"{found[status]:,} {before}{status}" for status in _STATUSES if found[status])


def expand(options: OfLogs, observer: Observer = SILENT, *, ahead: bool = True) -> list[Recording]:
    """Return the recordings in files, folders and globs, here or in object storage; see `find_recordings`.

    Those in object storage are fetched ahead, if ``ahead``: for a run that reads one after another completely.
    """
    search = Search(join=options.join, merge=options.merge, recursive=options.recursive)
    paths = [options.logs] if isinstance(options.logs, str | os.PathLike) else options.logs
    names, beside = [os.fspath(path) for path in paths], tuple(CALIBRATION_SUFFIXES.values())
    # Objects are looked up first, so that names and patterns can refer to them.
    names = [mirror.find(name, beside) if (mirror := mirror_of(Path(name))) else name for name in names]
    recordings = find_recordings(names, search, observer.note)
    files = [_files_of(recording) for recording in recordings if mirror_of(recording.paths[0])]
    if files and (mirror := mirror_of(files[0][0])):
        mirror.settle(files if ahead else ())
    return recordings


def _files_of(recording: Recording) -> list[Path]:
    """Return the paths of a recording, and the files beside them that belong to it."""
    for path in recording.paths:
        if has_metadata_beside(path.name) and (mirror := mirror_of(path)):
            mirror.look_beside(path)
    return [*recording.paths, *(beside for path in recording.paths for beside in metadata_beside(path))]


def assign_labels(sources: Options, recordings: Sequence[Recording]) -> list["LabelFile | None"]:
    """Return the labels of each recording, not yet read; None for all recordings if there are no paths.

    A function that needs labels leaves out recordings without: None for them, too. Raise `UsageError` if labels cannot
    be assigned to the recordings, or some do not exist.
    """
    if not isinstance(sources, LabelSources) or not sources.labels:
        return [None] * len(recordings)
    from seaclutter_cli.labels import LabelOptions  # not needed otherwise

    ids: dict[str, Any] = {"clutter_ids": sources.clutter_ids, "ignore_ids": sources.ignore_ids}
    chosen = LabelOptions(**{name: given for name, given in ids.items() if given is not None})
    for path in sources.labels:
        if mirror := mirror_of(path):
            mirror.know(path)
    found = find_labels(recordings, sources.labels, partly=isinstance(sources, OfLabelledLogs))
    each = zip(recordings, found, strict=True)
    return [LabelFile(path, replace(chosen, by_sequence=one.is_frame_folder)) if path else None for one, path in each]


@dataclass(frozen=True)
class LabelFile:
    """Labels of one recording, a file or a folder, and how they are read."""

    path: Path
    options: "LabelOptions"

    def open(self) -> Labels:
        """Return the labels; raise `LabelError` if they cannot be read."""
        from seaclutter_cli.labels import open_labels

        fetch(self.path)
        return open_labels(self.path, self.options)

    @property
    def is_by_order(self) -> bool:
        """Whether points have their labels by their order in the frame."""
        from seaclutter_cli.labels.point_labels import find_semantickitti

        return self.path.is_dir() and find_semantickitti(self.path) is not None


def find_labels(recordings: Sequence[Recording], paths: Sequence[Path], *, partly: bool = False) -> list[Path | None]:
    """Return the path of each recording's labels; raise `UsageError` if one is ambiguous or missing.

    If recordings may be labelled ``partly``, it is None for those whose labels are missing in a folder.
    """
    if len(paths) == 1 and paths[0].is_dir() and (found := _in_folder(recordings, paths[0], partly=partly)):
        return found
    if len(paths) != len(recordings):
        raise UsageError(
            f"{len(paths)} --labels for {count(len(recordings), 'recording')}: give one for each, in the same order, "
            f"or a folder with RECORDING{LABEL_SUFFIX} for each"
        )
    for path in paths:
        if not path.exists():
            raise UsageError(f"{path}: no such file or folder of labels")
    return [*paths]


def _in_folder(recordings: Sequence[Recording], folder: Path, *, partly: bool) -> list[Path | None]:
    """Return the labels in a folder; an empty list if the folder itself is the labels of a single recording."""
    found = [_named_in(folder, recording) for recording in recordings]
    known = [path for path in found if path]
    missing = [f"{one.name}{LABEL_SUFFIX}" for one, path in zip(recordings, found, strict=True) if not path]
    if missing and len(recordings) == 1:
        return []
    if missing and not (partly and known):
        some = "some" if known else "all"
        raise UsageError(f"{folder}: labels of {some} recordings are missing: {listed(missing, MAX_NAMED)}")
    if len(set(known)) < len(known):
        raise UsageError(f"{folder}: two recordings have the same name and would share labels; give --labels for each")
    return found


def _named_in(folder: Path, recording: Recording) -> Path | None:
    """Return the labels of a recording in a folder: beside the log or in it, in the same inner folder, or directly."""
    log = recording.paths[0]
    is_below = folder.resolve() in log.resolve().parents
    places = [*([log.parent] if is_below else []), folder.joinpath(*recording.inside), folder]
    named = (place / f"{recording.name}{LABEL_SUFFIX}" for place in places)
    if found := next((path for path in named if path.is_file()), None):
        return found
    from seaclutter_cli.labels import has_labels

    return log if is_below and recording.is_frame_folder and has_labels(log) else None


def open_recording(recording: Recording, reading: Decoding) -> Source:
    """Open a recording; raise `InputError` if it cannot be read."""
    if mirror_of(recording.paths[0]):
        fetch(*_files_of(recording))
        if getattr(reading, "join", None) is None:  # what is joined by its names
            recording.require_one()
    decoding = DecoderOptions(reading.calibration, reading.sensor)
    source = recording.open(rate_hz=reading.rate_hz, columns=reading.columns, decoding=decoding)
    topics = getattr(reading, "topics", ())
    return Integrated(source, round(reading.integrate_ms * 1e6), topics) if reading.integrate_ms else source


@contextmanager
def opened(recording: Recording, reading: ReadOptions, observer: Observer, outcome: Outcome) -> Iterator[Source]:
    """Open a recording; report its warnings and damage, and store the damage in the outcome."""
    with closing(open_recording(recording, reading)) as source:
        shown = len(source.warnings)
        for text in source.warnings:
            observer.warn(text)
        yield source
        for text in source.warnings[shown:]:
            observer.warn(text)
        outcome.damage, outcome.facts = source.damage, dict(source.facts)
        observer.damage(source.damage)


@contextmanager
def storing_errors(outcome: Outcome, observer: Observer) -> Iterator[None]:
    """Store an error of one recording in its outcome, so that the others are still processed; measure the time.

    Raise `UsageError` if the error would be the same for all recordings.
    """
    started = perf_counter()
    try:
        yield
    except UsageError:
        raise
    except SeaclutterError as error:
        if isinstance(error, FieldError) and outcome.recording not in str(error):
            error = FieldError(f"{outcome.recording}: {error}")
        outcome.error = str(error)
        observer.fail(error)
    outcome.seconds = perf_counter() - started


def expected_frames(source: Source, clouds: Sequence[Channel], selection: Selection) -> int | None:
    """Return the expected number of frames; None if it is unknown before reading."""
    total = sum(source.counts.get(channel.id, 0) for channel in clouds)
    return selection.frames or total or None


def require_frames(source: Source, frames: int, selection: Selection) -> None:
    """Raise `SelectionError` if no frame is in the selected period, `InputError` if damage leaves none."""
    if frames:
        return
    if source.damage:
        raise InputError(f"{source.name}: no frame can be read; {source.damage[0]}")
    if selection.period:
        span = ""
        if source.span_ns:
            first_ns, last_ns = source.span_ns
            start = datetime.fromtimestamp(first_ns // 10**9, UTC).isoformat(sep=" ").removesuffix("+00:00")
            span = f"; the log is {duration((last_ns - first_ns) / 10**9)} long, from {start} UTC"
        raise SelectionError(f"{source.name}: no frames {selection.period}{span}")
