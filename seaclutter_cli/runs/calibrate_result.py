"""Result of a calibration: as a configuration, as text and as data."""

import textwrap
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self

from seaclutter_cli.calibration import Calibration, ClutterSelector, RingCalibration, Thresholds
from seaclutter_cli.config import Config, SensorParams
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Damage, SensorFacts
from seaclutter_cli.runs.recordings import Result
from seaclutter_cli.storage.locations import Location
from seaclutter_cli.survey import TopicSurvey
from seaclutter_cli.text import count, printable, share, table
from seaclutter_cli.water import Mounting

_COMMENT_WIDTH = 100
_TEXT_WIDTH = 79


@dataclass
class ClutterTally:
    """Sums over all recordings of a calibration, and facts about their sensors.

    Parameters
    ----------
    frames, unlabelled : int
        Frames used, and frames left out because they have no labels.
    marked : int
        Points left out because labels mark them as targets or areas to ignore.
    recordings, sensors, intensity_fields : list of str
        Names of the recordings, of the sensors they may come from, and of their intensity fields.
    damage : list of Damage
        Parts of the recordings that could not be used.
    facts : list of SensorFacts
        Facts about the sensors, from packets.
    """

    frames: int = 0
    unlabelled: int = 0
    marked: int = 0
    recordings: list[str] = field(default_factory=list)
    sensors: list[str] = field(default_factory=list)
    intensity_fields: list[str] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)
    facts: list[SensorFacts] = field(default_factory=list)
    _seen: set[tuple[str, str]] = field(default_factory=set)

    def note_sensor(self, recording: str, frame: Frame) -> None:
        """Note the sensor and the intensity field of a topic, from its first frame."""
        if (recording, frame.topic) in self._seen:
            return
        self._seen.add((recording, frame.topic))
        survey = TopicSurvey()
        survey.add(frame)
        self.sensors += [name for name in survey.sensors if name not in self.sensors]
        if survey.intensity_name and survey.intensity_name not in self.intensity_fields:
            self.intensity_fields.append(survey.intensity_name)

    def add(self, source: Source, selector: ClutterSelector, topics: Sequence[str]) -> None:
        """Add the sums of a recording."""
        self.recordings.append(source.name)
        self.frames += selector.frames
        self.unlabelled += selector.unlabelled
        self.marked += selector.marked
        self.damage += source.damage
        self.facts += [facts for topic, facts in source.facts.items() if topic in topics]

    def __iadd__(self, other: Self) -> Self:
        """Add the sums over later recordings."""
        self.frames += other.frames
        self.unlabelled += other.unlabelled
        self.marked += other.marked
        self.recordings += other.recordings
        self.sensors += [name for name in other.sensors if name not in self.sensors]
        self.intensity_fields += [name for name in other.intensity_fields if name not in self.intensity_fields]
        self.damage += other.damage
        self.facts += other.facts
        return self

    @property
    def sensor(self) -> SensorParams:
        """Sensor model and intensity mode from packets, if all recordings agree on them."""
        models = {facts.model for facts in self.facts}
        modes = {facts.details.get("intensity") for facts in self.facts}
        return SensorParams(
            model=models.pop() if len(models) == 1 else None, intensity=modes.pop() if len(modes) == 1 else None
        )


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
    """

    start: Config
    calibration: Calibration
    found: Thresholds
    tally: ClutterTally
    labelled: bool
    output: Location | None = None
    mounting: Mounting | None = None

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

    def config_text(self) -> str:
        """Return the configuration as YAML, with comments that describe its origin."""
        head = [
            f"Thresholds found by seaclutter calibrate with a filter rate of {self.calibration.filter_rate:g}",
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
        return "\n".join((title, *(f"  {line}" for line in body)))

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
            "damage": [str(item) for item in tally.damage],
        }

    def _sentences(self) -> list[str]:
        """Return sentences about the input and the far limit of clutter."""
        found, tally = self.found, self.tally
        least, most = self.calibration.intensity
        without = f" ({count(tally.unlabelled, 'unlabelled frame')} left out)" if tally.unlabelled else ""
        left_out = f"{count(tally.marked, 'labelled point')} left out"
        labels = left_out if self.labelled else "no labels: all treated as clutter"
        name = printable(" or ".join(tally.intensity_fields)) or "none"
        sensor = f"resembles {' or '.join(tally.sensors)}" if tally.sensors else "not recognised"
        points = f"{count(self.calibration.points, 'clutter point')} from {found.rings[0].start_m:g} m outwards"
        frames = f"{count(tally.frames, 'frame')}{without}"
        return [
            f"{frames}; {points} ({labels}), {found.beyond:,} of them beyond {found.end_m:g} m.",
            f"Sensor {sensor}; intensity field {name}, {least:g} to {most:g} in clutter.",
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
        notes = ["", *(_note(ring) for ring in self.found.rings)]
        return "\n".join(f"{line}  {note}".rstrip() for line, note in zip(lines, notes, strict=True))


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _COMMENT_WIDTH - 2, break_on_hyphens=False, break_long_words=False)


def _ring_row(ring: RingCalibration) -> tuple[str, ...]:
    span = f"{ring.start_m:g} to {ring.end_m:g} m"
    return span, f"{ring.points:,}", f"{ring.threshold:.9g}", share(ring.below, ring.points)


def _note(ring: RingCalibration) -> str:
    if ring.taken_from is not None:
        return f"no points: threshold of ring {ring.taken_from}"
    notes = ["few points"] * ring.few + ["no point passes"] * (ring.below == ring.points)
    return ", ".join(notes)


def _ring_dict(ring: RingCalibration, threshold: float) -> dict[str, Any]:
    return {
        "start_m": ring.start_m,
        "end_m": ring.end_m,
        "points": ring.points,
        "threshold": threshold,
        "below": ring.below,
        "filter_rate": ring.filter_rate,
        "few_points": ring.few,
        "taken_from": ring.taken_from,
    }
