"""Where a report comes from: recordings, sensors, labels, version and command line."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Any

from seaclutter_cli import __version__
from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.reporting.collector import Collector
from seaclutter_cli.reporting.history import Numbers
from seaclutter_cli.runs.recordings import Outcome
from seaclutter_cli.runs.topic_statistics import TopicStatistics
from seaclutter_cli.sources import Recording
from seaclutter_cli.storage.locations import Location
from seaclutter_cli.text import UNKNOWN, count
from seaclutter_cli.truth import Truth

_SURVEYED_FRAMES = 10
_NANO = 1_000_000_000
_FIRST_YEAR = 1990
_MAX_LISTED = 200


class SurveyingCollector(Collector):
    """Collector that also stores when each recording was made, and the layout of its first frames."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._topics: list[str] = []
        self._surveys: list[TopicStatistics] = []
        self._spans_ns: list[tuple[int, int] | None] = []

    def begin(self, recording: str) -> None:
        """Start a recording."""
        super().begin(recording)
        self._topics.append("")
        self._surveys.append(TopicStatistics())
        self._spans_ns.append(None)

    def add(
        self,
        frame: Frame,
        numbers: Sequence[Numbers | None],
        truth: Truth | None,
        scores: Sequence[FrameScore | None],
        results: Callable[[], Sequence[FilterResult | None]],
    ) -> None:
        """Take the statistics of a frame."""
        self._topics[-1] = frame.topic
        if self._surveys[-1].frames < _SURVEYED_FRAMES:
            self._surveys[-1].add(frame)
        first_ns, _ = self._spans_ns[-1] or (frame.log_time_ns, 0)
        self._spans_ns[-1] = first_ns, frame.log_time_ns
        super().add(frame, numbers, truth, scores, results)

    def time_of(self, number: int) -> str:
        """Return first and last frame time of a recording in UTC, if it has times of its own."""
        times = [_utc(time_ns) for time_ns in self._spans_ns[number] or ()]
        if not times or times[0].year < _FIRST_YEAR:
            return UNKNOWN
        first, last = (f"{time:%Y-%m-%d %H:%M:%S}" for time in times)
        return f"{first} to {last.removeprefix(first[:11])} UTC"

    def sensor_of(self, number: int, facts: dict[str, SensorFacts]) -> str:
        """Return the sensor of a recording, which its packets name or its first frames resemble."""
        survey = self._surveys[number]
        return survey.sensor(facts.get(self._topics[number])).described if survey.frames else UNKNOWN


def provenance(
    collected: SurveyingCollector,
    recordings: Sequence[Recording],
    outcomes: Sequence[Outcome],
    labels: Sequence[Location],
    command: str | None,
) -> dict[str, Any]:
    """Return where a report comes from, as data of its page; the same for the same input and command.

    Parameters
    ----------
    collected : SurveyingCollector
        What was read.
    recordings : sequence of Recording
        The recordings.
    outcomes : sequence of Outcome
        Outcome of each recording, in the same order.
    labels : sequence of Path or Url
        Given paths of labels.
    command : str or None
        Command line; None for a report made with Python.
    """
    rows = []
    for number, (recording, outcome) in enumerate(zip(recordings, outcomes, strict=True)):
        first, *others = map(str, recording.paths)
        path = f"{first} and {count(len(others), 'more file')}" if others else first
        recorded, sensor = collected.time_of(number), collected.sensor_of(number, outcome.facts)
        rows.append({"path": path, "recorded": recorded, "sensor": sensor})
    return {
        "version": __version__,
        "command": command,
        "labels": [str(path) for path in labels][:_MAX_LISTED],
        "recordings": rows[:_MAX_LISTED],
        "left_out": max(len(rows) - _MAX_LISTED, 0),
    }


def _utc(time_ns: int) -> datetime:
    try:
        return datetime.fromtimestamp(time_ns // _NANO, UTC)
    except (OverflowError, ValueError, OSError):
        return datetime.min.replace(tzinfo=UTC)
