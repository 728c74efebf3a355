"""Labelled frames to train on: what was seen from above, finer than an image, so that it can be turned."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.scenes.image import IMAGE_SIZE, mark_cells

_FINER = 4
_WIDER = 1.5
_ENOUGH_CELLS = 1500
_SKETCH_SIZE = int(_FINER * _WIDER * IMAGE_SIZE)
SHARES = (0.6, 0.2, 0.2)
"""Shares of the recordings of each class for training, validation and test, as in S3."""


@dataclass
class Examples:
    """Frames with their scenes, as sketches: a few kilobytes each, whatever the frame's size.

    A sketch is the cells that hold points, four times finer than those of a `top_view` and half as far out again, so
    that a turned view has no empty corners.

    Parameters
    ----------
    classes : sequence of str
        Names of the scenes.
    extent_m : float
        Half side of the square that images show.
    """

    classes: Sequence[str]
    extent_m: float
    recordings: list[tuple[str, int]] = field(default_factory=list)
    """Name and class of each recording."""
    _recording: list[int] = field(default_factory=list)
    _sketches: list[NDArray[np.int32]] = field(default_factory=list)
    _straight: dict[int, float] = field(default_factory=dict)

    def begin(self, recording: str, scene: int) -> None:
        """Start a recording of a scene, given by its place among the classes."""
        self.recordings.append((recording, scene))

    def add(self, xyz: NDArray[np.float64]) -> bool:
        """Add a frame of the recording, coordinates of shape (3, N); False if nothing of it is in view."""
        sketch = np.flatnonzero(mark_cells(xyz, self.extent_m * _WIDER, _SKETCH_SIZE)).astype(np.int32)
        if len(sketch):
            self._recording.append(len(self.recordings) - 1)
            self._sketches.append(sketch)
        return len(sketch) > 0

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._sketches)

    @property
    def scenes(self) -> NDArray[np.int64]:
        """Class of each frame, shape (N,)."""
        return np.array([self.recordings[recording][1] for recording in self._recording], np.int64)

    def image(self, index: int, turn_rad: float = 0.0) -> NDArray[np.uint8]:
        """Return the top view of a frame, shape (224, 224), with the lidar turned; as it was seen if not turned."""
        x, y = self._places(index)
        cos, sin = np.cos(turn_rad), np.sin(turn_rad)
        return mark_cells(np.stack((cos * x - sin * y, sin * x + cos * y, np.zeros(len(x)))), self.extent_m, IMAGE_SIZE)

    def images(self, indices: Sequence[int] | NDArray[np.int64], rng: np.random.Generator | None) -> NDArray[np.uint8]:
        """Return top views, shape (B, 1, 224, 224), turned at random if there is a generator.

        Half of them are turned by any angle, a quarter by whole quarters, and a quarter so that the `straight` lines in
        them run along rows or columns: a quay parallel to the vessel looks unlike all others, and would hardly come up.
        """
        turns = np.zeros(len(indices))
        if rng is not None:
            kinds, quarters = rng.integers(4, size=(2, len(indices)))
            turns = np.where(kinds < 2, rng.uniform(0, 2 * np.pi, len(indices)), quarters * np.pi / 2)
            turns += [
                self.straight(int(index)) if kind == 3 else 0.0 for index, kind in zip(indices, kinds, strict=True)
            ]
        views = [self.image(int(index), turn) for index, turn in zip(indices, turns.tolist(), strict=True)]
        return np.stack(views)[:, None]

    def straight(self, index: int) -> float:
        """Return by how many radians a frame has to be turned so that its straight lines run along rows or columns."""
        if index not in self._straight:
            x, y = self._places(index)
            step = -(-len(x) // _ENOUGH_CELLS)
            turn = _most_in_line(x[::step], y[::step], np.radians(np.arange(90)), 2 * self.extent_m / IMAGE_SIZE)
            nearby = turn + np.radians(np.linspace(-1, 1, 21))
            self._straight[index] = _most_in_line(x[::step], y[::step], nearby, 2 * self.extent_m / IMAGE_SIZE)
        return self._straight[index]

    def _places(self, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y of a frame's cells in metres."""
        row, column = np.divmod(self._sketches[index], _SKETCH_SIZE)
        middle, cell_m = _SKETCH_SIZE / 2 - 0.5, 2 * self.extent_m / (IMAGE_SIZE * _FINER)
        return (middle - row) * cell_m, (middle - column) * cell_m

    def split(self, seed: int) -> "Split":
        """Part the frames by their recordings, each class in the shares of `SHARES`.

        Raises
        ------
        InputError
            If a class has fewer than three recordings.
        """
        rng = np.random.default_rng(seed)
        part = np.zeros(len(self.recordings), np.int64)
        known = set(self._recording)
        for scene, name in enumerate(self.classes):
            members = [i for i, (_, kind) in enumerate(self.recordings) if kind == scene and i in known]
            if len(members) < len(SHARES):
                raise InputError(
                    f"{len(members)} recordings of {name}: at least {len(SHARES)} are needed, one each to train on, to "
                    "choose the best epoch by, and to test on"
                )
            held = [max(1, round(share * len(members))) for share in SHARES[1:]]
            part[rng.permutation(members)] = np.repeat(range(len(SHARES)), (len(members) - sum(held), *held))
        of_frame = part[self._recording]
        return Split(*(np.flatnonzero(of_frame == number) for number in range(len(SHARES))))


def _most_in_line(x: NDArray[np.float64], y: NDArray[np.float64], turns: NDArray[np.float64], cell_m: float) -> float:
    """Return the one of some turns, in radians, that gathers most cells in few rows and columns."""

    def gathered(turn: float) -> int:
        cos, sin = np.cos(turn), np.sin(turn)
        lines = ((axis - axis.min()) / cell_m for axis in (cos * x - sin * y, sin * x + cos * y))
        return sum(int((np.bincount(line.astype(np.int64)) ** 2).sum()) for line in lines)

    return float(max(turns.tolist(), key=gathered))


class Split(NamedTuple):
    """Frames to train on, to choose the best epoch by, and to test on; no recording is in two of them."""

    train: NDArray[np.int64]
    validation: NDArray[np.int64]
    test: NDArray[np.int64]
