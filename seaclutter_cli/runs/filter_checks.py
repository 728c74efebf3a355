"""Checks of the frames of a filter run, and of the sums over them."""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from seaclutter_cli.config import Config
from seaclutter_cli.filters.zones import ZoneParams
from seaclutter_cli.frame import FilterResult, Frame, Reason
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
    import numpy as np
    from numpy.typing import NDArray

    from seaclutter_cli.runs.surroundings import Surroundings

_FEW_WATER = 0.05
_SHOWS_BEAMS = 10
"""Number of the frame that shows sensor and beams."""
_BEGIN, _EVERY = 50, 5
"""Number of the frame from which on surroundings are looked at, and of the frames to one that is."""


class FitChecks(Checks):
    """Checks of the frames of a topic, and of the sums over them; an observer receives the warnings."""

    def __init__(self, config: Config, source: Source, topic: str, observer: Observer) -> None:
        super().__init__(config, source.facts, filtered=filtered_by(source, [topic]) is not None)
        self._config, self._topic, self._observer, self._facts = config, topic, observer, source.facts
        self._written_anew: str | None = None
        self._sensor, self._frames = TopicStatistics(), 0
        self._beams_deg: NDArray[np.float64] | None = None
        self._around: Surroundings | None = None

    def see(self, result: FilterResult) -> None:
        """Check a frame."""
        self._warn(self.add(result))
        if not self._written_anew and (change := rewrapped(result.frame.cloud)):
            self._written_anew = change
            self._warn([change])
        self._frames += 1
        if self._frames == _SHOWS_BEAMS and self._config.has_water and result.frame.valid.any():
            from seaclutter_cli.structure.search import BeamGrid

            self._sensor.add(result.frame)
            self._beams_deg = BeamGrid.of(result.frame).beams_deg
        if self._frames >= _BEGIN and self._frames % _EVERY == 0:
            self._look_around(result.frame)

    def _look_around(self, frame: Frame) -> None:
        params = self._config.filter
        if not isinstance(params, ZoneParams) or params.start_m == "auto" or params.near == "keep":
            return
        if self._around is None:
            from seaclutter_cli.runs.surroundings import MOST_M, Surroundings  # short logs do not show them

            self._around = Surroundings(min(params.own_ship_m, MOST_M))
        self._around.add(frame)

    def end(self, tally: TopicTally) -> str | None:
        """Check what was removed, and whether nearly all frames are without the water that a method needs.

        Return a line for the summary about the least that the lidar sees, if the method finds objects on water.
        """
        self._warn(self.finish() or (self._of_sums(tally) if tally.points_in else ()))
        if self._around is not None:
            self._warn(filter(None, [self._around.warning()]))
        if self._frames < _SHOWS_BEAMS or tally.mean_water is None:
            return None
        from seaclutter_cli.runs.surroundings import smallest

        models = self._sensor.sensor(self._facts.get(self._topic)).models
        return smallest(models, self._beams_deg, tally.mean_water.level_m)

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
