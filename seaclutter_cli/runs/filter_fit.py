"""Warnings about settings of a filter that do not fit a recording."""

from collections.abc import Mapping, Sequence

from seaclutter_cli.config import Config
from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages.pointcloud2 import rewrapped
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.reporting.palette import reason_names
from seaclutter_cli.runs.checks import Checks
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.selection import was_filtered
from seaclutter_cli.text import count, share

_FEW_WATER = 0.05


class FitWarnings:
    """Warnings about settings that do not fit the frames of a recording."""

    def __init__(self, config: Config, source: Source, topics: Sequence[str], observer: Observer) -> None:
        self._config, self._observer = config, observer
        self._written_anew: set[str] = set()
        self._checks = {topic: Checks(config, source.facts, filtered=was_filtered(source, [topic])) for topic in topics}

    def add(self, result: FilterResult) -> None:
        """Check a frame."""
        for warning in self._checks[result.frame.topic].add(result):
            self._warn(result.frame.topic, warning)
        if result.frame.topic not in self._written_anew and (change := rewrapped(result.frame.cloud)):
            self._written_anew.add(result.frame.topic)
            self._warn(result.frame.topic, change)

    def finish(self, tallies: Mapping[str, TopicTally]) -> None:
        """Check the sums over all frames."""
        for topic, tally in tallies.items():
            unfit: Sequence[str | None] = self._checks[topic].finish()
            for warning in unfit or [_nothing_left(tally, self._config.ring_edges) or self._no_water(tally)]:
                self._warn(topic, warning)

    def _no_water(self, tally: TopicTally) -> str | None:
        """Return a warning if nearly all frames of a topic are without the water that the method needs."""
        if not (self._config.has_water and tally.points_in) or tally.water_frames > _FEW_WATER * tally.frames:
            return None
        without = f"{tally.frames - tally.water_frames:,} of {count(tally.frames, 'frame')}"
        return f"no water seen in {without}; heights are then unknown, and every object that stays is kept"

    def _warn(self, topic: str, text: str | None) -> None:
        if text:
            self._observer.warn(f"{topic}: {text}")


def _nothing_left(tally: TopicTally, edges: Sequence[float]) -> str | None:
    """Return a warning if no point of a topic was kept."""
    most = Reason(int(tally.counts.argmax()))
    if not tally.points_in or tally.counts[Reason.KEPT]:
        return None
    reason = reason_names(edges)[most]
    return f"no points are left; {share(int(tally.counts[most]), tally.points_in)} were removed: {reason}"
