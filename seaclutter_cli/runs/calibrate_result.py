"""Sums of a calibration over recordings, and its result: as a configuration, as text and as data."""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

from seaclutter_cli.arrays import Indices
from seaclutter_cli.calibration import Calibration, Thresholds, few_points
from seaclutter_cli.config import Config, SensorParams
from seaclutter_cli.errors import InputError
from seaclutter_cli.evaluation.scores import Summary, best
from seaclutter_cli.filters.confirmation import ConfirmedParams
from seaclutter_cli.filters.joint import RingIntensityParams
from seaclutter_cli.filters.zones import MAX_RINGS
from seaclutter_cli.frame import Frame
from seaclutter_cli.plots.curves import ClutterDensity
from seaclutter_cli.records import Damage
from seaclutter_cli.runs.options.logs import CalibrateOptions
from seaclutter_cli.runs.recordings import RecordingsResult, data_of
from seaclutter_cli.runs.score_tables import F1, FALSE_ALARMS, N_FN, N_FP, POINTS, score_cells, score_legend
from seaclutter_cli.runs.topic_statistics import Described
from seaclutter_cli.sensors.catalog import RecognisedSensor
from seaclutter_cli.text import count, printable, share, table
from seaclutter_cli.water import Mounting, MountingSearch

_COLUMNS = (N_FP, N_FN, F1, FALSE_ALARMS, POINTS[1])
_BEST, _USED = "<", "used"
_COMMENT_WIDTH = 100
_OF_RING = "start_m end_m points threshold below filter_rate few_points=few source_rings=source saturated"
_COUNTED = ("frames", "unlabelled", "marked", "examined", "with_targets")
_TEXT_WIDTH = 79
_MIN_SHARE = 0.2


class Clutter:
    """Clutter points of recordings: intensities by range ring and, if they are asked for, a mounting and a plot."""

    def __init__(self, params: RingIntensityParams, options: CalibrateOptions) -> None:
        keys = [setting.partition("=")[0].strip() for setting in options.settings]
        keep_end = options.keep_end or "filter.end_m" in keys
        rate, left = options.filter_rate, options.max_left
        self.calibration = Calibration(params, filter_rate=rate, max_left=left, keep_end=keep_end)
        self.search = MountingSearch(params.mounting) if isinstance(params, ConfirmedParams) else None
        width_m = params.ring_width_m
        self.density = ClutterDensity(params.own_ship_m, width_m, MAX_RINGS) if options.plot_file else None

    def add(self, frame: Frame, clutter: Indices) -> None:
        """Add a frame with the indices of its clutter points."""
        range_m, intensity = frame.range_m[clutter], frame.intensity[clutter]
        self.calibration.see(frame.intensity[frame.valid])
        self.calibration.add(range_m, intensity)
        if self.density is not None:
            self.density.add(range_m, intensity)
        time_s = frame.stamp_ns / 1e9
        if self.search is not None and self.search.wants(time_s):
            self.search.add(frame.coordinates[:, clutter], time_s)

    def __iadd__(self, other: Self) -> Self:
        """Add the points of later recordings, which must not be used afterwards."""
        self.calibration += other.calibration
        if self.search is not None and other.search is not None:
            self.search += other.search
        if self.density is not None and other.density is not None:
            self.density += other.density
        return self


@dataclass(kw_only=True)
class Calibrated(Described):
    """Outcome of one recording: numbers of frames and points, and its clutter, until it is added to that of others.

    Frames and points that labels leave out are ``unlabelled`` and ``marked``. Without labels, ``examined`` frames with
    water were searched for objects that rise out of it. The first frames of each topic show its sensor.
    """

    frames: int = 0
    unlabelled: int = 0
    marked: int = 0
    examined: int = 0
    with_targets: int = 0
    clutter: Clutter | None = field(default=None, repr=False)

    def check_sensors(self, earlier: "Sequence[Calibrated]") -> None:
        """Raise `InputError` if a topic is known to be of another sensor than one before, or another intensity mode."""
        before = [(f"{one.recording}, {topic}", known) for one in earlier for topic, known in one.recognised.items()]
        for topic, sensor in self.recognised.items():
            for where, known in before:
                if sensor.differs_from(known):
                    raise InputError(
                        f"{self.recording}, {topic}: sensor {sensor.described}, but {known.described} in {where}; "
                        "thresholds are valid for one sensor and intensity mode, so calibrate each by itself"
                    )
            before.append((f"{self.recording}, {topic}", sensor))

    def figures(self) -> str:
        """Return the main figures, for a line about the outcome."""
        points = self.clutter.calibration.points if self.clutter else 0
        return f"{count(self.frames, 'frame')}, {count(points, 'clutter point')}, {self.seconds:.1f} s"


class Candidate(NamedTuple):
    """A way to set the thresholds: the share of clutter points to remove in each range ring, and most that are left."""

    filter_rate: float
    max_left: float | None = None


@dataclass(frozen=True)
class TradeOff:
    """Scores of candidates on frames that gave no thresholds, and the candidate that is used."""

    scores: Mapping[Candidate, Summary]
    used: Candidate

    @property
    def best(self) -> Candidate:
        """Candidate with the fewest frames with an error, then the fewest errors; in a tie, the first."""
        return best(self.scores) or self.used

    def as_dict(self) -> dict[str, Any]:
        """Return the scores as JSON-compatible data."""
        rows = [
            {**one._asdict(), **summary.as_dict(timed=False), "best": one == self.best, "used": one == self.used}
            for one, summary in self.scores.items()
        ]
        return {"candidates": rows}

    def as_text(self) -> str:
        """Return the scores as a table."""
        cells = score_cells(self.scores, _COLUMNS)
        rows = []
        for one in self.scores:
            notes = [_BEST] * (one == self.best) + [_USED] * (one == self.used)
            left = "" if one.max_left is None else f"{one.max_left:g}"
            rows.append((f"{one.filter_rate:g}", left, *cells[one], " ".join(notes)))
        frames = max(summary.frames for summary in self.scores.values())
        title = f"On {count(frames, 'labelled frame')}, each half with thresholds from the other:"
        lines = table(("filter rate", "max left", *(column.head for column in _COLUMNS), ""), rows)
        others = {
            "max left": "clutter points per frame that a range ring may keep",
            _BEST: "fewest frames with an error, then fewest errors; in a tie, the first",
        }
        return f"{title}\n\n{lines}\n\n{score_legend(lines, _COLUMNS, others)}"


@dataclass(frozen=True)
class CalibrationResult(RecordingsResult[Calibrated]):
    """Result of a calibration, which started from a configuration: thresholds and far limit.

    It is ``labelled`` if labels separated clutter from targets. There is a ``mounting`` of the lidar if the water shows
    another one than the start configuration, a ``trade_off`` if filter rates were compared.
    """

    is_summary = True
    data = (
        "output recordings frames=total.frames unlabelled_frames=total.unlabelled labelled "
        "labelled_points=total.marked filter_rate=calibration.filter_rate max_left=calibration.max_left sensors "
        "intensity_fields intensity=calibration.intensity clutter_points=calibration.points "
        "points_beyond=found.beyond last_m=found.last_m start_m=found.start_m end_m=found.end_m "
        "end_kept=calibration.keep_end rings mounting trade_off warnings damage"
    )

    start: Config
    calibration: Calibration
    found: Thresholds
    labelled: bool
    output: Path | None = None
    mounting: Mounting | None = None
    trade_off: TradeOff | None = None

    @property
    def total(self) -> Calibrated:
        """Numbers of frames and points of all recordings."""
        sums: dict[str, Any] = {name: sum(getattr(one, name) for one in self.outcomes) for name in _COUNTED}
        return Calibrated(recording=", ".join(self.recordings), **sums)

    @property
    def recordings(self) -> list[str]:
        """Names of the recordings with frames in the selected time."""
        return [one.recording for one in self.outcomes if not one.has_nothing]

    @property
    def damage(self) -> list[Damage]:
        """Parts of the input that were damaged and left out."""
        return [item for one in self.outcomes for item in one.damage]

    @property
    def seen(self) -> list[RecognisedSensor]:
        """Sensor of each topic."""
        return [sensor for one in self.outcomes for sensor in one.recognised.values()]

    @property
    def sensors(self) -> list[str]:
        """Sensors that the recordings state or, without one, resemble."""
        stated = [name for sensor in self.seen for name in sensor.models if sensor.is_stated]
        return list(dict.fromkeys(stated or [name for sensor in self.seen for name in sensor.models]))

    @property
    def sensor(self) -> SensorParams:
        """Sensor model and intensity mode, if a recording states them."""
        models = (name for sensor in self.seen for name in sensor.models if sensor.is_stated)
        modes = (sensor.intensity for sensor in self.seen if sensor.intensity)
        return SensorParams(model=next(models, None), intensity=next(modes, None))

    @property
    def intensity_fields(self) -> list[str]:
        """Names of the fields with intensities."""
        names = (cloud.intensity_name for one in self.outcomes for cloud in one.clouds.values())
        return list(dict.fromkeys(filter(None, names)))

    @property
    def config(self) -> Config:
        """Configuration with the thresholds, the far limit and the mounting that were found."""
        params = self.found.applied_to(self.start.filter)
        if self.mounting:
            roll, pitch = self.mounting.roll_deg, self.mounting.pitch_deg
            params = replace(params, mounting_roll_deg=roll, mounting_pitch_deg=pitch)
        return replace(self.start, filter=params, sensor=self.sensor)

    @property
    def warnings(self) -> list[str]:
        """Reasons to doubt the thresholds, one sentence each."""
        rings, total = self.found.rings, self.total
        used = sum(ring.points for ring in rings)
        found = []
        if total.with_targets > _MIN_SHARE * total.examined:
            found.append(
                f"objects rise out of the water in {total.with_targets:,} of {count(total.examined, 'examined frame')},"
                " and raise the thresholds; label them (--labels), or choose a log without targets"
            )
        if used < few_points(self.calibration.filter_rate):
            found.append(f"the thresholds are from {count(used, 'clutter point')} only; use longer logs")
        if saturated := [ring for ring in rings if ring.saturated]:
            spans = ", ".join(f"{ring.start_m:g} to {ring.end_m:g} m" for ring in saturated)
            found.append(
                f"{spans}: too many points have the highest intensity, {self.calibration.highest:g}: the lidar is "
                "saturated, or these are targets; thresholds end there and remove less than the filter rate"
            )
        return found

    def config_text(self) -> str:
        """Return the configuration as YAML, with comments that describe its origin."""
        left = self.calibration.max_left
        rate = f"{self.calibration.filter_rate:g}"
        rate += "" if left is None else f" and at most {left:g} clutter points per frame left in a range ring"
        names = ", ".join(map(printable, self.recordings))
        head = f"Thresholds found by seaclutter calibrate with a filter rate of {rate} in {names}."
        form = textwrap.TextWrapper(_COMMENT_WIDTH - 2, break_on_hyphens=False, break_long_words=False)
        lines = [line for text in (head, *self._sentences()) for line in form.wrap(text)]
        comments = "".join(f"# {line}".rstrip() + "\n" for line in (*lines, *self._table()))
        return comments + self.config.to_yaml(comments=True)

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        body = [line for text in self._sentences() for line in textwrap.wrap(text, _TEXT_WIDTH - 2)]
        title = printable(self.total.recording)
        if self.output:
            title += f" -> {printable(str(self.output))}"
        text = "\n".join((title, *(f"  {line}" for line in (*body, *self._table()))))
        return f"{text}\n\n{self.trade_off.as_text()}" if self.trade_off else text

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-compatible data."""
        return {name: one for name, one in super().as_dict().items() if one or name not in ("mounting", "trade_off")}

    def rings(self) -> list[dict[str, Any]]:
        """Return JSON-compatible data of the range rings."""
        pairs = zip(self.found.rings, self.found.initial_thresholds, strict=True)
        return [{**data_of(ring, _OF_RING), "threshold": threshold} for ring, threshold in pairs]

    def _sentences(self) -> list[str]:
        found, total = self.found, self.total
        least, most = self.calibration.intensity
        without = f" ({count(total.unlabelled, 'unlabelled frame')} left out)" if total.unlabelled else ""
        left_out = f"{count(total.marked, 'labelled point')} left out"
        labels = left_out if self.labelled else "no labels: all treated as clutter"
        name = printable(" or ".join(self.intensity_fields)) or "none"
        points = f"{count(self.calibration.points, 'clutter point')} from {found.start_m:g} m outwards"
        frames = f"{count(total.frames, 'frame')}{without}"
        likely = f"resembles {' or '.join(self.sensors)}" if self.sensors else "not recognised"
        limit = f"in whole range rings, clutter ends at {found.end_m:g} m."
        if self.calibration.keep_end:
            limit = f"the given far limit of {found.end_m:g} m is kept."
        mounted = []
        if (mounting := self.mounting) and (given := self.start.filter.mounting):
            mounted.append(
                f"Mounting: roll {mounting.roll_deg:g}°, pitch {mounting.pitch_deg:g}°, from the attitude of the water "
                f"in the first seconds; roll {given.roll_deg:g}° and pitch {given.pitch_deg:g}° were given."
            )
        return [
            f"{frames}; {points} ({labels}), {found.beyond:,} of them beyond {found.end_m:g} m.",
            f"Sensor {self.sensor.model or likely}; intensity field {name}, {least:g} to {most:g} in clutter.",
            f"Beyond {found.last_m:.2f} m, consecutive clutter points are more than 1 m apart in range; {limit}",
            *mounted,
        ]

    def _table(self) -> list[str]:
        rows, notes = [], []
        for ring in self.found.rings:
            below = share(ring.below, ring.points)
            span = f"{ring.start_m:g} to {ring.end_m:g} m"
            rows.append((span, f"{ring.points:,}", f"{ring.threshold:.9g}", below))
            note = "saturated" if ring.saturated else ""
            if ring.few:
                first, last = ring.source
                rings = f"rings {first} to {last}" if first < last else f"ring {last}"
                note = f"{note or ('few points' if ring.points else 'no points')}: {rings}"
            notes.append(note or "no point passes" * (self.calibration.filter_rate == 1))
        return table(("range ring", "clutter points", "threshold", "below"), rows, notes).splitlines()
