"""What a calibration found: as a configuration, for people, and as data."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from seaclutter_cli.calibration import Calibration, ClutterSelector, RingCalibration, Thresholds
from seaclutter_cli.config import Config, SensorParams
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Damage, SensorFacts
from seaclutter_cli.runs.recordings import Result
from seaclutter_cli.survey import TopicSurvey
from seaclutter_cli.text import count, printable, share, table

_COMMENT_WIDTH = 100
_TEXT_WIDTH = 79


@dataclass
class ClutterTally:
    """What clutter was found in: sums over all recordings.

    Parameters
    ----------
    frames, unlabelled : int
        Frames used, and frames left out since they have no labels.
    marked : int
        Points left out since labels mark them.
    recordings, sensors, intensity_fields : list of str
        Names of each.
    damage : list of Damage
        Parts of the recordings that could not be used.
    facts : list of SensorFacts
        What packets reveal of the sensors.
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

    def look_at(self, recording: str, frame: Frame) -> None:
        """Note what the first frame of a topic reveals of the sensor."""
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

    @property
    def sensor(self) -> SensorParams:
        """What packets reveal of the sensor, where recordings agree on it."""
        models = {facts.model for facts in self.facts}
        modes = {facts.details.get("intensity") for facts in self.facts}
        return SensorParams(
            model=models.pop() if len(models) == 1 else None, intensity=modes.pop() if len(modes) == 1 else None
        )


@dataclass(frozen=True)
class CalibrationResult(Result):
    """What a calibration found, and in what.

    Parameters
    ----------
    start : Config
        Configuration that it started from.
    calibration : Calibration
        Clutter of all recordings.
    found : Thresholds
        Thresholds and far limit.
    tally : ClutterTally
        What the clutter was found in.
    labelled : bool
        Whether labels kept clutter and targets apart.
    output : Path or None
        Where the configuration was written.
    """

    start: Config
    calibration: Calibration
    found: Thresholds
    tally: ClutterTally
    labelled: bool
    output: Path | None = None

    @property
    def damaged(self) -> bool:
        """Whether parts of the input were damaged and left out."""
        return bool(self.tally.damage)

    @property
    def config(self) -> Config:
        """The configuration with what was found."""
        found = self.found
        params = replace(self.start.filter, end_m=found.end_m, initial_thresholds=found.initial_thresholds)
        return replace(self.start, filter=params, sensor=self.tally.sensor)

    def config_text(self) -> str:
        """Return the configuration with what was found, below comments that say where it comes from."""
        head = [
            f"Thresholds found by seaclutter calibrate with a filter rate of {self.calibration.filter_rate:g}",
            f"in {', '.join(map(printable, self.tally.recordings))}.",
        ]
        lines = [*_wrapped(" ".join(head)), *(line for text in self._said() for line in _wrapped(text))]
        comments = [*lines, *self._table().splitlines()]
        body = self.config.to_yaml(comments=True)
        return "".join(f"# {line}".rstrip() + "\n" for line in comments) + body

    def as_text(self) -> str:
        """Return what was found as people read it."""
        said = [line for text in self._said() for line in textwrap.wrap(text, _TEXT_WIDTH - 2)]
        body = [*said, *self._table().splitlines()]
        title = printable(", ".join(self.tally.recordings))
        if self.output:
            title += f" -> {printable(str(self.output))}"
        return "\n".join((title, *(f"  {line}" for line in body)))

    def as_dict(self) -> dict[str, Any]:
        """Return what was found as JSON holds it."""
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
            "damage": [str(item) for item in tally.damage],
        }

    def _said(self) -> list[str]:
        """Return sentences on what was read and where the clutter ends."""
        found, tally = self.found, self.tally
        least, most = self.calibration.intensity
        without = f", {count(tally.unlabelled, 'frame')} without labels left out" if tally.unlabelled else ""
        labels = f"{tally.marked:,} labelled points left out" if self.labelled else "all taken for clutter, no labels"
        name = printable(" or ".join(tally.intensity_fields)) or "none"
        sensor = f"like {' or '.join(tally.sensors)}" if tally.sensors else "not recognised"
        points = f"{self.calibration.points:,} clutter points from {found.rings[0].start_m:g} m on"
        frames = f"{count(tally.frames, 'frame')}{without}"
        return [
            f"{frames}; {points} ({labels}), {found.beyond:,} of them beyond {found.end_m:g} m.",
            f"Sensor {sensor}; intensity field {name}, {least:g} to {most:g} in clutter.",
            self._limit(),
        ]

    def _limit(self) -> str:
        found = self.found
        gap = f"Past {found.last_m:.2f} m, clutter points differ in range by more than 1 m each"
        if self.calibration.keep_end:
            return f"{gap}; the far limit was given: {found.end_m:g} m."
        return f"{gap}; in whole rings, clutter ends at {found.end_m:g} m."

    def _table(self) -> str:
        rows = [_ring_row(ring) for ring in self.found.rings]
        lines = table(("ring", "clutter points", "threshold", "below"), rows).splitlines()
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
