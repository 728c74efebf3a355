"""Filtering of recordings into drop-in logs."""

import zlib
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter

from seaclutter_cli.buckets import on_paths
from seaclutter_cli.config import Config
from seaclutter_cli.errors import UsageError
from seaclutter_cli.frame import FilterResult
from seaclutter_cli.interfaces import Labels, Sink, Source
from seaclutter_cli.pipeline import run
from seaclutter_cli.records import Channel, Metadata
from seaclutter_cli.runs.batch import BatchOptions, Work, input_bytes, inputs_of_work, run_batch
from seaclutter_cli.runs.filter_fit import FitWarnings
from seaclutter_cli.runs.filter_read_back import ReadBackWork
from seaclutter_cli.runs.filter_result import FilterOutcome, FilterSummary
from seaclutter_cli.runs.filter_table import frame_table, own_table
from seaclutter_cli.runs.labels import LabelFile, LabelSources
from seaclutter_cli.runs.log_outcome import output_size
from seaclutter_cli.runs.methods import ConfigOptions
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.output_plan import (
    check_names,
    first_part,
    places_of,
    plan_outputs,
    warn_of_losses,
    warn_of_patterns,
)
from seaclutter_cli.runs.outputs import (
    Root,
    inputs_of,
    may_appear,
    prepare_outputs,
    write_manifest,
)
from seaclutter_cli.runs.planned_works import PlannedWorks
from seaclutter_cli.runs.recordings import (
    Logs,
    PathLike,
    ReadOptions,
    expand,
    expected_frames,
    opened,
    require_frames,
    require_selected,
    storing_errors,
)
from seaclutter_cli.runs.resume import (
    NAME,
    RunIdentity,
    earlier_outcomes,
    earlier_run,
    identity_of,
    same_output_accepted,
    to_entries,
)
from seaclutter_cli.selection import cloud_channels, filtered_by, was_filtered
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.csv import CsvSink
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS, check_options
from seaclutter_cli.sinks.options import McapOptions
from seaclutter_cli.sources import Recording
from seaclutter_cli.text import printable
from seaclutter_cli.threads import in_threads


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
        Content of the filtered logs; the run fills in its ``config``.
    to : str or None
        Name of the format of the outputs, a key of `OUTPUT_FORMATS`; None: by the name of the output, or MCAP.
    with_scene : bool
        Write boxes around the clusters of kept points to ``/seaclutter/scene``.
    labels : LabelSources
        Labels whose boxes are also written; only with ``with_scene``.
    csv_file : Path or None
        File for a table with a row for each frame.
    force : bool
        Replace existing files.
    """

    config: ConfigOptions = field(default_factory=ConfigOptions)
    reading: ReadOptions = field(default_factory=ReadOptions)
    written: McapOptions = field(default_factory=McapOptions)
    to: str | None = None
    with_scene: bool = False
    labels: LabelSources = field(default_factory=LabelSources)
    csv_file: Path | None = None
    force: bool = False
    batch: BatchOptions = field(default_factory=BatchOptions)


@on_paths
def filter_logs(logs: Logs, output: PathLike, options: FilterOptions, observer: Observer = SILENT) -> FilterSummary:
    """Filter every recording into a log.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    output : path
        Output of one recording; folder for those of several, or if it is a `str` that ends in a slash.
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
    check_names((work.target for work in plan.works), options.to)
    earlier = earlier_outcomes(plan.works, observer) if batch.resume else [None] * len(plan.works)
    works = _works(plan.works, earlier, with_table=options.csv_file is not None)
    with OutputGroup(replace=replaces) as files:
        with ExitStack() as stack:
            # A single log appears together with the table, after it. Of several, each appears when it is complete.
            is_alone, csv_file = batch.runs_here(len(plan.works)) and bool(works), options.csv_file
            log_written = stack.enter_context(OutputGroup(files)) if is_alone else None
            table = stack.enter_context(frame_table(plan.works[0].config, csv_file, files)) if csv_file else None
            if is_alone and isinstance(works[0], FilterWork):
                done = iter([works[0].run(observer, table, log_written)])
            else:
                done = iter(run_batch(works, batch, observer, partial(_append, table)))
            outcomes = list(done) if csv_file else [outcome or next(done) for outcome in earlier]
            require_selected(outcomes)
        if not may_appear([options.csv_file], outcomes, observer):
            files.discard()
    for outcome, size in zip(outcomes, in_threads(output_size, outcomes), strict=True):
        outcome.bytes_out = size
    write_manifest(batch.manifest, [work.recording for work in plan.works], outcomes, replace=replaces)
    return FilterSummary(outcomes, perf_counter() - started)


def plan_works(
    logs: Logs, output: PathLike, options: FilterOptions, observer: Observer = SILENT, *, ahead: bool = True
) -> "PlannedWorks[FilterWork]":
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
    planned = plan_outputs(recordings, output, options.to)
    check_options(planned.form, options.written, with_scene=options.with_scene)
    labels = options.labels.assign(recordings)
    each = zip(recordings, planned.targets, labels, strict=True)
    works = [FilterWork(options, config, *one, planned.form) for one in each]
    places = places_of(planned.targets, planned.form, options.written.split)
    return PlannedWorks(
        works,
        inputs_of(recordings, options.reading, options.config.file, [config]),
        {"-o": places, "--csv": options.csv_file, "--manifest": options.batch.manifest},
        Root(Path(output), OUTPUT_FORMATS[planned.form].marker),
    )


def _works(
    works: Sequence["FilterWork"], earlier: Sequence[FilterOutcome | None], *, with_table: bool
) -> list[Work[FilterOutcome]]:
    """Return the work that is left; with a table, also the reading of the rows in complete outputs."""
    pairs = list(zip(works, earlier, strict=True))
    if not with_table:
        return [work for work, outcome in pairs if outcome is None]
    return [work if outcome is None else ReadBackWork(work, work.config, outcome) for work, outcome in pairs]


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
    target : Path
        Filtered log.
    labels : LabelFile or None
        Its labels.
    form : str
        Name of the format of the filtered log.
    """

    options: FilterOptions
    config: Config
    recording: Recording
    target: Path
    labels: LabelFile | None = None
    form: str = "mcap"

    @property
    def output(self) -> Path:
        """The filtered log, or the first of its parts."""
        return first_part(self.target, self.form, self.options.written.split)

    @property
    def reads(self) -> Sequence[Path]:
        """Files and folders that the work reads."""
        return inputs_of_work(self.recording, self.options.reading, self.labels)

    @property
    def writes(self) -> Sequence[Path]:
        """The filtered log."""
        return (self.output,)

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
        with storing_errors(outcome, observer), same_output_accepted(self), ExitStack() as stack:
            own = None if table or not self.options.csv_file else stack.enter_context(own_table(self.config))
            source = stack.enter_context(opened(self.recording, self.options.reading, observer, outcome))
            written = stack.enter_context(OutputGroup(group, replace=self.options.force or self.options.batch.resume))
            self._stream(source, outcome, observer, table or own, written)
            if own:
                outcome.rows = zlib.compress(own.rows())
        return outcome

    def sample(self, target: Path, frames: int) -> FilterOutcome:
        """Filter the first frames into another output."""
        options = self.options
        reading = replace(options.reading, frames=min(options.reading.frames or frames, frames))
        written = replace(options.written, split=None)
        fewer = replace(options, reading=reading, written=written, csv_file=None)
        return replace(self, options=fewer, target=target).run(SILENT)

    def clouds(self, source: Source) -> list[Channel]:
        """Return the channels of the clouds to filter."""
        return cloud_channels(source, self.options.reading.selection.topics)

    def earlier(self) -> tuple[FilterOutcome | None, str]:
        """Return the outcome of an earlier run whose output is complete, or what differs; see `earlier_run`."""
        blank, paths = self.without_result(None), self.recording.paths
        return earlier_run(blank, self.identity, paths, force=self.options.force)

    def without_result(self, reason: str | None) -> FilterOutcome:
        """Return an outcome without frames."""
        return FilterOutcome(
            recording=self.recording.name,
            output=self.output,
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
        selection = replace(self.options.reading.selection, latched=self.options.written.latched)
        clouds = cloud_channels(source, selection.topics)
        warn_of_patterns(source, self.options.written, observer)
        topics = list(dict.fromkeys(channel.topic for channel in clouds))
        labels = self.labels.open() if self.labels else None
        if labels and len(topics) > 1:
            raise UsageError(f"{source.name}: labels apply to one topic; choose one with -t")
        if self.config.method != "none" and was_filtered(source, selection.topics):
            by = filtered_by(source, selection.topics)
            observer.warn(f"{source.name}: already filtered{by}; this run only filters the remaining points")
        named = printable(", ".join(channel.topic for channel in clouds))
        observer.note(f"{source.name}: {source.format}, method {self.config.method} on {named}", detail=True)
        fit = FitWarnings(self.config, source, topics, observer)
        with (
            observer.progress(source.name, expected_frames(source, clouds, selection)) as step,
            OUTPUT_FORMATS[self.form].make_sink(
                self.target, self._written(labels, partial(self._record, source, outcome)), group
            ) as sink,
        ):

            def on_result(result: FilterResult) -> None:
                step()
                fit.add(result)

            sinks: list[Sink] = [sink, table] if table else [sink]
            run(source, self.config.make_filter, sinks, selection, on_result, outcome.topics)
            require_frames(source, outcome.frames, selection)
        warn_of_losses(self.output, self.form, sink.lost, observer)
        fit.finish(outcome.topics)

    def identity(self) -> RunIdentity:
        """Return what the filtered file depends on."""
        options, paths = self.options, self.recording.paths
        kind = {"with_scene": options.with_scene, **({} if self.form == "mcap" else {"to": self.form})}
        return identity_of(paths, self.config, options.reading, options.written, self.labels, **kind)

    def _record(self, source: Source, outcome: FilterOutcome) -> Metadata:
        return Metadata(NAME, to_entries(self.identity(), outcome.topics, source.damage))

    def _written(self, labels: Labels | None, record: Callable[[], Metadata]) -> McapOptions:
        written = replace(
            self.options.written,
            config=self.config.to_yaml(),
            water=self.config.has_water,
            record=record,
            method=self.config.method,
            is_part=not self.options.reading.selection.is_whole,
        )
        if not self.options.with_scene:
            return written
        from seaclutter_cli.reporting.boxes import scene_updates

        return replace(written, scene=scene_updates(self.config.evaluation, labels))
