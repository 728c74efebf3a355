"""Objects of recordings: what was there, where, how large, and how it moved."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.config import Config, parse_config
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.pipeline import TopicTally, run
from seaclutter_cli.runs.batch import RecordingWork, prepared, run_all
from seaclutter_cli.runs.checks import FitChecks, warn_if_filtered
from seaclutter_cli.runs.methods import configured
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import ObjectsOptions
from seaclutter_cli.runs.outputs import Contents, PackedRows, write_files
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult
from seaclutter_cli.selection import cloud_channels
from seaclutter_cli.sinks.objects import COLUMNS, ObjectTable, TrackSummary, check_objects_file, parsed, write_objects
from seaclutter_cli.text import count, printable, share, table
from seaclutter_cli.tracking.follow import CANDIDATE, CONFIRMED, Follower
from seaclutter_cli.water import Mounting

_MOST_SHOWN = 20
_TYPES = {str: object, int: np.int64, float: np.float64}


@use_case_of(ObjectsOptions)
def find_objects(options: ObjectsOptions) -> "ObjectsResult":
    """Follow the objects of one or several logs over time, and measure their boxes and velocities.

    Returns
    -------
    ObjectsResult
        ``table()``, a row for each frame and object; ``outcomes``, sums for each recording.

    Examples
    --------
    >>> import seaclutter
    >>> found = seaclutter.find_objects("samples/sea.mcap")
    >>> table = found.table()
    >>> table.dtype.names[2:6], len(set(table["track_id"][table["state"] == "confirmed"].tolist()))
    (('frame', 'stamp_ns', 'track_id', 'state'), 2)
    """
    observer, config = options.watching, configured(options, default_method="confirmed")
    check_objects_file(options.output)
    works = [ObjectsWork(options.reading, *each, config) for each in prepared(options, observer, [config])]
    result = ObjectsResult(run_all(works, options, observer))
    files: Contents = {options.output: lambda it: write_objects(it.path, it.stream, result.lines())}
    write_files(files, replace=options.force, outcomes=result.outcomes, observer=observer)
    return result


@dataclass(kw_only=True)
class RecordedObjects(Outcome):
    """Objects of one recording: its number of frames and their indices, its tracks, and the rows of the table."""

    data = "recording error damage seconds=rounded_s frames tracks=confirmed candidates"

    frames: int = 0
    indices: list[int] = field(default_factory=list, repr=False)
    tracks: Mapping[tuple[str, int], TrackSummary] = field(default_factory=dict)
    rows: PackedRows = field(default_factory=PackedRows, repr=False)

    @property
    def confirmed(self) -> list[TrackSummary]:
        """Tracks that were confirmed in any frame."""
        return [one for one in self.tracks.values() if one.is_confirmed]

    @property
    def candidates(self) -> int:
        """Number of tracks that were not."""
        return len(self.tracks) - len(self.confirmed)

    def figures(self) -> str:
        """Return the main figures, for a line about the outcome."""
        return f"{count(self.frames, 'frame')}, {count(len(self.confirmed), 'object')}, {self.seconds:.1f} s"

    def as_text(self) -> str:
        """Return the tracks that were confirmed as a table for each topic."""
        head = f"{printable(self.recording)}: {self.figures()}"
        if self.candidates:
            head += f"\n{count(self.candidates, 'candidate')}, seen briefly, in part, or above the water"
        by_topic: dict[str, list[TrackSummary]] = {}
        for one in self.confirmed:
            by_topic.setdefault(one.topic, []).append(one)
        blocks = [f"{printable(topic)}:\n" * (len(by_topic) > 1) + _track_table(one) for topic, one in by_topic.items()]
        if blocks:
            over_ground = [one.over_ground for one in self.confirmed]
            which = "some speeds" if any(over_ground) and not all(over_ground) else "speeds"
            motion = "over ground" if all(over_ground) else "relative to own ship"
            blocks.append(f"Sizes are length x width x height; {which} are {motion}.")
        return "\n".join([head, *blocks])


def _track_table(tracks: Sequence[TrackSummary]) -> str:
    """Return the tracks that were seen in most frames as a table."""
    found = sorted(tracks, key=lambda one: -one.frames)
    rows = []
    for one in found[:_MOST_SHOWN]:
        size = f"{one.length_m:.1f} x {one.width_m:.1f} x {one.height_m:.1f}"
        numbers = f"{one.nearest_m:.0f}", f"{one.speed_ms:.1f}", f"{one.score:.2f}"
        rows.append((one.track_id, one.kind, one.frames, size, *numbers))
    lines = table(("id", "class", "frames", "size m", "nearest m", "fastest m/s", "score"), rows)
    left_out = len(found) - _MOST_SHOWN
    return f"{lines}\nand {count(left_out, 'other object')}" if left_out > 0 else lines


@dataclass(frozen=True)
class ObjectsWork(RecordingWork[RecordedObjects]):
    """Search for the objects of one recording."""

    config: Config
    kind = RecordedObjects

    def study(self, source: Source, labels: Labels | None, outcome: RecordedObjects, observer: Observer) -> None:
        """Filter the recording, and follow its objects."""
        table = ObjectTable(outcome.rows.write, follower_of(self.config))
        selection = self.reading.selection
        topics = {channel.topic for channel in cloud_channels(source, selection.topics)}
        warn_if_filtered(source, selection.topics, self.config, observer)
        checks = {topic: FitChecks(self.config, source, topic, observer) for topic in topics}
        tallies: dict[str, TopicTally] = {}
        every = run(source, self.config.make_filter, [table], selection, tallies)
        for result in self.stepped(every, source, observer):
            checks[result.frame.topic].see(result)
        for topic in tallies:
            checks[topic].end()
            sure, unsure = (table.states[topic, state] for state in (CONFIRMED, CANDIDATE))
            if unsure > sure:
                boxes = f"{share(unsure, sure + unsure)} of the boxes are of candidates"
                observer.warn(f"{topic}: {boxes}{checks[topic].cause}")
        outcome.frames, outcome.indices, outcome.tracks = len(table.indices), table.indices, table.tracks
        self.finish(source, labels, outcome.frames)


def mounting_of(*configs: Config) -> Mounting:
    """Return the mounting of the lidar that the first of some configurations has whose methods have any, else level."""
    found = (getattr(config.filter, "mounting", None) for config in configs)
    return next((one for one in found if isinstance(one, Mounting)), Mounting())


def recorded_configs(source: Source) -> list[Config]:
    """Return the configuration of the earlier run that wrote a log, if it is recorded and can be read."""
    texts = (one.entries.get("config") for one in source.metadata if one.name == "seaclutter")
    with suppress(ConfigError):
        return [parse_config(text, source.name) for text in texts if text]
    return []


def follower_of(config: Config) -> "partial[Follower]":
    """Return what makes followers of the objects that a configuration finds."""
    params = config.evaluation
    return partial(Follower, params.cluster_tolerance_m, params.min_cluster_points, mounting_of(config))


class ObjectsResult(RecordingsResult[RecordedObjects]):
    """Objects of several recordings."""

    data = "recordings=outcomes"

    def lines(self) -> Iterator[bytes]:
        """Yield the lines of the table (CSV) without its head."""
        for outcome in self.outcomes:
            if not outcome.error:
                yield from outcome.rows

    def table(self) -> NDArray[np.void]:
        """Return the table as an array with a field for each column."""
        types = [(name, _TYPES[kind]) for name, kind in COLUMNS.items()]
        rows = [tuple(np.nan if value is None else value for value in row) for row in parsed(self.lines())]
        return np.array(rows, types)
