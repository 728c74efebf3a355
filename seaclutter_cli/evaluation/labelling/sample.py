"""Evenly spaced labelled frames of a recording, in bounded memory."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.frame import Frame
from seaclutter_cli.truth import Boxes, Truth

_MAX_FRAMES = 12
_MAX_POINTS = 2_000_000
_MAX_BOXES, _MAX_BOXES_IN_FRAME = 120, 40


class LabelledFrame(NamedTuple):
    """Points (3, N) of a frame in metres in the order of x, without those in areas to ignore; boxes of its targets."""

    xyz: NDArray[np.float32]
    targets: Boxes


class FrameSample:
    """Evenly spaced frames among those with boxes: at most 12, with at most 2 million points and 120 boxes.

    When there are more, every other one is dropped, and from then on every other frame is passed over. Of the targets
    of a frame, the nearest 40 are used.

    Parameters
    ----------
    margin_m : float
        Margin of areas to ignore, in metres.
    """

    def __init__(self, margin_m: float) -> None:
        self.frames: list[LabelledFrame] = []
        self._margin_m = margin_m
        self._seen, self._stride = 0, 1

    def offer(self, frame: Frame, truth: Truth) -> None:
        """Take a frame if it has boxes and is due."""
        if not truth.targets:
            return
        if self._seen % self._stride == 0 and frame.size <= _MAX_POINTS:
            self.frames.append(self._taken(frame, truth, truth.targets))
        self._seen += 1
        while self._is_full():
            del self.frames[1::2]
            self._stride *= 2

    def _is_full(self) -> bool:
        points = sum(one.xyz.shape[1] for one in self.frames)
        boxes = sum(len(one.targets) for one in self.frames)
        return len(self.frames) > _MAX_FRAMES or points > _MAX_POINTS or boxes > _MAX_BOXES

    def _taken(self, frame: Frame, truth: Truth, targets: Boxes) -> LabelledFrame:
        used = frame.valid & ~truth.ignored.covers(frame.coordinates, self._margin_m)
        nearest = np.argsort(np.hypot(*targets.centers[:, :2].T), kind="stable")[:_MAX_BOXES_IN_FRAME]
        xyz = frame.coordinates[:, used].astype(np.float32)
        return LabelledFrame(xyz[:, np.argsort(xyz[0], kind="stable")], targets.chosen(nearest))
