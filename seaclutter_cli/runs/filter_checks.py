"""Checks of the frames of a filter run, and of the sums over them."""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from seaclutter_cli.config import Config
from seaclutter_cli.filters.zones import ZoneParams
from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages.pointcloud2 import rewrapped
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.reporting.palette import reason_names
from seaclutter_cli.runs.checks import Checks
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.topic_statistics import TopicStatistics
from seaclutter_cli.selection import filtered_by
from seaclutter_cli.text import count, share

if TYPE_CHECKING:
    from seaclutter_cli.runs.surroundings import Surroundings

_FEW_WATER = 0.05
_BEGIN = 10
"""Number of the frame from which on surroundings are looked at."""


class FitChecks(Checks):
    """Checks of the frames of a topic, and of the sums over them; an observer receives the warnings."""

    def __init__(self, config: Config, source: Source, topic: str, observer: Observer) -> None:
        super().__init__(config, source.facts, filtered=filtered_by(source, [topic]) is not None)
        self._config, self._topic, self._observer, self._facts = config, topic, observer, source.facts
        self._written_anew: str | None = None
        self._sensor, self._frames = TopicStatistics(), 0
        self._around: Surroundings | None = None

    def see(self, result: FilterResult) -> None:
        """Check a frame."""
        self._warn(self.add(result))
        if not self._written_anew and (change := rewrapped(result.frame.cloud)):
            self._written_anew = change
            self._warn([change])
        self._frames += 1
        if self._frames == _BEGIN and isinstance(params := self._config.filter, ZoneParams):
            from seaclutter_cli.runs.surroundings import MOST_M, Surroundings  # short logs do not show them

            self._around = Surroundings(min(params.own_ship_m, MOST_M))
            self._sensor.add(result.frame)
        if self._around is not None:
            self._around.add(result.frame)

    def end(self, tally: TopicTally) -> str | None:
        """Check what was removed, and whether nearly all frames are without the water that a method needs.

        Return a line for the summary about the least that the lidar sees, if the method finds objects on water.
        """
        self._warn(self.finish() or (self._of_sums(tally) if tally.points_in else ()))
        around, params = self._around, self._config.filter
        if around is None:
            return None
        if params.start_m != "auto" and params.near == "drop":
            self._warn(filter(None, [around.warning()]))
        models = self._sensor.sensor(self._facts.get(self._topic)).models
        return around.smallest(models) if self._config.has_water else None

    def _of_sums(self, tally: TopicTally) -> Iterator[str]:
        most, without = Reason(int(tally.counts.argmax())), tally.frames - tally.water_frames
        if not tally.counts[Reason.KEPT]:
            removed = f"{share(int(tally.counts[most]), tally.points_in)} were removed"
            yield f"no points are left; {removed}: {reason_names(self._config.ring_edges)[most]}"
        elif self._config.has_water and tally.water_frames <= _FEW_WATER * tally.frames:
            frames = f"{without:,} of {count(tally.frames, 'frame')}"
            yield f"no water seen in {frames}; heights are then unknown, and every object that stays is kept"

    def _warn(self, texts: Iterable[str]) -> None:
        for text in texts:
            self._observer.warn(f"{self._topic}: {text}")
