"""Calibration: thresholds and the far limit of clutter, from recordings that contain clutter."""

import pickle
import zlib
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.calibration import FILTER_RATE, Calibration, ClutterSelector, Thresholds
from seaclutter_cli.config import Config
from seaclutter_cli.errors import LabelError, UsageError
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.filters.confirmation.params import ConfirmedParams
from seaclutter_cli.filters.joint import RingIntensityParams
from seaclutter_cli.filters.zones import MAX_RINGS
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.pipeline import map_frames
from seaclutter_cli.plots.clutter import ClutterDensity, draw_clutter
from seaclutter_cli.plots.figure import check_target, render
from seaclutter_cli.runs.batch import BatchOptions, Work, inputs_of_work, run_batch
from seaclutter_cli.runs.calibrate_choice import (
    Candidate,
    OnlyProgress,
    TradeOff,
    candidates,
    held_out_scores,
    is_enough,
    training_frames,
)
from seaclutter_cli.runs.calibrate_result import CalibrationResult, ClutterTally
from seaclutter_cli.runs.calibrate_targets import TargetSearch
from seaclutter_cli.runs.evaluate import EvaluateWork
from seaclutter_cli.runs.labels import LabelFile, LabelSources
from seaclutter_cli.runs.methods import ConfigOptions, Variant
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import inputs_of, prepare_outputs, write_files
from seaclutter_cli.runs.recordings import (
    Logs,
    Outcome,
    ReadOptions,
    expand,
    expected_frames,
    finish_labels,
    require_frames,
    require_selected,
    warnings_of,
)
from seaclutter_cli.selection import cloud_channels
from seaclutter_cli.sources import Recording
from seaclutter_cli.storage.locations import Location
from seaclutter_cli.storage.scratch import copies_removed
from seaclutter_cli.text import count
from seaclutter_cli.water import MountingSearch


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions:
    """Options of a calibration: start values, input and output files.

    Parameters
    ----------
    config : ConfigOptions
        Configuration to start from; its method must have a threshold for each range ring.
    filter_rate : float
        Share of the clutter points in each range ring that its threshold must remove.
    max_left : float or None
        Number of clutter points per frame that a range ring may keep; where it would keep more, its filter rate is
        higher.
    keep_end : bool
        Keep the far limit of the configuration; an override of ``filter.end_m`` has the same effect.
    choose : bool
        Use the filter rate or ``max_left`` with the fewest frames with an error on held-out frames; needs labels.
    trade_off : bool
        Compare them without using the best one; needs labels.
    labels : LabelSources
        Labels of targets and areas to leave out.
    reading : ReadOptions
        Part of each recording to read, and how.
    output : Path, Url or None
        File for the resulting configuration.
    plot_file : Path, Url or None
        File for a plot of clutter and thresholds over range.
    force : bool
        Replace existing files.
    batch : BatchOptions
        How several recordings are processed.
    """

    config: ConfigOptions = field(default_factory=ConfigOptions)
    filter_rate: float = FILTER_RATE
    max_left: float | None = None
    keep_end: bool = False
    choose: bool = False
    trade_off: bool = False
    labels: LabelSources = field(default_factory=LabelSources)
    reading: ReadOptions = field(default_factory=ReadOptions)
    output: Location | None = None
    plot_file: Location | None = None
    force: bool = False
    batch: BatchOptions = field(default_factory=BatchOptions)

    @property
    def keeps_end(self) -> bool:
        """Whether the far limit is given, not derived."""
        keys = (override.partition("=")[0].strip() for override in self.config.overrides)
        return self.keep_end or "filter.end_m" in keys


@copies_removed()
def calibrate_logs(logs: Logs, options: CalibrateOptions, observer: Observer = SILENT) -> CalibrationResult:
    """Derive the threshold of each range ring and the far limit of clutter from recordings.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs. The recordings contain sea clutter and, unless there are labels, no targets.
    options : CalibrateOptions
        Start values, input and output files.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If any recording cannot be used. Thresholds from only some of the recordings could be mistaken for thresholds
        from all of them.
    """
    config = _starting_config(options.config)
    if (options.choose or options.trade_off) and not options.labels.paths:
        raise UsageError(f"{'--choose' if options.choose else '--trade-off'}: filter rates are compared by --labels")
    recordings = expand(logs, options.reading, observer)
    if options.plot_file:
        check_target(options.plot_file)
    prepare_outputs(
        {"-o": options.output, "--plot": options.plot_file},
        inputs_of(recordings, options.reading, options.config.file, [config]),
        options.labels.paths,
        force=options.force,
        observer=observer,
    )
    labels = options.labels.assign(recordings)
    works = [CalibrateWork(config, options, *each) for each in zip(recordings, labels, strict=True)]
    pass_ = _Pass(config, options)

    def add(outcome: Calibrated) -> None:
        nonlocal pass_
        pass_ += outcome.take()

    if options.batch.runs_here(len(works)):
        pass_ += works[0].read(observer)
        observer.damage(pass_.tally.damage)
    else:
        outcomes = run_batch(works, options.batch, observer, add, together=True)
        require_selected(outcomes)
        works = [work for work, outcome in zip(works, outcomes, strict=True) if not outcome.has_nothing]
    trade_off = _trade_off(works, pass_, observer) if options.choose or options.trade_off else None
    result = pass_.result(trade_off)
    for text in result.warnings:
        observer.warn(text)
    files = {options.output: result.config_text().encode()} if options.output else {}
    if options.plot_file:
        files[options.plot_file] = pass_.plot(result.found, options.plot_file.suffix)
    write_files(files, replace=options.force)
    return result


def _trade_off(works: Sequence["CalibrateWork"], found: "_Pass", observer: Observer) -> TradeOff:
    """Return the scores of several filter rates and limits on held-out frames; with ``choose``, use the best one."""
    config, options, frames = works[0].config, works[0].options, found.tally.frames_each
    if not is_enough(frames):
        raise LabelError(f"{count(sum(frames), 'labelled frame')}: too few to compare filter rates")
    used = Candidate(options.filter_rate, options.max_left)
    compared = candidates(used)
    variants = []
    for half in (0, 1):
        training = _Pass(config, options)
        for work, number in zip(works, frames, strict=True):
            training += replace(work, labelled_frames=training_frames(number)[half]).read(OnlyProgress(observer))
        variants += [Variant(f"{one.name} ({half})", training.config(one)) for one in compared]
    judged = [EvaluateWork(options.reading, work.recording, work.labels, variants, in_parts=True) for work in works]
    trade_off = TradeOff(dict(zip(compared, held_out_scores(judged, observer), strict=True)), used)
    if not options.choose:
        return trade_off
    found.use(trade_off.best)
    return replace(trade_off, used=trade_off.best)


def _starting_config(options: ConfigOptions) -> Config:
    """Return the configuration to start from, with thresholds still to be found."""
    config = options.load(undetermined_thresholds=True)
    if not isinstance(config.filter, RingIntensityParams):
        suitable = (name for name, kind in FILTERS.items() if issubclass(kind.Params, RingIntensityParams))
        raise UsageError(f"method {config.method} has no thresholds to calibrate; choose -m {', -m '.join(suitable)}")
    if isinstance(config.filter, ConfirmedParams) and not config.filter.use_intensity:
        raise UsageError(
            "with use_intensity: false there are no thresholds to calibrate; if the lidar is mounted tilted or upside "
            "down, filter names the keys to set"
        )
    return config


@dataclass(kw_only=True)
class Calibrated(Outcome):
    """Outcome of the pass over one of several recordings.

    Parameters
    ----------
    frames, points : int
        Number of frames, and of clutter points.
    packed : bytes
        Sums over the recording, compressed.
    """

    frames: int = 0
    points: int = 0
    packed: bytes = field(default=b"", repr=False)

    def figures(self) -> str:
        """Return the main figures, for a line about the outcome."""
        return f"{count(self.frames, 'frame')}, {count(self.points, 'clutter point')}, {self.seconds:.1f} s"

    def take(self) -> "_Pass":
        """Return the sums, and forget them."""
        packed, self.packed = self.packed, b""
        found = pickle.loads(zlib.decompress(packed))  # noqa: S301 - from a process of this run
        assert isinstance(found, _Pass)  # noqa: S101 - see CalibrateWork.run
        return found


@dataclass(frozen=True)
class CalibrateWork(Work[Calibrated]):
    """Pass over one recording.

    Parameters
    ----------
    config : Config
        Configuration to start from.
    options : CalibrateOptions
        Input, and what to derive.
    recording : Recording
        The recording.
    labels : LabelFile or None
        Its labels.
    labelled_frames : range, optional
        Labelled frames to use, counted from 0; by default all.
    """

    config: Config
    options: CalibrateOptions
    recording: Recording
    labels: LabelFile | None
    labelled_frames: range | None = None

    @property
    def reads(self) -> Sequence[Location]:
        """Files and folders that the work reads."""
        return inputs_of_work(self.recording, self.options.reading, self.labels)

    def run(self, observer: Observer) -> Calibrated:
        """Return the sums over the recording; an error ends the whole run."""
        started, found = perf_counter(), self.read(observer)
        return Calibrated(
            recording=self.recording.name,
            damage=found.tally.damage,
            seconds=perf_counter() - started,
            frames=found.tally.frames,
            points=found.calibration.points,
            packed=zlib.compress(pickle.dumps(found), level=1),
        )

    def without_result(self, reason: str | None) -> Calibrated:
        """Return an outcome without sums."""
        return Calibrated(recording=self.recording.name, error=reason)

    def read(self, observer: Observer) -> "_Pass":
        """Return the sums over the recording."""
        found = _Pass(self.config, self.options)
        with closing(self.options.reading.open(self.recording)) as source:
            found.read(source, self.labels.open() if self.labels else None, observer, self.labelled_frames)
        return found


class _Pass:
    """Sums over recordings, from a single pass over each."""

    def __init__(self, config: Config, options: CalibrateOptions) -> None:
        self._config, self._options = config, options
        params: RingIntensityParams = config.filter
        self.calibration = Calibration(
            params, filter_rate=options.filter_rate, max_left=options.max_left, keep_end=options.keeps_end
        )
        self.tally = ClutterTally()
        self._search = MountingSearch(params.mounting) if isinstance(params, ConfirmedParams) else None
        self._density: ClutterDensity | None = None
        if options.plot_file:
            self._density = ClutterDensity(params.start_m, params.ring_width_m, MAX_RINGS)

    def read(self, source: Source, labels: Labels | None, observer: Observer, part: range | None = None) -> None:
        """Add the clutter of a recording, or of a part of its labelled frames, counted from 0."""
        selection = self._options.reading.selection
        clouds = cloud_channels(source, selection.topics)
        topics = sorted({channel.topic for channel in clouds})
        if labels and len(topics) > 1:
            raise UsageError(f"{source.name}: labels apply to one topic; choose from: -t {' -t '.join(topics)}")
        selector = ClutterSelector(self._config.filter, labels, self._config.evaluation.box_margin_m)
        total = expected_frames(source, clouds, selection)
        search = None if labels else TargetSearch(self._config.filter, self.tally.targets)
        with warnings_of(source, observer), observer.progress(source.name, total) as step:
            for frame, clutter in map_frames(source, selection, selector.clutter):
                if part is not None and selector.frames - 1 not in part:
                    continue
                self._add(frame, clutter)
                self.tally.note_frame(frame)
                if search:
                    search.add(frame)
                step()
        if search:
            search.finish()
        require_frames(source, selector.frames + selector.unlabelled, selection)
        finish_labels(labels, source, selection)
        self.tally.add(source, selector)

    def use(self, candidate: Candidate) -> None:
        """Use a filter rate, and a limit of the points that are left, from now on."""
        self.calibration.filter_rate, self.calibration.max_left = candidate.filter_rate, candidate.max_left

    def config(self, candidate: Candidate) -> Config:
        """Return the configuration with the thresholds of a candidate."""
        self.use(candidate)
        found = self.calibration.thresholds()
        params = replace(self._config.filter, end_m=found.end_m, initial_thresholds=found.initial_thresholds)
        return replace(self._config, filter=params)

    def __iadd__(self, other: Self) -> Self:
        """Add the sums over later recordings, which must not be used afterwards."""
        self.calibration += other.calibration
        self.tally += other.tally
        if self._search is not None and other._search is not None:
            self._search += other._search
        if self._density is not None and other._density is not None:
            self._density += other._density
        return self

    def _add(self, frame: Frame, clutter: NDArray[np.intp]) -> None:
        range_m, intensity = frame.range_m[clutter], frame.intensity[clutter]
        self.calibration.see(frame.intensity[frame.valid])
        self.calibration.add(range_m, intensity)
        if self._density is not None:
            self._density.add(range_m, intensity)
        time_s = frame.stamp_ns / 1e9
        if self._search is not None and self._search.wants(time_s):
            self._search.add(frame.coordinates[:, clutter], time_s)

    def result(self, trade_off: TradeOff | None) -> CalibrationResult:
        """Return the calibration from all recordings."""
        tally, calibration = self.tally, self.calibration
        if tally.unlabelled and not tally.frames:
            frames = count(tally.unlabelled, "frame")
            raise LabelError(f"{frames} read, none of them labelled; choose frames with labels, or leave out --labels")
        labelled = bool(self._options.labels.paths)
        output = self._options.output
        mounting = self._search.found() if self._search is not None else None
        thresholds = calibration.thresholds()
        return CalibrationResult(self._config, calibration, thresholds, tally, labelled, output, mounting, trade_off)

    def plot(self, found: Thresholds, suffix: str) -> bytes:
        """Return the content of the plot file."""
        density = self._density
        assert density is not None  # noqa: S101 - always set if a plot is requested
        return render(lambda figure: draw_clutter(figure, density, found), suffix)
