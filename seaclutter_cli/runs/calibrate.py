"""Calibration: thresholds and the far limit of clutter, from recordings that contain clutter."""

from contextlib import closing
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.calibration import FILTER_RATE, Calibration, ClutterSelector, Thresholds
from seaclutter_cli.config import Config
from seaclutter_cli.errors import LabelError, UsageError
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.filters.confirmation.params import ConfirmedParams
from seaclutter_cli.filters.ring_params import RingIntensityParams
from seaclutter_cli.filters.zones import MAX_RINGS
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.pipeline import map_frames
from seaclutter_cli.plots.clutter import ClutterDensity, draw_clutter
from seaclutter_cli.plots.figure import check_target, render
from seaclutter_cli.runs.calibrate_result import CalibrationResult, ClutterTally
from seaclutter_cli.runs.labels import LabelSources
from seaclutter_cli.runs.methods import ConfigOptions
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import inputs_of, prepare_outputs, write_files
from seaclutter_cli.runs.recordings import (
    Logs,
    ReadOptions,
    expand,
    expected_frames,
    finish_labels,
    require_frames,
    warnings_of,
)
from seaclutter_cli.selection import cloud_channels
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
    keep_end : bool
        Keep the far limit of the configuration; an override of ``filter.end_m`` has the same effect.
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
    """

    config: ConfigOptions = field(default_factory=ConfigOptions)
    filter_rate: float = FILTER_RATE
    keep_end: bool = False
    labels: LabelSources = field(default_factory=LabelSources)
    reading: ReadOptions = field(default_factory=ReadOptions)
    output: Location | None = None
    plot_file: Location | None = None
    force: bool = False

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
    recordings = expand(logs)
    if options.plot_file:
        check_target(options.plot_file)
    prepare_outputs(
        {"-o": options.output, "--plot": options.plot_file},
        inputs_of(recordings, options.reading, options.config.file, [config]),
        options.labels.paths,
        force=options.force,
        observer=observer,
    )
    labels = options.labels.open(recordings)
    pass_ = _Pass(config, options, observer)
    for recording, own in zip(recordings, labels, strict=True):
        with closing(options.reading.open(recording)) as source:
            pass_.read(source, own)
            observer.damage(source.damage)
    result = pass_.result()
    files = {options.output: result.config_text().encode()} if options.output else {}
    if options.plot_file:
        files[options.plot_file] = pass_.plot(result.found, options.plot_file.suffix)
    write_files(files, replace=options.force)
    return result


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


class _Pass:
    """Single pass over all recordings."""

    def __init__(self, config: Config, options: CalibrateOptions, observer: Observer) -> None:
        self._config, self._options, self._observer = config, options, observer
        params: RingIntensityParams = config.filter
        self._calibration = Calibration(params, filter_rate=options.filter_rate, keep_end=options.keeps_end)
        self._tally = ClutterTally()
        self._search = MountingSearch(params.mounting) if isinstance(params, ConfirmedParams) else None
        self._density: ClutterDensity | None = None
        if options.plot_file:
            self._density = ClutterDensity(params.start_m, params.ring_width_m, MAX_RINGS)

    def read(self, source: Source, labels: Labels | None) -> None:
        """Add the clutter of a recording."""
        selection = self._options.reading.selection
        clouds = cloud_channels(source, selection.topics)
        topics = sorted({channel.topic for channel in clouds})
        if labels and len(topics) > 1:
            raise UsageError(f"{source.name}: labels apply to one topic; choose from: -t {' -t '.join(topics)}")
        selector = ClutterSelector(self._config.filter, labels, self._config.evaluation.box_margin_m)
        total = expected_frames(source, clouds, selection)
        with warnings_of(source, self._observer), self._observer.progress(source.name, total) as step:
            for frame, clutter in map_frames(source, selection, selector.clutter):
                self._add(frame, clutter)
                self._tally.note_frame(frame)
                step()
        require_frames(source, selector.frames + selector.unlabelled)
        finish_labels(labels, source, selection)
        self._tally.add(source, selector)

    def _add(self, frame: Frame, clutter: NDArray[np.intp]) -> None:
        range_m, intensity = frame.range_m[clutter], frame.intensity[clutter]
        self._calibration.add(range_m, intensity)
        if self._density is not None:
            self._density.add(range_m, intensity)
        time_s = frame.stamp_ns / 1e9
        if self._search is not None and self._search.wants(time_s):
            self._search.add(frame.coordinates[:, clutter], time_s)

    def result(self) -> CalibrationResult:
        """Return the calibration from all recordings."""
        tally, calibration = self._tally, self._calibration
        if tally.unlabelled and not tally.frames:
            frames = count(tally.unlabelled, "frame")
            raise LabelError(f"{frames} read, none of them labelled; choose frames with labels, or leave out --labels")
        labelled = bool(self._options.labels.paths)
        output = self._options.output
        mounting = self._search.found() if self._search is not None else None
        return CalibrationResult(self._config, calibration, calibration.thresholds(), tally, labelled, output, mounting)

    def plot(self, found: Thresholds, suffix: str) -> bytes:
        """Return the content of the plot file."""
        density = self._density
        assert density is not None  # noqa: S101 - always set if a plot is requested
        return render(lambda figure: draw_clutter(figure, density, found), suffix)
