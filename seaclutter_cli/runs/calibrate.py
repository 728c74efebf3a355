"""Calibration: thresholds and the far limit of clutter, from recordings that contain clutter."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.calibration import Calibration, ClutterSelector
from seaclutter_cli.config import Config
from seaclutter_cli.errors import FieldError, LabelError, TopicError, UsageError
from seaclutter_cli.evaluation.scores import Parts, Summary
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.filters.confirmation import ConfirmedParams
from seaclutter_cli.filters.confirmed import Confirmed
from seaclutter_cli.filters.joint import RingIntensityParams
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.pipeline import map_frames
from seaclutter_cli.plots.curves import draw_clutter
from seaclutter_cli.plots.figure import render
from seaclutter_cli.runs.batch import RecordingWork, prepared, run_all
from seaclutter_cli.runs.calibrate_result import Calibrated, CalibrationResult, Candidate, Clutter, TradeOff
from seaclutter_cli.runs.evaluate import EvaluateWork
from seaclutter_cli.runs.methods import Variant, configured
from seaclutter_cli.runs.observer import Observer, Silent, raising
from seaclutter_cli.runs.options import ConfigOptions
from seaclutter_cli.runs.options.logs import CalibrateOptions
from seaclutter_cli.runs.outputs import write_files
from seaclutter_cli.selection import cloud_channels
from seaclutter_cli.text import count

_RATES = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98)
_MAX_LEFT = (20.0, 10.0, 5.0, 2.0)
_TRAINED, _HELD_OUT = 0.4, 0.5
_MIN_FRAMES = 20
_SEARCHED_S, _EVERY_S = 2.0, 20.0
_MIN_TARGET_POINTS = 5
_OF_TARGETS = (
    *("start_m", "ring_width_m", "exclude_boxes", "exclude_polygons", "mask"),
    *("mounting_roll_deg", "mounting_pitch_deg"),
)
"""Parameters of any method that the search for targets uses."""


@use_case_of(CalibrateOptions)
def calibrate(options: CalibrateOptions) -> CalibrationResult:
    """Derive the threshold of each range ring and the far limit from logs that contain sea clutter.

    Returns
    -------
    CalibrationResult
        ``config``, to filter with; ``found``, the threshold of each range ring.

    Examples
    --------
    >>> import seaclutter
    >>> result = seaclutter.calibrate("samples/sea.mcap", labels="samples/sea.labels.csv")
    >>> result.config.method, len(result.found.rings)
    ('joint', 6)
    """
    observer = options.watching
    config = _starting_config(options)
    if (options.choose or options.trade_off) and not options.labels:
        raise UsageError(f"{'--choose' if options.choose else '--trade-off'}: filter rates are compared by --labels")
    pairs = prepared(options, observer, [config])
    works = [_CalibrateWork(options.reading, *each, config, options) for each in pairs]
    clutter, read = Clutter(config.filter, options), list[Calibrated]()

    def add(outcome: Calibrated) -> None:
        nonlocal clutter
        outcome.check_sensors(read)
        read.append(outcome)
        if outcome.clutter:
            clutter += outcome.clutter
        outcome.clutter = None

    outcomes = run_all(works, options, raising(observer), add)  # thresholds are from all or none
    used = [pair for pair in zip(works, outcomes, strict=True) if not pair[1].has_nothing]
    trade_off = _trade_off(used, clutter.calibration, observer) if options.choose or options.trade_off else None
    _check(outcomes, clutter)
    mounting = clutter.search.found() if clutter.search is not None else None
    found, labelled = clutter.calibration.thresholds(), bool(options.labels)
    result = CalibrationResult(
        outcomes, config, clutter.calibration, found, labelled, options.output, mounting, trade_off
    )
    for text in result.warnings:
        observer.warn(text)
    files = {options.output: result.config_text().encode()}
    if options.plot_file:
        suffix = options.plot_file.suffix
        files[options.plot_file] = render(draw_clutter, suffix, density=clutter.density, found=result.found)
    write_files(files, replace=options.force)
    return result


def _starting_config(options: ConfigOptions) -> Config:
    config = configured(options, undetermined_thresholds=True)
    if not isinstance(config.filter, RingIntensityParams):
        suitable = (name for name, kind in FILTERS.items() if issubclass(kind.Params, RingIntensityParams))
        raise UsageError(f"method {config.method} has no thresholds to calibrate; choose -m {', -m '.join(suitable)}")
    if isinstance(config.filter, ConfirmedParams) and not config.filter.use_intensity:
        raise UsageError(
            "with use_intensity: false there are no thresholds to calibrate; if the lidar is mounted tilted or upside "
            "down, filter names the keys to set"
        )
    return config


def _check(outcomes: Sequence[Calibrated], clutter: Clutter) -> None:
    """Raise an error if there is nothing that could give thresholds."""
    unlabelled = sum(one.unlabelled for one in outcomes)
    if unlabelled and not any(one.frames for one in outcomes):
        frames = count(unlabelled, "frame")
        raise LabelError(f"{frames} read, none of them labelled; choose frames with labels, or leave out --labels")
    if clutter.calibration.highest == 0:
        others = (cloud.other_intensity for one in outcomes for cloud in one.clouds.values() if cloud.other_intensity)
        hint = next((f"; use --intensity-field {name}" for name in others), "")
        raise FieldError(f"the intensities are always 0, so they give no thresholds{hint}")


def _trade_off(
    pairs: Sequence[tuple["_CalibrateWork", Calibrated]], found: Calibration, observer: Observer
) -> TradeOff:
    """Return the scores of several filter rates and limits on held-out frames; with ``choose``, use the best one.

    One filter rate for all range rings leaves many points where clutter is dense, which cluster to false alarms, and
    removes faint targets where there is hardly any clutter. Rates that leave the same number of points per frame do
    neither. Each half of the labelled frames is judged with thresholds from the other half. A fifth of the frames, in
    the middle, gives no thresholds: neighbouring frames are alike.
    """
    works = [work for work, _ in pairs]
    config, options, frames = works[0].config, works[0].options, sum(outcome.frames for _, outcome in pairs)
    if frames < _MIN_FRAMES:
        raise LabelError(f"{count(frames, 'labelled frame')}: too few to compare filter rates")
    quiet = Silent()  # warnings and damage were reported when the log was read before
    quiet.progress = observer.progress  # type: ignore[method-assign]
    observer = raising(quiet)
    used = Candidate(options.filter_rate, options.max_left)
    compared = candidates(used)
    variants = []
    for half in (0, 1):
        training = Clutter(config.filter, options)
        for work, outcome in pairs:
            part = replace(work, labelled_frames=training_frames(outcome.frames)[half]).run(observer)
            training += part.clutter or Clutter(config.filter, options)
        for one in compared:
            training.calibration.filter_rate, training.calibration.max_left = one
            params = training.calibration.thresholds().applied_to(config.filter)
            variants.append(Variant(f"{one} ({half})", replace(config, filter=params)))
    # The first half of the variants have thresholds from the first frames, the second half those from the last ones.
    scores, number = [Summary() for _ in compared], len(compared)
    for work in works:
        judged = EvaluateWork(work.reading, work.recording, work.labels, variants, in_parts=True).run(observer)
        first, last = (judged.parts or Parts(len(variants))).split(_HELD_OUT)
        for total, *halves in zip(scores, last[:number], first[number:], strict=True):
            for summary in halves:
                total.update(summary)
    trade_off = TradeOff(dict(zip(compared, scores, strict=True)), used)
    if not options.choose:
        return trade_off
    found.filter_rate, found.max_left = trade_off.best
    return replace(trade_off, used=trade_off.best)


def candidates(given: Candidate) -> list[Candidate]:
    """Return the candidates that are compared, the least strict first: single rates, then limits of what is left."""
    rates = [Candidate(rate) for rate in sorted({*_RATES, given.filter_rate})]
    limits = [Candidate(given.filter_rate, left) for left in sorted({*_MAX_LEFT, given.max_left or 2.0}, reverse=True)]
    return [*rates, *limits]


def training_frames(frames: int) -> tuple[range, range]:
    """Return the labelled frames of a recording that give thresholds for its last half, and for its first half.

    Examples
    --------
    >>> training_frames(60)
    (range(0, 24), range(36, 60))
    """
    part = math.floor(_TRAINED * frames)
    return range(part), range(frames - part, frames)


@dataclass(frozen=True)
class _CalibrateWork(RecordingWork[Calibrated]):
    """Sums over one recording, or over a range of its labelled frames, counted from 0."""

    config: Config
    options: CalibrateOptions
    labelled_frames: range | None = None
    kind = Calibrated

    def study(self, source: Source, labels: Labels | None, outcome: Calibrated, observer: Observer) -> None:
        selection, params = self.reading.selection, self.config.filter
        found = outcome.clutter = Clutter(params, self.options)
        topics = sorted({channel.topic for channel in cloud_channels(source, selection.topics)})
        if labels and len(topics) > 1:
            raise TopicError(f"{source.name}: labels apply to one topic; choose from: -t {' -t '.join(topics)}")
        selector = ClutterSelector(params, labels, self.config.evaluation.box_margin_m)
        search = None if labels else _TargetSearch(params, outcome)
        every = map_frames(source, selection, selector.clutter)
        for frame, clutter in self.stepped(every, source, observer):
            if self.labelled_frames is None or selector.frames - 1 in self.labelled_frames:
                found.add(frame, clutter)
                outcome.note(frame)
                if search:
                    search.add(frame)
        if search:
            search.finish()
        self.finish(source, labels, selector.frames + selector.unlabelled)
        outcome.frames, outcome.unlabelled, outcome.marked = selector.frames, selector.unlabelled, selector.marked


class _TargetSearch:
    """Search of one recording for objects that rise out of the water and stay, in two of every 20 seconds.

    The method `Confirmed` decides, by shape and persistence alone: thresholds are not known yet. Frames without water
    are not counted, since objects cannot be distinguished from land there.
    """

    def __init__(self, params: RingIntensityParams, outcome: Calibrated) -> None:
        end_m = params.own_ship_m + params.ring_width_m  # without thresholds, one range ring is enough
        given: dict[str, Any] = {name: getattr(params, name) for name in _OF_TARGETS if hasattr(params, name)}
        self._params = ConfirmedParams(**given, end_m=end_m, initial_thresholds=(0,), use_intensity=False)
        self._outcome = outcome
        self._topics: dict[str, tuple[float, Confirmed]] = {}

    def add(self, frame: Frame) -> None:
        time_s = frame.stamp_ns / 1e9
        if frame.topic not in self._topics:
            self._topics[frame.topic] = time_s, Confirmed(self._params)
        start_s, method = self._topics[frame.topic]
        if (time_s - start_s) % _EVERY_S < _SEARCHED_S:
            self._count(method.process(frame))
        else:
            self._count(method.flush())
            method.reset()

    def finish(self) -> None:
        for _, method in self._topics.values():
            self._count(method.flush())

    def _count(self, results: Iterable[FilterResult]) -> None:
        for result in results:
            if result.water is None:
                continue
            kept = np.count_nonzero(result.keep & (result.frame.range_m >= self._params.own_ship_m))
            self._outcome.examined += 1
            self._outcome.with_targets += bool(kept >= _MIN_TARGET_POINTS)
