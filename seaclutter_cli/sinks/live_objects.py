"""Objects of frames as they are filtered, for messages in the filtered log."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from seaclutter_cli.frame import FilterResult
from seaclutter_cli.messages.definitions import Content
from seaclutter_cli.messages.navigation import Navigation
from seaclutter_cli.messages.scene import SceneBox, SceneTrack, detections
from seaclutter_cli.records import Message, Record
from seaclutter_cli.sinks.objects import pose_of
from seaclutter_cli.tracking.follow import CANDIDATE, CONFIRMED, LOST, Follower, FrameObjects

_CONTEXT_S = 2.0
_COLORS = {CONFIRMED: "#f4a261", CANDIDATE: "#8d99ae", LOST: "#8d99ae"}


class LiveObjects:
    """Objects of each frame, known without later frames; ids are those of `ObjectTable`, other values less exact."""

    def __init__(self, new: Callable[..., Follower]) -> None:
        self._new = partial(new, context_s=_CONTEXT_S, live=True)
        self._followers: dict[str, Follower] = {}
        self._navigation = Navigation()
        self._shown: dict[str, set[str]] = {}
        self._last: tuple[FilterResult, FrameObjects] | None = None

    def copy(self, record: Record) -> None:
        """Receive messages about own ship's motion."""
        if isinstance(record, Message):
            self._navigation.see(record)

    def of(self, result: FilterResult) -> FrameObjects:
        """Return the objects of a frame; call it for each frame, in order."""
        if self._last is None or self._last[0] is not result:
            follower = self._followers.setdefault(result.frame.topic, self._new())
            *_, found = follower.add(result, pose_of(self._navigation, result))
            self._last = result, found
        return self._last[1]

    def tracks(self, result: FilterResult) -> tuple[Mapping[str, SceneTrack], Sequence[str]]:
        """Return the objects of a frame by the ids of their entities, and the ids of those that are no longer there."""
        topic = result.frame.topic
        found = {f"{topic} object {one.name}": one for one in _tracks(self.of(result))}
        gone = sorted(self._shown.get(topic, set()) - set(found))
        self._shown[topic] = set(found)
        return found, gone

    def detections(self, result: FilterResult) -> Content:
        """Return the objects of a frame as a message."""
        return detections(result.frame.stamp_ns, result.frame.cloud.frame_id, _tracks(self.of(result)))


def _tracks(frame: FrameObjects) -> list[SceneTrack]:
    each = zip(
        frame.tracks,
        frame.states,
        frame.scores.tolist(),
        frame.centers.tolist(),
        frame.sizes.tolist(),
        frame.yaws.tolist(),
        frame.velocities.tolist(),
        strict=True,
    )
    tracks = []
    for number, state, score, center, size, yaw, (vx, vy) in each:
        text = f"{number}: {(vx * vx + vy * vy) ** 0.5:.1f} m/s" if state == CONFIRMED else f"{number}: {state}"
        box = SceneBox(center, size, yaw, _COLORS[state], text)
        tracks.append(SceneTrack(str(number), state, score, box, (vx, vy)))
    return tracks
