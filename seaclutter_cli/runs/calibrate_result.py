"""Result of a calibration: as a configuration, as text and as data."""

import textwrap
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from seaclutter_cli.calibration import Calibration, ClutterSelector, RingCalibration, Thresholds, few_points
from seaclutter_cli.config import Config, SensorParams
from seaclutter_cli.errors import InputError
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Damage
from seaclutter_cli.runs.calibrate_trade_off import TradeOff
from seaclutter_cli.runs.recordings import Result
from seaclutter_cli.runs.topic_statistics import TopicStatistics
from seaclutter_cli.sensors.catalog import RecognisedSensor
from seaclutter_cli.text import count, printable, share, table
from seaclutter_cli.water import Mounting

_COMMENT_WIDTH = 100
_TEXT_WIDTH = 79
_NOTED_FRAMES = 20
_MIN_SHARE = 0.2


@dataclass
class ClutterTally:
    """Sums over all recordings of a calibration, and facts about their sensors.

    Frames and points that labels leave out are ``unlabelled`` and ``marked``. Without labels, ``examined`` frames with
    water were searched for objects that rise out of it. ``seen`` has each topic, as ``recording, topic``, with its
    sensor.
    """

    frames: int = 0
    unlabelled: int = 0
    marked: int = 0
    frames_each: list[int] = field(default_factory=list)
    recordings: list[str] = field(default_factory=list)
    intensity_fields: list[str] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)
    seen: list[tuple[str, RecognisedSensor]] = field(default_factory=list)
    examined: int = 0
    with_targets: int = 0
    _topics: dict[str, TopicStatistics] = field(default_factory=dict)

    def note_frame(self, frame: Frame) -> None:
        """Note the layout and the intensity field of a topic, from its first frames."""
        cloud = self._topics.setdefault(frame.topic, TopicStatistics())
        if cloud.frames < _NOTED_FRAMES:
            cloud.add(frame)

    def add(self, source: Source, selector: ClutterSelector) -> None:
        """Add what is known at the end of the only recording."""
        for topic, cloud in self._topics.items():
            self.seen.append((f"{source.name}, {topic}", cloud.sensor(source.facts.get(topic))))
            self.intensity_fields += [cloud.intensity_name] if cloud.intensity_name else []
        self._topics.clear()
        self.recordings, self.damage = [source.name], source.damage
        self.frames, self.frames_each = selector.frames, [selector.frames]
        self.unlabelled, self.marked = selector.unlabelled, selector.marked

    def _add_sensor(self, where: str, sensor: RecognisedSensor) -> None:
        for earlier, other in self.seen:
            if sensor.differs_from(other):
                raise InputError(
                    f"{where}: sensor {sensor.described}, but {other.described} in {earlier}; thresholds are valid "
                    "for one sensor and intensity mode, so calibrate each by itself"
                )
        self.seen.append((where, sensor))

    @property
    def sensors(self) -> list[str]:
        """Sensors that the recordings state or, without one, resemble."""
        stated = [name for _, sensor in self.seen for name in sensor.models if sensor.is_stated]
        return list(dict.fromkeys(stated or [name for _, sensor in self.seen for name in sensor.models]))

    @property
    def described_sensor(self) -> str:
        """The sensor in a few words."""
        if self.sensor.model:
            return self.sensor.model
        return f"resembles {' or '.join(self.sensors)}" if self.sensors else "not recognised"

    def __iadd__(self, other: Self) -> Self:
        """Add the sums over later recordings.

        Raises
        ------
        InputError
            If a topic is known to be of another sensor than one before, or another intensity mode.
        """
        for where, sensor in other.seen:
            self._add_sensor(where, sensor)
        for name in ("frames", "unlabelled", "marked", "examined", "with_targets"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.frames_each += other.frames_each
        self.recordings += other.recordings
        self.intensity_fields = list(dict.fromkeys((*self.intensity_fields, *other.intensity_fields)))
        self.damage += other.damage
        return self

    @property
    def sensor(self) -> SensorParams:
        """Sensor model and intensity mode, if a recording states them."""
        models = (name for _, sensor in self.seen for name in sensor.models if sensor.is_stated)
        modes = (sensor.intensity for _, sensor in self.seen if sensor.intensity)
        return SensorParams(model=next(models, None), intensity=next(modes, None))


@dataclass(frozen=True)
class CalibrationResult(Result):
    """Result of a calibration, and the input that it is derived from.

    Parameters
    ----------
    start : Config
        Configuration that the calibration started from.
    calibration : Calibration
        Statistics of the clutter in all recordings.
    found : Thresholds
        Thresholds and far limit.
    tally : ClutterTally
        Sums over the recordings.
    labelled : bool
        Whether labels separated clutter from targets.
    output : Path or None
        File that the configuration was written to.
    mounting : Mounting or None
        Mounting of the lidar, if the water shows another one than the start configuration.
    trade_off : TradeOff or None
        Scores of filter rates, if they were compared.
    """

    is_summary = True

    start: Config
    calibration: Calibration
    found: Thresholds
    tally: ClutterTally
    labelled: bool
    output: Path | None = None
    mounting: Mounting | None = None
    trade_off: TradeOff | None = None

    @property
    def damaged(self) -> bool:
        """Whether parts of the input were damaged and left out."""
        return bool(self.tally.damage)

    @property
    def config(self) -> Config:
        """Configuration with the thresholds, the far limit and the mounting that were found."""
        found = self.found
        params = replace(self.start.filter, end_m=found.end_m, initial_thresholds=found.initial_thresholds)
        if self.mounting:
            roll, pitch = self.mounting.roll_deg, self.mounting.pitch_deg
            params = replace(params, mounting_roll_deg=roll, mounting_pitch_deg=pitch)
        return replace(self.start, filter=params, sensor=self.tally.sensor)

    @property
    def warnings(self) -> list[str]:
        """Reasons to doubt the thresholds, one sentence each."""
        rings, tally = self.found.rings, self.tally
        used = sum(ring.points for ring in rings)
        found = []
        if tally.with_targets > _MIN_SHARE * tally.examined:
            found.append(
                f"objects rise out of the water in {tally.with_targets:,} of {count(tally.examined, 'examined frame')},"
                " and raise the thresholds; label them (--labels), or choose a log without targets"
            )
        if used < few_points(self.calibration.filter_rate):
            found.append(f"the thresholds are from {count(used, 'clutter point')} only; use longer logs")
        saturated = [ring for ring in rings if ring.saturated]
        if saturated:
            spans = ", ".join(f"{ring.start_m:g} to {ring.end_m:g} m" for ring in saturated)
            found.append(
                f"{spans}: too many points have the highest intensity, {self.calibration.highest:g}: the lidar is "
                "saturated, or these are targets; thresholds end there and remove less than the filter rate"
            )
        return found

    def config_text(self) -> str:
        """Return the configuration as YAML, with comments that describe its origin."""
        head = [
            f"Thresholds found by seaclutter calibrate with a filter rate of {self._rate}",
            f"in {', '.join(map(printable, self.tally.recordings))}.",
        ]
        lines = [*_wrapped(" ".join(head)), *(line for text in self._sentences() for line in _wrapped(text))]
        comments = [*lines, *self._table().splitlines()]
        body = self.config.to_yaml(comments=True)
        return "".join(f"# {line}".rstrip() + "\n" for line in comments) + body

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        sentences = [line for text in self._sentences() for line in textwrap.wrap(text, _TEXT_WIDTH - 2)]
        body = [*sentences, *self._table().splitlines()]
        title = printable(", ".join(self.tally.recordings))
        if self.output:
            title += f" -> {printable(str(self.output))}"
        text = "\n".join((title, *(f"  {line}" for line in body)))
        return f"{text}\n\n{self.trade_off.as_text()}" if self.trade_off else text

    def as_dict(self) -> dict[str, Any]:
        """Return the result as JSON-compatible data."""
        found, tally = self.found, self.tally
        return {
            "output": str(self.output) if self.output else None,
            "recordings": tally.recordings,
            "frames": tally.frames,
            "unlabelled_frames": tally.unlabelled,
            "labelled": self.labelled,
            "labelled_points": tally.marked,
            "filter_rate": self.calibration.filter_rate,
            "max_left": self.calibration.max_left,
            "sensors": tally.sensors,
            "intensity_fields": tally.intensity_fields,
            "intensity": self.calibration.intensity,
            "clutter_points": self.calibration.points,
            "points_beyond": found.beyond,
            "last_m": found.last_m,
            "start_m": found.rings[0].start_m,
            "end_m": found.end_m,
            "end_kept": self.calibration.keep_end,
            "rings": [_ring_dict(*pair) for pair in zip(found.rings, found.initial_thresholds, strict=True)],
            **({"mounting": asdict(self.mounting)} if self.mounting else {}),
            **({"trade_off": self.trade_off.as_dict()} if self.trade_off else {}),
            "warnings": self.warnings,
            "damage": [str(item) for item in tally.damage],
        }

    @property
    def _rate(self) -> str:
        left = self.calibration.max_left
        limit = "" if left is None else f" and at most {left:g} clutter points per frame left in a range ring"
        return f"{self.calibration.filter_rate:g}{limit}"

    def _sentences(self) -> list[str]:
        """Return sentences about the input and the far limit of clutter."""
        found, tally = self.found, self.tally
        least, most = self.calibration.intensity
        without = f" ({count(tally.unlabelled, 'unlabelled frame')} left out)" if tally.unlabelled else ""
        left_out = f"{count(tally.marked, 'labelled point')} left out"
        labels = left_out if self.labelled else "no labels: all treated as clutter"
        name = printable(" or ".join(tally.intensity_fields)) or "none"
        points = f"{count(self.calibration.points, 'clutter point')} from {found.rings[0].start_m:g} m outwards"
        frames = f"{count(tally.frames, 'frame')}{without}"
        return [
            f"{frames}; {points} ({labels}), {found.beyond:,} of them beyond {found.end_m:g} m.",
            f"Sensor {tally.described_sensor}; intensity field {name}, {least:g} to {most:g} in clutter.",
            self._limit(),
            *([self._mounted(self.mounting)] if self.mounting else []),
        ]

    def _limit(self) -> str:
        found = self.found
        gap = f"Beyond {found.last_m:.2f} m, consecutive clutter points are more than 1 m apart in range"
        if self.calibration.keep_end:
            return f"{gap}; the given far limit of {found.end_m:g} m is kept."
        return f"{gap}; in whole range rings, clutter ends at {found.end_m:g} m."

    def _mounted(self, mounting: Mounting) -> str:
        given = self.start.filter.mounting
        return (
            f"Mounting: roll {mounting.roll_deg:g}°, pitch {mounting.pitch_deg:g}°, from the attitude of the water in "
            f"the first seconds; roll {given.roll_deg:g}° and pitch {given.pitch_deg:g}° were given."
        )

    def _table(self) -> str:
        rows = [_ring_row(ring) for ring in self.found.rings]
        lines = table(("range ring", "clutter points", "threshold", "below"), rows).splitlines()
        rate = self.calibration.filter_rate
        notes = ["", *(_note(ring, rate) for ring in self.found.rings)]
        return "\n".join(f"{line}  {note}".rstrip() for line, note in zip(lines, notes, strict=True))


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _COMMENT_WIDTH - 2, break_on_hyphens=False, break_long_words=False)


def _ring_row(ring: RingCalibration) -> tuple[str, ...]:
    span = f"{ring.start_m:g} to {ring.end_m:g} m"
    return span, f"{ring.points:,}", f"{ring.threshold:.9g}", share(ring.below, ring.points)


def _note(ring: RingCalibration, filter_rate: float) -> str:
    note = "saturated" if ring.saturated else ""
    if ring.few:
        first, last = ring.source
        rings = f"rings {first} to {last}" if first < last else f"ring {last}"
        note = f"{note or ('few points' if ring.points else 'no points')}: {rings}"
    return note or "no point passes" * (filter_rate == 1)


def _ring_dict(ring: RingCalibration, threshold: float) -> dict[str, Any]:
    return {
        "start_m": ring.start_m,
        "end_m": ring.end_m,
        "points": ring.points,
        "threshold": threshold,
        "below": ring.below,
        "filter_rate": ring.filter_rate,
        "few_points": ring.few,
        "source_rings": list(ring.source),
        "saturated": ring.saturated,
    }
