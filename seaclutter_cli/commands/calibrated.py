"""What a calibration found: as a configuration, for people, and as data."""

import textwrap
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seaclutter_cli.commands.console import count, share, table
from seaclutter_cli.text import printable

if TYPE_CHECKING:
    from seaclutter_cli.calibration import ClutterReader, RingCalibration, Thresholds
    from seaclutter_cli.config import Config, SensorParams
    from seaclutter_cli.frame import Frame
    from seaclutter_cli.records import Damage, SensorFacts

_COMMENT_WIDTH = 100
_TEXT_WIDTH = 79


@dataclass
class Calibrated:
    """What a calibration found, and in what.

    Parameters
    ----------
    config : Config
        What it started from.
    filter_rate : float
        Share that was to be below the thresholds.
    labelled : bool
        Whether labels told clutter from targets.
    """

    config: "Config"
    filter_rate: float
    labelled: bool
    kept_end: bool = False
    frames: int = 0
    unlabelled: int = 0
    marked: int = 0
    points: int = 0
    intensity: list[float] = field(default_factory=list)
    recordings: list[str] = field(default_factory=list)
    sensors: list[str] = field(default_factory=list)
    intensity_fields: list[str] = field(default_factory=list)
    damage: list["Damage"] = field(default_factory=list)
    facts: list["SensorFacts"] = field(default_factory=list)
    _seen: set[tuple[str, str]] = field(default_factory=set)

    def __post_init__(self) -> None:
        """Declare what is there after the last recording."""
        self.found: Thresholds

    def look_at(self, recording: str, frame: "Frame") -> None:
        """Note what the first frame of a topic tells of the sensor."""
        from seaclutter_cli.survey import TopicSurvey

        if (recording, frame.topic) in self._seen:
            return
        self._seen.add((recording, frame.topic))
        survey = TopicSurvey()
        survey.add(frame)
        self.sensors += [name for name in survey.sensors if name not in self.sensors]
        if survey.intensity_name and survey.intensity_name not in self.intensity_fields:
            self.intensity_fields.append(survey.intensity_name)

    def count(self, recording: str, reader: "ClutterReader") -> None:
        """Add the sums of a recording."""
        self.recordings.append(recording)
        self.frames += reader.frames
        self.unlabelled += reader.unlabelled
        self.marked += reader.marked

    @property
    def sensor(self) -> "SensorParams":
        """What packets told of the sensor; where recordings differ, nothing."""
        from seaclutter_cli.config import SensorParams

        models = {facts.model for facts in self.facts}
        modes = {facts.details.get("intensity") for facts in self.facts}
        return SensorParams(
            model=models.pop() if len(models) == 1 else None, intensity=modes.pop() if len(modes) == 1 else None
        )

    def config_text(self) -> str:
        """Return the configuration with what was found, below comments that say where it comes from."""
        params = replace(self.config.filter, end_m=self.found.end_m, initial_thresholds=self.found.initial_thresholds)
        head = [
            f"Thresholds found by seaclutter calibrate with a filter rate of {self.filter_rate:g}",
            f"in {', '.join(map(printable, self.recordings))}.",
        ]
        lines = [*_wrapped(" ".join(head)), *(line for text in self._said() for line in _wrapped(text))]
        comments = [*lines, *self._table().splitlines()]
        body = replace(self.config, filter=params, sensor=self.sensor).to_yaml(comments=True)
        return "".join(f"# {line}".rstrip() + "\n" for line in comments) + body

    def as_text(self, output: Path) -> str:
        """Return what was found as people read it."""
        said = [line for text in self._said() for line in textwrap.wrap(text, _TEXT_WIDTH - 2)]
        body = [*said, *self._table().splitlines()]
        names = printable(", ".join(self.recordings))
        return "\n".join((f"{names} -> {printable(str(output))}", *(f"  {line}" for line in body)))

    def as_dict(self, output: Path) -> dict[str, Any]:
        """Return what was found as JSON holds it."""
        found = self.found
        return {
            "output": str(output),
            "recordings": self.recordings,
            "frames": self.frames,
            "unlabelled_frames": self.unlabelled,
            "labelled": self.labelled,
            "labelled_points": self.marked,
            "filter_rate": self.filter_rate,
            "sensors": self.sensors,
            "intensity_fields": self.intensity_fields,
            "intensity": self.intensity,
            "clutter_points": self.points,
            "points_beyond": found.beyond,
            "last_m": found.last_m,
            "start_m": found.rings[0].start_m,
            "end_m": found.end_m,
            "end_kept": self.kept_end,
            "rings": [_ring_dict(*pair) for pair in zip(found.rings, found.initial_thresholds, strict=True)],
            "damage": [str(item) for item in self.damage],
        }

    def _said(self) -> list[str]:
        """Return sentences on what was read and where the clutter ends."""
        found = self.found
        without = f", {count(self.unlabelled)} without labels left out" if self.unlabelled else ""
        labels = f"{self.marked:,} labelled points left out" if self.labelled else "all taken for clutter, no labels"
        name = printable(" or ".join(self.intensity_fields)) or "none"
        sensor = f"like {' or '.join(self.sensors)}" if self.sensors else "not recognised"
        points = f"{self.points:,} clutter points from {found.rings[0].start_m:g} m on"
        return [
            f"{count(self.frames)}{without}; {points} ({labels}), {found.beyond:,} of them beyond {found.end_m:g} m.",
            f"Sensor {sensor}; intensity field {name}, {self.intensity[0]:g} to {self.intensity[1]:g} in clutter.",
            self._limit(),
        ]

    def _limit(self) -> str:
        found = self.found
        gap = f"Past {found.last_m:.2f} m, clutter points differ in range by more than 1 m each"
        if self.kept_end:
            return f"{gap}; the far limit was given: {found.end_m:g} m."
        return f"{gap}; in whole rings, clutter ends at {found.end_m:g} m."

    def _table(self) -> str:
        rows = [_ring_row(ring) for ring in self.found.rings]
        lines = table(("ring", "clutter points", "threshold", "below"), rows).splitlines()
        notes = ["", *(_note(ring) for ring in self.found.rings)]
        return "\n".join(f"{line}  {note}".rstrip() for line, note in zip(lines, notes, strict=True))


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _COMMENT_WIDTH - 2, break_on_hyphens=False, break_long_words=False)


def _ring_row(ring: "RingCalibration") -> tuple[str, ...]:
    span = f"{ring.start_m:g} to {ring.end_m:g} m"
    return span, f"{ring.points:,}", f"{ring.threshold:.9g}", share(ring.below, ring.points)


def _note(ring: "RingCalibration") -> str:
    if ring.taken_from is not None:
        return f"no points: threshold of ring {ring.taken_from}"
    notes = ["few points"] * ring.few + ["no point passes"] * (ring.below == ring.points)
    return ", ".join(notes)


def _ring_dict(ring: "RingCalibration", threshold: float) -> dict[str, Any]:
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
