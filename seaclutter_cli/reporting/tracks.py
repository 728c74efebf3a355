"""Tracks of objects for a report, with a few positions each."""

from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.frame import FilterResult
from seaclutter_cli.tracking.follow import CONFIRMED, Follower, FrameObjects

_MOST_TRACKS, _MOST_PLACES = 60, 200


class TrackPaths:
    """Tracks of the objects of all recordings, relative to own ship; of each, at most a few hundred positions."""

    def __init__(self, params: EvaluationParams) -> None:
        self._clustering = params.cluster_tolerance_m, params.min_cluster_points
        self._follower = Follower(*self._clustering)
        self._rows: deque[int] = deque()
        self._recording = -1
        self._tracks: dict[tuple[int, int], dict[str, Any]] = {}

    def begin(self) -> None:
        """Start a recording."""
        self._take(self._follower.finish())
        self._follower, self._recording = Follower(*self._clustering), self._recording + 1

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
                if state == CONFIRMED:
                    self._extend(number, row, frame, k, float(speeds[k]))

    def _extend(self, number: int, row: int, frame: FrameObjects, k: int, speed_ms: float) -> None:
        fresh = {"recording": self._recording, "id": number, "frames": 0, "rows": [], "places": [], "step": 1}
        track = self._tracks.setdefault((self._recording, number), fresh)
        if track["frames"] % track["step"] == 0:
            track["rows"].append(row)
            track["places"].append(frame.centers[k, :2].round(1).tolist())
        if len(track["rows"]) > _MOST_PLACES:
            track["rows"], track["places"], track["step"] = track["rows"][::2], track["places"][::2], 2 * track["step"]
        track["frames"] += 1
        track["size"], track["yaw"] = frame.sizes[k].round(2).tolist(), round(float(frame.yaws[k]), 3)
        track["speed"], track["score"] = round(speed_ms, 1), round(float(frame.scores[k]), 2)
