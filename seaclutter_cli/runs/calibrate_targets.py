"""Search for targets in recordings that should contain clutter only."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np

from seaclutter_cli.filters.confirmation.params import ConfirmedParams
from seaclutter_cli.filters.confirmed import Confirmed
from seaclutter_cli.filters.joint import RingIntensityParams
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.text import count
from seaclutter_cli.water import Mounting

_LOOKS_S = 2.0
_EVERY_S = 20.0
_MIN_POINTS = 5
_MIN_SHARE = 0.2


@dataclass
class TargetTally:
    """Frames in which the search looked for targets.

    Parameters
    ----------
    frames, with_targets : int
        Frames with water, and those of them with objects that rise out of it.
    """

    frames: int = 0
    with_targets: int = 0

    @property
    def are_there(self) -> bool:
        """Whether there are targets in so many of the frames that they are no accident."""
        return self.with_targets > _MIN_SHARE * self.frames

    def __str__(self) -> str:
        """Return the share of frames with targets."""
        return f"{self.with_targets:,} of {count(self.frames, 'examined frame')}"

    def __iadd__(self, other: Self) -> Self:
        """Add the frames of another search."""
        self.frames += other.frames
        self.with_targets += other.with_targets
        return self


class TargetSearch:
    """Search of one recording for objects that rise out of the water and stay, two of every 20 seconds.

    The method `Confirmed` decides, by shape and persistence alone: thresholds are not known yet. Frames without water
    are not counted, since objects cannot be distinguished from land there.

    Parameters
    ----------
    params : RingIntensityParams
        Range limits, own structure and, for the method ``confirmed``, the mounting.
    tally : TargetTally
        Receives the frames.
    """

    def __init__(self, params: RingIntensityParams, tally: TargetTally) -> None:
        mounting = params.mounting if isinstance(params, ConfirmedParams) else Mounting()
        self._params = ConfirmedParams(
            start_m=params.start_m,
            end_m=params.start_m + params.ring_width_m,  # without thresholds, one range ring is enough
            ring_width_m=params.ring_width_m,
            initial_thresholds=(0,),
            exclude_boxes=params.exclude_boxes,
            exclude_polygons=params.exclude_polygons,
            mask=params.mask,
            use_intensity=False,
            mounting_roll_deg=mounting.roll_deg,
            mounting_pitch_deg=mounting.pitch_deg,
        )
        self._tally = tally
        self._topics: dict[str, tuple[float, Confirmed]] = {}

    def add(self, frame: Frame) -> None:
        """Add a frame, in order."""
        time_s = frame.stamp_ns / 1e9
        start_s, method = self._topics.setdefault(frame.topic, (time_s, Confirmed(self._params)))
        if (time_s - start_s) % _EVERY_S < _LOOKS_S:
            self._count(method.process(frame))
        else:
            self._count(method.flush())
            method.reset()

    def finish(self) -> None:
        """Count the frames that wait."""
        for _, method in self._topics.values():
            self._count(method.flush())

    def _count(self, results: Iterable[FilterResult]) -> None:
        for result in results:
            if result.water is None:
                continue
            kept = np.count_nonzero(result.keep & (result.frame.range_m >= self._params.start_m))
            self._tally.frames += 1
            self._tally.with_targets += bool(kept >= _MIN_POINTS)
