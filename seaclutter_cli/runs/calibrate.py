"""Calibration: thresholds and the far limit of clutter, from recordings that hold clutter."""

from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.calibration import FILTER_RATE, Calibration, ClutterSelector, Thresholds
from seaclutter_cli.config import Config
from seaclutter_cli.errors import LabelError, UsageError
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.filters.ring_params import RingIntensityParams
from seaclutter_cli.filters.zones import MAX_RINGS
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.pipeline import cloud_channels, map_frames
from seaclutter_cli.plots.clutter import ClutterDensity, draw_clutter
from seaclutter_cli.plots.figure import check_target, render
from seaclutter_cli.runs.calibrate_result import CalibrationResult, ClutterTally
from seaclutter_cli.runs.labels import LabelSources
from seaclutter_cli.runs.methods import ConfigOptions
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import check_outputs, inputs_of, write_files
from seaclutter_cli.runs.recordings import (
    Logs,
    ReadOptions,
    expand,
    expected_frames,
    finish_labels,
    require_frames,
    warnings_of,
)
from seaclutter_cli.text import count


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions:
    """How thresholds are derived, and what is written.

    Parameters
    ----------
    config : ConfigOptions
        Configuration to start from; its method must have ring thresholds.
    filter_rate : float
        Share of the clutter points of each ring that are to be below its threshold.
    keep_end : bool
        Keep the far limit of the configuration; so does an override of ``filter.end_m``.
    labels : LabelSources
        Labels of targets and areas that are left out.
    reading : ReadOptions
        What is read.
    output : Path or None
        Configuration with what was found.
    plot_file : Path or None
        Picture of clutter and thresholds over range.
    force : bool
        Replace existing files.
    """

    config: ConfigOptions = field(default_factory=ConfigOptions)
    filter_rate: float = FILTER_RATE
    keep_end: bool = False
    labels: LabelSources = field(default_factory=LabelSources)
    reading: ReadOptions = field(default_factory=ReadOptions)
    output: Path | None = None
    plot_file: Path | None = None
    force: bool = False

    @property
    def keeps_end(self) -> bool:
        """Whether the far limit is given."""
        keys = (override.partition("=")[0].strip() for override in self.config.overrides)
        return self.keep_end or "filter.end_m" in keys


def calibrate_logs(logs: Logs, options: CalibrateOptions, observer: Observer = SILENT) -> CalibrationResult:
    """Derive the threshold of each ring and the far limit of clutter from recordings.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs that hold sea clutter and, unless there are labels, no targets.
    options : CalibrateOptions
        How, and what is written.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If any recording cannot be used: thresholds from a part of them would look like thresholds from all.
    """
    config = _starting_config(options.config)
    recordings = expand(logs)
    if options.plot_file:
        check_target(options.plot_file)
    check_outputs([options.output, options.plot_file], inputs_of(recordings), options.labels.paths, force=options.force)
    labels = options.labels.open(recordings)
    pass_ = _Pass(config, options, observer)
    for recording, own in zip(recordings, labels, strict=True):
        with closing(options.reading.open(recording)) as source:
            pass_.read(source, own)
            observer.damage(source.damage)
    result = pass_.result()
    files = {options.output: result.config_text().encode()} if options.output else {}
    if options.plot_file:
        files[options.plot_file] = pass_.picture(result.found, options.plot_file.suffix)
    write_files(files)
    return result


def _starting_config(options: ConfigOptions) -> Config:
    """Return the configuration to start from; its thresholds are open."""
    config = options.load(open_thresholds=True)
    if not isinstance(config.filter, RingIntensityParams):
        fitting = (name for name, kind in FILTERS.items() if issubclass(kind.Params, RingIntensityParams))
        raise UsageError(f"method {config.method} has no ring thresholds to find; choose -m {', -m '.join(fitting)}")
    return config


class _Pass:
    """The one pass over all recordings."""

    def __init__(self, config: Config, options: CalibrateOptions, observer: Observer) -> None:
        self._config, self._options, self._observer = config, options, observer
        params: RingIntensityParams = config.filter
        self._calibration = Calibration(params, filter_rate=options.filter_rate, keep_end=options.keeps_end)
        self._tally = ClutterTally()
        self._density: ClutterDensity | None = None
        if options.plot_file:
            self._density = ClutterDensity(params.start_m, params.ring_width_m, MAX_RINGS)

    def read(self, source: Source, labels: Labels | None) -> None:
        """Take the clutter of a recording."""
        selection = self._options.reading.selection
        clouds = cloud_channels(source, selection.topics)
        topics = sorted({channel.topic for channel in clouds})
        if labels and len(topics) > 1:
            raise UsageError(f"{source.name}: labels are of one topic; choose from: -t {' -t '.join(topics)}")
        selector = ClutterSelector(self._config.filter, labels, self._config.evaluation.box_margin_m)
        total = expected_frames(source, clouds, selection)
        with warnings_of(source, self._observer), self._observer.progress(source.name, total) as step:
            for frame, clutter in map_frames(source, selection, selector.clutter):
                self._take(frame, clutter)
                self._tally.look_at(source.name, frame)
                step()
        require_frames(source, selector.frames + selector.unlabelled)
        finish_labels(labels, source, selection)
        self._tally.add(source, selector, topics)

    def _take(self, frame: Frame, clutter: NDArray[np.intp]) -> None:
        range_m, intensity = frame.range_m[clutter], frame.intensity[clutter]
        self._calibration.add(range_m, intensity)
        if self._density is not None:
            self._density.add(range_m, intensity)

    def result(self) -> CalibrationResult:
        """Return what comes of all recordings."""
        tally, calibration = self._tally, self._calibration
        if tally.unlabelled and not tally.frames:
            frames = count(tally.unlabelled, "frame")
            raise LabelError(f"not one of {frames} is labelled: nothing tells what is clutter")
        labelled = bool(self._options.labels.paths)
        output = self._options.output
        return CalibrationResult(self._config, calibration, calibration.thresholds(), tally, labelled, output)

    def picture(self, found: Thresholds, suffix: str) -> bytes:
        """Return the file of the picture."""
        density = self._density
        assert density is not None  # noqa: S101 - there is one if a picture is asked for
        return render(lambda figure: draw_clutter(figure, density, found), suffix)
