"""Suspects of recordings: what a filter removed that may have been a target, and what it kept that may be clutter."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.config import Config, is_named, load_config
from seaclutter_cli.errors import InputError
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.messages.metadata import FILTERED
from seaclutter_cli.pipeline import Filtered, run_each
from seaclutter_cli.plots.clouds import draw_suspect
from seaclutter_cli.plots.figure import render
from seaclutter_cli.reporting.sample import take_sample
from seaclutter_cli.runs.batch import RecordingWork, prepared, run_all
from seaclutter_cli.runs.checks import FitChecks, warn_if_filtered
from seaclutter_cli.runs.methods import configured
from seaclutter_cli.runs.objects import mounting_of, recorded_configs
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import SuspectsOptions
from seaclutter_cli.runs.outputs import write_files
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult
from seaclutter_cli.selection import (
    Selection,
    cloud_channels,
    filtered_by,
    lacks_points,
    main_topics,
    recorded_of,
    removed_topic,
    studied,
)
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.suspects.finder import Suspect, SuspectFinder
from seaclutter_cli.text import UNKNOWN, count, printable, table

_EVERY_POINT = 1 << 40
_TITLES = {"removed": "removed, and may have been targets", "kept": "kept, and may be clutter"}
_HEADS = ("score", "frames", "from s", "to s", "range m", "x m", "y m", "points", "top m")
COLUMNS = ("recording", "kind", "rank", *(one.name for one in fields(Suspect) if one.name != "kind"))


@use_case_of(SuspectsOptions)
def find_suspects(options: SuspectsOptions) -> "SuspectsResult":
    """Find what a filter removed that may have been a target, and what it kept that may be clutter, without labels.

    Returns
    -------
    SuspectsResult
        ``outcomes``, each with its ``suspects``, those ``removed`` and those ``kept``, the most probable first.

    Examples
    --------
    >>> import seaclutter
    >>> (found,) = seaclutter.find_suspects("samples/sea.mcap", method="joint").outcomes
    >>> first = found.suspects["removed"][0]
    >>> first.frames > 5, max(first.reasons, key=first.reasons.get)
    (True, 'outlier')
    """
    observer, folder = options.watching, options.picture_folder
    config = configured(options)
    # The names of pictures are not known before; their folder is.
    pictures = {"--pictures": folder / "suspect.png" if folder else None}
    pairs = prepared(options, observer, [config], pictures)
    works = [_SuspectsWork(options.reading, *pair, config, options) for pair in pairs]
    result = SuspectsResult(run_all(works, options, observer))
    files = {options.output: result.as_csv()}
    for number, outcome in enumerate(result.outcomes, 1):
        first = f"{number}-" if len(works) > 1 else ""
        files |= {folder / f"{first}{name}.png": data for name, data in outcome.pictures.items() if folder}
    write_files(files, replace=options.force, outcomes=result.outcomes, observer=observer)
    return result


@dataclass(kw_only=True)
class RecordedSuspects(Outcome):
    """Suspects of one recording by their kind, the most probable first; pictures of the first by name.

    The text has so many of each kind as are ``shown``.
    """

    data = "recording error damage seconds=rounded_s method topic frames unjudged suspects"

    method: str = ""
    topic: str = ""
    frames: int = 0
    start_ns: int | None = None
    unjudged: int = 0
    suspects: Mapping[str, Sequence[Suspect]] = field(default_factory=dict)
    pictures: dict[str, bytes] = field(default_factory=dict, repr=False)
    shown: int = 10

    def figures(self) -> str:
        """Return the number of suspects, for a line about the outcome."""
        removed, kept = (len(self.suspects.get(kind, ())) for kind in _TITLES)
        found = f"{count(removed, 'suspect')} removed, {kept:,} kept"
        return f"{self.method}, {count(self.frames, 'frame')}, {found}, {self.seconds:.1f} s"

    def as_text(self) -> str:
        """Return the first suspects of each kind as tables."""
        recording, topic = printable(self.recording), printable(self.topic)
        blocks = [f"{recording}: {self.method} on {topic}, {count(self.frames, 'frame')}"]
        for kind, title in _TITLES.items():
            if not (found := self.suspects.get(kind, ())):
                blocks.append(f"{title}: none")
                continue
            heads = ("", *_HEADS, "removed by") if kind == "removed" else ("", *_HEADS)
            rows = [(number, *self._cells(one)) for number, one in enumerate(found[: self.shown], 1)]
            more = f" (of {len(found):,})" if len(found) > self.shown else ""
            blocks.append(f"{title}{more}:\n{table(heads, rows)}")
        if self.unjudged:
            late = "within a second of an end or gap, too late to be judged"
            blocks.append(f"{count(self.unjudged, 'cluster')} came {late}")
        return "\n\n".join(blocks)

    def _cells(self, one: Suspect) -> tuple[str, ...]:
        spans = (f"{(stamp - (self.start_ns or 0)) / 1e9:.1f}" for stamp in (one.first_ns, one.last_ns))
        top = UNKNOWN if one.top_m is None else f"{one.top_m:.1f}"
        numbers = f"{one.range_m:.0f}", f"{one.x_m:z.0f}", f"{one.y_m:z.0f}", f"{one.points:,}", top
        by = sorted(one.reasons, key=lambda name: -one.reasons[name])[:1] if one.reasons else []
        return f"{one.score:.2f}", f"{one.frames:,}", *spans, *numbers, *(name.replace("_", " ") for name in by)


@dataclass(frozen=True)
class _SuspectsWork(RecordingWork[RecordedSuspects]):
    """Search for the suspects of one recording; of filtered logs, those of the earlier run unless a method is given."""

    config: Config
    options: SuspectsOptions
    kind = RecordedSuspects

    def study(self, source: Source, labels: Labels | None, outcome: RecordedSuspects, observer: Observer) -> None:
        options = self.options
        is_given = bool(options.method or options.settings) or is_named(options.config)
        selection, removed, config = _part(source, self.reading.selection, self.config, is_given=is_given)
        clouds = cloud_channels(source, selection.topics)
        earlier = [name for one in recorded_of(source, [clouds[0].topic]) for name in one.methods]
        outcome.topic, outcome.method = clouds[0].topic, config.method if config else ", ".join(earlier)
        outcome.shown = options.shown
        finder = finder_for(self.config) if config else finder_for(*recorded_configs(source), self.config)
        every = _filtered(source, config, selection, removed)
        checks = FitChecks(config, source, outcome.topic, observer) if config else None
        if config:
            warn_if_filtered(source, [outcome.topic], config, observer)
        for frame, (result,), _ in self.stepped(every, source, observer, clouds):
            if checks and result:
                checks.see(result)
            if outcome.start_ns is None:
                outcome.start_ns = frame.stamp_ns
            outcome.frames += result is not None
            finder.add(frame, [result])
        outcome.suspects, outcome.unjudged = finder.finish(), finder.unjudged
        if checks:
            checks.end()
            if finder.unjudged and checks.cause:
                observer.warn(f"{outcome.topic}: {count(finder.unjudged, 'cluster')} are not judged{checks.cause}")
        wanted = _chosen(outcome.suspects, options.shown) if options.picture_folder else {}
        if wanted:  # in a second pass, because suspects are known at the end
            for frame, (result,), _ in _filtered(source, config, selection, removed):
                for name, one in wanted.get(frame.index, {}).items() if result else ():
                    sample = take_sample(frame, [result], None, self.config.evaluation, _EVERY_POINT)
                    place = one.x_m, one.y_m
                    outcome.pictures[name] = render(draw_suspect, ".png", aspect=1.9, sample=sample, place=place)
        self.finish(source, labels, outcome.frames)


def finder_for(*configs: Config) -> SuspectFinder:
    """Return a new finder for the lidar of the first of some configurations that tells how it is mounted."""
    return SuspectFinder(1, mounting_of(*configs))


def _filtered(source: Source, config: Config | None, selection: Selection, removed: str | None) -> Iterator[Filtered]:
    used = config or load_config(None, method="none")
    return run_each(source, [used.make_filter()], selection, removed)


def _part(
    source: Source, selection: Selection, config: Config, *, is_given: bool
) -> tuple[Selection, str | None, Config | None]:
    """Return what to study: a selection of one topic, that of removed points if any, and a method unless it was run.

    Raise `InputError` if the log is filtered, but lacks the removed points.
    """
    names = selection.topics or main_topics(source)
    left = [name for name in names if [one.content for one in recorded_of(source, [name])] == [FILTERED]]
    with_removed = [name for name in left if removed_topic(source, name)]
    if with_removed and not is_given:
        return replace(selection, topics=tuple(with_removed)), removed_topic(source, with_removed[0]), None
    chosen = studied(source, selection)
    topic = cloud_channels(source, chosen.topics)[0].topic
    by = filtered_by(source, [topic])
    if lacks_points(source, topic):
        remedy = "use the raw log, or one that was filtered with --with-removed"
        raise InputError(f"{source.name}: already filtered{by}, without the removed points; {remedy}")
    return chosen, None if by is None else removed_topic(source, topic), config


def _chosen(suspects: Mapping[str, Sequence[Suspect]], most: int) -> dict[int, dict[str, Suspect]]:
    found: dict[int, dict[str, Suspect]] = {}
    for kind, listed in suspects.items():
        for number, one in enumerate(listed[:most], 1):
            found.setdefault(one.frame, {})[f"{kind}-{number}"] = one
    return found


class SuspectsResult(RecordingsResult[RecordedSuspects]):
    """Suspects of several recordings."""

    data = "recordings=outcomes"

    def as_csv(self) -> bytes:
        """Return all suspects as a table (CSV)."""
        lines = [csv_line(COLUMNS)]
        for outcome in self.outcomes:
            for found in outcome.suspects.values():
                for rank, one in enumerate(found, 1):
                    row = {"recording": outcome.recording, "rank": rank, **vars(one)}
                    row["reasons"] = " ".join(f"{name}:{points}" for name, points in one.reasons.items())
                    lines.append(csv_line("" if row[name] is None else row[name] for name in COLUMNS))
        return b"".join(lines)
