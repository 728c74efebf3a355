"""Filtering of recordings into drop-in MCAP files."""

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

from seaclutter_cli.config import Config
from seaclutter_cli.errors import OutputError, UsageError
from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.interfaces import Labels, Sink, Source
from seaclutter_cli.pipeline import TopicTally, run
from seaclutter_cli.records import Metadata
from seaclutter_cli.reporting.palette import reason_names
from seaclutter_cli.runs.batch import BatchOptions, Work, input_bytes, run_batch, size_of
from seaclutter_cli.runs.checks import Checks
from seaclutter_cli.runs.filter_result import FilterOutcome, FilterSummary
from seaclutter_cli.runs.labels import LabelFile, LabelSources
from seaclutter_cli.runs.manifest import manifest_of
from seaclutter_cli.runs.methods import ConfigOptions
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import (
    Paths,
    check_suffixes,
    inputs_of,
    may_appear,
    plan_outputs,
    prepare_outputs,
    write_files,
)
from seaclutter_cli.runs.recordings import (
    Logs,
    PathLike,
    ReadOptions,
    expand,
    expected_frames,
    opened,
    require_frames,
    storing_errors,
)
from seaclutter_cli.runs.resume import earlier_run, identity_of
from seaclutter_cli.runs.run_record import NAME, RunIdentity, to_entries
from seaclutter_cli.selection import cloud_channels, was_filtered
from seaclutter_cli.sinks import CsvSink, McapOptions, McapSink
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sources import Recording
from seaclutter_cli.storage.locations import Location, location
from seaclutter_cli.storage.scratch import copies_removed
from seaclutter_cli.text import count, printable, share

_FEW_WATER = 0.05


@dataclass(frozen=True, kw_only=True)
class FilterOptions:
    """Options of a filter run: method, input and output files.

    Parameters
    ----------
    config : ConfigOptions
        Method and parameters.
    reading : ReadOptions
        Part of each recording to read, and how.
    written : McapOptions
        Content of the filtered files; the run fills in its ``config``.
    with_scene : bool
        Write boxes around the clusters of kept points to ``/seaclutter/scene``.
    labels : LabelSources
        Labels whose boxes are also written; only with ``with_scene``.
    csv_file : Path, Url or None
        File for a table with a row for each frame.
    force : bool
        Replace existing files.
    """

    config: ConfigOptions = field(default_factory=ConfigOptions)
    reading: ReadOptions = field(default_factory=ReadOptions)
    written: McapOptions = field(default_factory=McapOptions)
    with_scene: bool = False
    labels: LabelSources = field(default_factory=LabelSources)
    csv_file: Location | None = None
    force: bool = False
    batch: BatchOptions = field(default_factory=BatchOptions)


@copies_removed()
def filter_logs(logs: Logs, output: PathLike, options: FilterOptions, observer: Observer = SILENT) -> FilterSummary:
    """Filter every recording into an MCAP file.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    output : path
        File for one recording, folder for several or if it is a `str` that ends in a slash.
    options : FilterOptions
        Method, input and output files.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If the run cannot start or continue; an error in a single recording is stored in its outcome.
    """
    started, plan, batch = perf_counter(), plan_works(logs, output, options, observer), options.batch
    replaces = options.force or batch.resume
    prepare_outputs(plan.outputs, plan.inputs, options.labels.paths, force=replaces, observer=observer, root=plan.root)
    check_suffixes(work.target for work in plan.works)
    known = [_earlier(work, observer) if batch.resume else None for work in plan.works]
    works = [work for work, outcome in zip(plan.works, known, strict=True) if outcome is None]
    with OutputGroup(replace=replaces) as files:
        with ExitStack() as stack:
            # A single log appears together with the table. Of several, each appears when it is complete.
            is_alone, csv_file = batch.runs_here(len(works)), options.csv_file
            log_written = stack.enter_context(OutputGroup(files)) if is_alone else None
            table = stack.enter_context(frame_table(plan.config, csv_file, files)) if csv_file else None
            if is_alone:
                done = iter([works[0].run(observer, table, log_written)])
            else:
                done = iter(run_batch(works, batch, observer, partial(_append, table)))
            outcomes = [outcome or next(done) for outcome in known]
        if not may_appear([options.csv_file], outcomes, observer):
            files.discard()
    for outcome in outcomes:
        outcome.bytes_out = 0 if outcome.error else size_of(outcome.output)
    if batch.manifest:
        recordings = [work.recording for work in plan.works]
        write_files(manifest_of(batch.manifest, recordings, outcomes), replace=replaces)
    return FilterSummary(outcomes, perf_counter() - started)


@dataclass(frozen=True)
class PlannedWorks:
    """Work on each recording of a run, and the files that the run reads and writes.

    Parameters
    ----------
    config : Config
        Effective configuration.
    works : list of FilterWork
        Work on each recording.
    inputs, outputs : mapping of str to path, paths or None
        Files by option.
    root : Path or Url
        Folder of the filtered files, or the only one.
    """

    config: Config
    works: "list[FilterWork]"
    inputs: Paths
    outputs: Paths
    root: Location


def plan_works(
    logs: Logs, output: PathLike, options: FilterOptions, observer: Observer = SILENT, *, ahead: bool = True
) -> PlannedWorks:
    """Return the work on each recording, without checks of the output files; `filter_logs` describes the parameters.

    Recordings in object storage are fetched ahead, if ``ahead``.

    Raises
    ------
    SeaclutterError
        If the configuration is not valid, there are no recordings, or options do not fit them.
    """
    config, recordings = options.config.load(), expand(logs, options.reading, observer, ahead=ahead)
    if options.labels.paths and not options.with_scene:
        raise UsageError("--labels: only used for the boxes of --with-scene; add that option or leave out --labels")
    targets = plan_outputs(recordings, output)
    batch, labels = options.batch, options.labels.assign(recordings)
    if batch.resume and not all(isinstance(place, Path) for place in (*targets, *(r.paths[0] for r in recordings))):
        raise UsageError("--resume: is for logs and outputs on this machine; leave it out")
    if batch.resume and options.csv_file:
        raise UsageError("--resume: there are no rows of frames for recordings that are skipped; leave out --csv")
    return PlannedWorks(
        config,
        [FilterWork(options, config, *each) for each in zip(recordings, targets, labels, strict=True)],
        inputs_of(recordings, options.reading, options.config.file, [config]),
        {"-o": targets, "--csv": options.csv_file, "--manifest": batch.manifest},
        location(output),
    )


def frame_table(config: Config, path: Location, group: OutputGroup | None = None) -> CsvSink:
    """Return the table for the frames of recordings."""
    rings = len(config.ring_edges[1:])
    return CsvSink(path, rings, scenes=config.has_scenes, water=config.has_water, group=group)


def _earlier(work: "FilterWork", observer: Observer) -> FilterOutcome | None:
    """Return the outcome of an earlier run whose output is complete; None if the recording must be filtered."""
    outcome, difference = work.earlier()
    if outcome is None and difference:
        observer.note(f"{work.recording.name}: filtered again; {difference}")
    if outcome is not None:
        observer.damage(outcome.damage)
    return outcome


def _append(table: CsvSink | None, outcome: FilterOutcome) -> None:
    """Append the rows of a recording to the table."""
    if table and not outcome.error:
        table.append(zlib.decompress(outcome.rows))
    outcome.rows = b""


@dataclass(frozen=True)
class FilterWork(Work[FilterOutcome]):
    """Filtering of one recording.

    Parameters
    ----------
    options : FilterOptions
        Method, input and output files.
    config : Config
        Effective configuration.
    recording : Recording
        The recording.
    target : Path or Url
        Filtered file.
    labels : LabelFile or None
        Its labels.
    """

    options: FilterOptions
    config: Config
    recording: Recording
    target: Location
    labels: LabelFile | None = None

    @property
    def reads(self) -> Sequence[Location]:
        """Files and folders that the work reads."""
        return *self.recording.paths, *self.options.reading.beside(), *((self.labels.path,) if self.labels else ())

    @property
    def writes(self) -> Sequence[Location]:
        """The filtered file."""
        return (self.target,)

    def run(self, observer: Observer, table: CsvSink | None = None, group: OutputGroup | None = None) -> FilterOutcome:
        """Filter the recording; store an error in the outcome.

        Parameters
        ----------
        observer : Observer
            Receives progress and warnings.
        table : CsvSink, optional
            Table for the rows of the frames; by default they are stored in the outcome.
        group : OutputGroup, optional
            Files with which the filtered file appears; by default it appears by itself.
        """
        outcome = self.without_result(None)
        with storing_errors(outcome, observer), self._same_output_accepted(), ExitStack() as stack:
            own = None if table or not self.options.csv_file else stack.enter_context(self._own_table())
            source = stack.enter_context(opened(self.recording, self.options.reading, observer, outcome))
            written = stack.enter_context(OutputGroup(group, replace=self.options.force or self.options.batch.resume))
            self._stream(source, outcome, observer, table or own, written)
            if own:
                outcome.rows = zlib.compress(own.rows())
        return outcome

    @contextmanager
    def _same_output_accepted(self) -> Iterator[None]:
        """Accept an output that another process has completed, which died or was given up before its answer came."""
        try:
            yield
        except OutputError:
            with suppress(UsageError, OSError):  # not an output of a run, or none at all
                if isinstance(self.target, Path) and self.earlier()[0] is not None:
                    return
            raise

    @contextmanager
    def _own_table(self) -> Iterator[CsvSink]:
        """Return a table for the frames of this recording alone, which is removed at the end."""
        with TemporaryDirectory(prefix="seaclutter-") as folder, frame_table(self.config, Path(folder, "t.csv")) as own:
            yield own

    def earlier(self) -> tuple[FilterOutcome | None, str]:
        """Return the outcome of an earlier run whose output is complete, or what differs; see `earlier_run`."""
        blank, paths = self.without_result(None), self.recording.paths
        return earlier_run(blank, self.identity, paths, force=self.options.force)

    def without_result(self, reason: str | None) -> FilterOutcome:
        """Return an outcome without frames."""
        return FilterOutcome(
            recording=self.recording.name,
            output=self.target,
            edges=self.config.ring_edges,
            has_water=self.config.has_water,
            bytes_in=input_bytes(self.recording),
            error=reason,
        )

    def _stream(
        self,
        source: Source,
        outcome: FilterOutcome,
        observer: Observer,
        table: CsvSink | None,
        group: OutputGroup,
    ) -> None:
        selection = self.options.reading.selection
        clouds = cloud_channels(source, selection.topics)
        topics = list(dict.fromkeys(channel.topic for channel in clouds))
        labels = self.labels.open() if self.labels else None
        if labels and len(topics) > 1:
            raise UsageError(f"{source.name}: labels apply to one topic; choose one with -t")
        if self.config.method != "none" and was_filtered(source, selection.topics):
            observer.warn(f"{source.name}: already filtered; this run only filters the remaining points")
        named = printable(", ".join(channel.topic for channel in clouds))
        observer.note(f"{source.name}: {source.format}, method {self.config.method} on {named}", detail=True)
        fit = _FitWarnings(self.config, source, topics, observer)
        with (
            observer.progress(source.name, expected_frames(source, clouds, selection)) as step,
            McapSink(
                outcome.output, self._written(labels, partial(self._record, source, labels, outcome)), group
            ) as sink,
        ):

            def on_result(result: FilterResult) -> None:
                step()
                fit.add(result)

            sinks: list[Sink] = [sink, table] if table else [sink]
            run(source, self.config.make_filter, sinks, selection, on_result, outcome.topics)
            require_frames(source, outcome.frames)
        fit.finish(outcome.topics)

    def identity(self, source: Source | None = None, labels: Labels | None = None) -> RunIdentity:
        """Return what the filtered file depends on; source and labels hold the copies of those in object storage."""
        options, paths = self.options, getattr(source, "copies", ()) or self.recording.paths
        used = self.labels and replace(self.labels, path=getattr(labels, "copy", self.labels.path))
        return identity_of(paths, self.config, options.reading, options.written, used, with_scene=options.with_scene)

    def _record(self, source: Source, labels: Labels | None, outcome: FilterOutcome) -> Metadata:
        return Metadata(NAME, to_entries(self.identity(source, labels), outcome.topics, source.damage))

    def _written(self, labels: Labels | None, record: Callable[[], Metadata]) -> McapOptions:
        written = replace(
            self.options.written, config=self.config.to_yaml(), water=self.config.has_water, record=record
        )
        if not self.options.with_scene:
            return written
        from seaclutter_cli.reporting.scene import scene_maker

        return replace(written, scene=scene_maker(self.config.evaluation, labels))


class _FitWarnings:
    """Warnings about settings that do not fit the frames of a recording."""

    def __init__(self, config: Config, source: Source, topics: Sequence[str], observer: Observer) -> None:
        self._config, self._observer = config, observer
        self._checks = {topic: Checks(config, source.facts) for topic in topics}

    def add(self, result: FilterResult) -> None:
        """Check a frame."""
        for warning in self._checks[result.frame.topic].add(result):
            self._warn(result.frame.topic, warning)

    def finish(self, tallies: Mapping[str, TopicTally]) -> None:
        """Check the sums over all frames."""
        for topic, tally in tallies.items():
            unfit: Sequence[str | None] = self._checks[topic].finish()
            for warning in unfit or [_nothing_left(tally, self._config.ring_edges) or self._no_water(tally)]:
                self._warn(topic, warning)

    def _no_water(self, tally: TopicTally) -> str | None:
        """Return a warning if nearly all frames of a topic are without the water that the method needs."""
        if not (self._config.has_water and tally.points_in) or tally.water_frames > _FEW_WATER * tally.frames:
            return None
        without = f"{tally.frames - tally.water_frames:,} of {count(tally.frames, 'frame')}"
        return f"no water seen in {without}; heights are then unknown, and every object that stays is kept"

    def _warn(self, topic: str, text: str | None) -> None:
        if text:
            self._observer.warn(f"{topic}: {text}")


def _nothing_left(tally: TopicTally, edges: Sequence[float]) -> str | None:
    """Return a warning if no point of a topic was kept."""
    most = Reason(int(tally.counts.argmax()))
    if not tally.points_in or tally.counts[Reason.KEPT]:
        return None
    reason = reason_names(edges)[most]
    return f"no points are left; {share(int(tally.counts[most]), tally.points_in)} were removed: {reason}"
