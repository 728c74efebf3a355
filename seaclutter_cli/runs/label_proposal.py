"""Proposal of labels from the objects of recordings, and their files."""

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.cloud import Cloud, from_array, structured
from seaclutter_cli.errors import UsageError
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.labels.boxes import IGNORE, Labelled, Proposal
from seaclutter_cli.labels.csv import COLUMNS, PROPOSED
from seaclutter_cli.labels.json_boxes import SEEPERSEA, SUSTECHPOINTS, JsonForm
from seaclutter_cli.reading import frames
from seaclutter_cli.runs.batch import prepared, run_all
from seaclutter_cli.runs.methods import configured
from seaclutter_cli.runs.objects import ObjectsWork, RecordedObjects
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import ProposeOptions
from seaclutter_cli.runs.outputs import is_folder, may_appear
from seaclutter_cli.runs.recordings import LABEL_SUFFIX, RecordingsResult, expand, open_recording
from seaclutter_cli.selection import cloud_channels
from seaclutter_cli.sinks.atomic import AtomicFile, AtomicFolder, OutputGroup
from seaclutter_cli.sinks.csv import csv_lines
from seaclutter_cli.sinks.objects import rows_as_mappings
from seaclutter_cli.sinks.point_files import FRAME_WRITERS
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.text import count, printable, table
from seaclutter_cli.tracking.boxes import STRUCTURE
from seaclutter_cli.tracking.follow import CONFIRMED

FOLDER_FORMS: Mapping[str, JsonForm] = {"sustechpoints": SUSTECHPOINTS, "seepersea": SEEPERSEA}
"""Forms with a folder for each recording; a CSV file is the other one."""

SURE, DOUBTFUL = "sure", "doubtful"
LEAST_FRAMES = 3
_NANO = 10**9
_MOST_SHOWN = 20


@use_case_of(ProposeOptions)
def propose_labels(options: ProposeOptions) -> "ProposalResult":
    """Label the objects of one or several logs with boxes, for a person to correct.

    Examples
    --------
    >>> import seaclutter
    >>> done = seaclutter.propose_labels("samples/sea.mcap", folder / "sea.labels.csv")
    >>> done.outcomes[0].boxes, done.outcomes[0].doubtful
    (120, 0)
    """
    observer, config = options.watching, configured(options, default_method="confirmed")
    targets = _targets(options, expand(options, ahead=False))
    pairs = prepared(options, observer, [config], {"-o": targets})
    works = [ProposeWork(options.reading, *each, config) for each in pairs]
    outcomes = [one for one in run_all(works, options, observer) if isinstance(one, ProposedLabels)]
    with OutputGroup(replace=options.force) as files:
        for work, target, outcome in zip(works, targets, outcomes, strict=True):
            if not outcome.error and not outcome.skipped:
                _write(work, target, outcome, options.to, files)
        if not may_appear(targets, outcomes, observer):
            files.discard()
    return ProposalResult(outcomes)


def _targets(options: ProposeOptions, recordings: Sequence[Recording]) -> list[Path]:
    """Return the file or folder of the labels of each recording; `UsageError` if a folder of labels exists."""
    output, suffix = Path(options.output), "" if options.to in FOLDER_FORMS else LABEL_SUFFIX
    alone = len(recordings) == 1 and (not suffix or not is_folder(options.output, 1))
    targets = [output] if alone else [output / f"{recording.name}{suffix}" for recording in recordings]
    for target in targets if not suffix else ():
        if target.exists():
            raise UsageError(f"{target}: exists, and may have labels that somebody corrected; choose another folder")
    return targets


def _write(work: "ProposeWork", target: Path, outcome: "ProposedLabels", to: str, group: OutputGroup) -> None:
    """Write the labels of a recording; of a form with a folder, the clouds too."""
    if to not in FOLDER_FORMS:
        with AtomicFile(target, group) as file:
            write_proposals(file.stream, outcome.found, outcome.indices)
        return
    form = FOLDER_FORMS[to]
    folder = AtomicFolder(target, group)
    with folder:
        for name in (form.folder, form.clouds, *(["timestamp"] if form.complete else [])):
            (folder.part / name).mkdir()
        for name, content in files_of(form, outcome.found, outcome.indices):
            with folder.open(name) as stream:
                stream.write(content)
        _write_clouds(work, folder, form)


def _write_clouds(work: "ProposeWork", folder: AtomicFolder, form: JsonForm) -> None:
    with closing(open_recording(work.recording, work.reading)) as source:
        for frame in frames(source, work.reading.selection):
            with folder.open(f"{form.clouds}/{frame.index:06d}.pcd") as stream:
                FRAME_WRITERS["pcd"](stream, _viewed(frame))
            if form.complete:
                with folder.open(f"timestamp/{frame.index:06d}.txt") as stream:
                    stream.write(f"{frame.stamp_ns // _NANO}.{frame.stamp_ns % _NANO:09d}\n".encode())


def _viewed(frame: Frame) -> Cloud:
    """Return the cloud with coordinates and intensities as float32, and no other fields: viewers read these only."""
    columns = dict(zip("xyz", frame.coordinates, strict=True))
    if frame.intensity_name is not None:
        columns["intensity"] = frame.intensity
    points = structured({name: values.astype(np.float32) for name, values in columns.items()})
    return replace(from_array(points), stamp_ns=frame.stamp_ns, frame_id=frame.cloud.frame_id)


@dataclass(kw_only=True)
class ProposedLabels(RecordedObjects):
    """Proposed labels of one recording: boxes, doubtful ones first."""

    data = "recording error damage seconds=rounded_s frames boxes doubtful classes"

    found: list[Proposal] = field(default_factory=list, repr=False)

    @property
    def boxes(self) -> int:
        """Number of boxes."""
        return len(self.found)

    @property
    def doubtful(self) -> int:
        """Number of boxes that are doubtful."""
        return sum(one.mark == DOUBTFUL for one in self.found)

    @property
    def classes(self) -> dict[str, int]:
        """Number of tracks by class."""
        return dict(sorted(Counter({one.labelled.track: one.labelled.kind for one in self.found}.values()).items()))

    def as_text(self) -> str:
        """Return what was proposed, tracks with doubtful boxes first."""
        rows: dict[str, list[Proposal]] = {}
        for one in self.found:
            rows.setdefault(one.labelled.track, []).append(one)
        lines = []
        for track, own in islice(rows.items(), _MOST_SHOWN):
            numbers, doubtful = [one.frame for one in own], sum(one.mark == DOUBTFUL for one in own)
            frames, score = f"{min(numbers)} to {max(numbers)}", f"{own[0].score:.2f}"
            lines.append((track, own[0].labelled.kind, frames, len(own), doubtful, score))
        left_out = len(rows) - len(lines)
        head = f"{printable(self.recording)}: {count(self.frames, 'frame')}, {count(self.boxes, 'box')}"
        blocks = [f"{head}, {self.doubtful:,} doubtful"]
        blocks.append(table(("id", "class", "frames", "boxes", "doubtful", "score"), lines) if lines else "No box.")
        if left_out:
            blocks.append(f"and {count(left_out, 'other object')}")
        if brief := len(self.tracks) - len(rows):
            blocks.append(f"left out: {count(brief, 'object')} seen in fewer than {LEAST_FRAMES} frames")
        return "\n".join(blocks)


@dataclass(frozen=True)
class ProposeWork(ObjectsWork):
    """Proposal of labels for one recording."""

    kind = ProposedLabels

    def study(self, source: Source, labels: Labels | None, outcome: RecordedObjects, observer: Observer) -> None:
        """Follow the objects of the only topic."""
        topics = dict.fromkeys(channel.topic for channel in cloud_channels(source, self.reading.selection.topics))
        if len(topics) > 1:
            choices = " or ".join(f"-t {topic}" for topic in topics)
            raise UsageError(f"{source.name}: labels are of one topic; choose one: {choices}")
        super().study(source, labels, outcome, observer)
        if isinstance(outcome, ProposedLabels):
            outcome.found = proposals(rows_as_mappings(outcome.rows))


class ProposalResult(RecordingsResult[ProposedLabels]):
    """Proposed labels of several recordings."""

    data = "recordings=outcomes"

    def as_text(self) -> str:
        """Return what was proposed, and what to do with it."""
        advice = "The labels are the method's own: correct them, doubtful ones first, before you\nevaluate with them."
        return "\n\n".join(filter(None, (self.details(), advice if any(one.found for one in self.outcomes) else "")))


def proposals(rows: Iterable[Mapping[str, Any]]) -> list[Proposal]:
    """Return a box for each row of a table of objects, doubtful tracks first, then by track and frame.

    Tracks that were seen in fewer than three frames are left out. The boxes of a track in which it was not confirmed
    are doubtful, as are areas to ignore around own ship or a confirmed object: a bent quay has water between its walls.
    """
    tracks: dict[int, list[Mapping[str, Any]]] = {}
    afloat: dict[int, list[tuple[float, float]]] = {}
    for row in rows:
        tracks.setdefault(row["track_id"], []).append(row)
        places = afloat.setdefault(row["frame"], [(0.0, 0.0)])
        if row["class"] != STRUCTURE and row["state"] == CONFIRMED:
            places.append((row["x_m"], row["y_m"]))
    found = []
    for number, own in tracks.items():
        if sum(row["state"] != "lost" for row in own) < LEAST_FRAMES:
            continue
        ((kind, _),) = Counter(row["class"] for row in own).most_common(1)
        kind = IGNORE if kind == STRUCTURE else kind
        for row in own:
            center, size = (row["x_m"], row["y_m"], row["z_m"]), (row["length_m"], row["width_m"], row["height_m"])
            labelled = Labelled(str(number), kind, center, size, row["yaw_rad"], proposed=True)
            around = kind == IGNORE and any(_is_inside(place, row) for place in afloat[row["frame"]])
            mark = DOUBTFUL if around or row["state"] != CONFIRMED else SURE
            found.append(Proposal(row["frame"], labelled, row["score"], mark))
    return sorted(found, key=lambda one: (one.mark, one.score, int(one.labelled.track), one.frame))


def _is_inside(place: tuple[float, float], box: Mapping[str, Any]) -> bool:
    x, y = place[0] - box["x_m"], place[1] - box["y_m"]
    cos, sin = math.cos(box["yaw_rad"]), math.sin(box["yaw_rad"])
    return bool(2 * abs(x * cos + y * sin) < box["length_m"] and 2 * abs(y * cos - x * sin) < box["width_m"])


def write_proposals(stream: BinaryIO, found: Sequence[Proposal], frames: Iterable[int]) -> None:
    """Write a CSV file; frames without an object are labelled as empty, and marked as proposed, too."""
    rows: list[Iterable[object]] = [(*COLUMNS, PROPOSED, "score")]
    for one in found:
        track, kind, center, size, yaw, _ = one.labelled
        numbers = (f"{value:.3f}" for value in (*center, *size, yaw))
        rows.append((one.frame, track, kind, *numbers, one.mark, f"{one.score:.3f}"))
    empty = sorted(set(frames) - {one.frame for one in found})
    stream.write(csv_lines([*rows, *((frame, "", "none", *[""] * 7, SURE, "") for frame in empty)]))


def files_of(form: JsonForm, found: Iterable[Proposal], frames: Sequence[int]) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the content of the label file of each frame."""
    by_frame: dict[int, list[Proposal]] = {frame: [] for frame in frames}
    for one in found:
        by_frame[one.frame].append(one)
    for frame, own in by_frame.items():
        yield f"{form.folder}/{frame:06d}.json", json.dumps(form.content(own), indent=1).encode() + b"\n"
