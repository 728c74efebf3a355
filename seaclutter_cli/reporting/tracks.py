"""Tracks of objects for a report, with a few positions each."""

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from seaclutter_cli.frame import FilterResult
from seaclutter_cli.tracking.follow import CONFIRMED, Follower, FrameObjects

_MOST_TRACKS, _MOST_PLACES = 60, 200


class TrackPaths:
    """Tracks of the objects of all recordings, relative to own ship; of each, at most a few hundred positions."""

    def __init__(self, new: Callable[[], Follower]) -> None:
        self._new, self._follower = new, new()
        self._rows: deque[int] = deque()
        self._recording = -1
        self._tracks: dict[tuple[int, int], dict[str, Any]] = {}

    def begin(self) -> None:
        """Start a recording."""
        self._take(self._follower.finish())
        self._follower, self._recording = self._new(), self._recording + 1

    def add(self, row: int, result: FilterResult) -> None:
        """Follow the objects of a frame, given its number among all frames."""
        self._rows.append(row)
        self._take(self._follower.add(result, None))

    def found(self) -> list[dict[str, Any]]:
        """Return the confirmed tracks that were seen most; call it after the last frame."""
        self._take(self._follower.finish())
        return sorted(self._tracks.values(), key=lambda one: -one["frames"])[:_MOST_TRACKS]

    def _take(self, frames: Iterable[FrameObjects]) -> None:
        for frame in frames:
            row = self._rows.popleft()
            speeds = np.hypot(*frame.velocities.T)
            for k, (number, state) in enumerate(zip(frame.tracks, frame.states, strict=True)):
                if state != CONFIRMED:
                    continue
                fresh = {"recording": self._recording, "id": number, "frames": 0, "rows": [], "places": [], "step": 1}
                one = self._tracks.setdefault((self._recording, number), fresh)
                if one["frames"] % one["step"] == 0:
                    one["rows"].append(row)
                    one["places"].append(frame.centers[k, :2].round(1).tolist())
                if len(one["rows"]) > _MOST_PLACES:
                    one["rows"], one["places"], one["step"] = one["rows"][::2], one["places"][::2], 2 * one["step"]
                one["frames"] += 1
                one["size"], one["yaw"] = frame.sizes[k].round(2).tolist(), round(float(frame.yaws[k]), 3)
                one["speed"], one["score"] = round(float(speeds[k]), 1), round(float(frame.scores[k]), 2)
