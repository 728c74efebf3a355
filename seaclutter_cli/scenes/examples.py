"""Labelled frames for training, stored as top views finer than an image to allow rotation."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.scenes.model import IMAGE_SIZE, mark_cells
from seaclutter_cli.text import count

_FINER = 4
_WIDER = 1.5
_ENOUGH_CELLS = 1500
_SKETCH_SIZE = int(_FINER * _WIDER * IMAGE_SIZE)
SHARES = (0.6, 0.2, 0.2)
"""Shares of the recordings of each class for training, validation and test, as in [Bi]."""


@dataclass
class Examples:
    """Frames with their scenes, stored as sketches of a few kilobytes, regardless of the frame size.

    A sketch lists the cells with points. Its cells are four times finer than those of a `top_view`, which shows
    ``extent_m`` to each side, and it extends 1.5 times as far, which leaves no empty corners in a rotated view.
    """

    classes: Sequence[str]
    extent_m: float
    recordings: list[tuple[str, int]] = field(default_factory=list)
    """Name and class of each recording."""
    _recording: list[int] = field(default_factory=list)
    _sketches: list[NDArray[np.int32]] = field(default_factory=list)
    _alignments_rad: dict[int, float] = field(default_factory=dict)

    def begin(self, recording: str, scene: int) -> None:
        """Start a recording; ``scene`` is the index of its class."""
        self.recordings.append((recording, scene))

    def add(self, xyz: NDArray[np.float64]) -> bool:
        """Add a frame of the recording, coordinates of shape (3, N); return whether any point is in view."""
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
        """Class index of each frame, shape (N,)."""
        return np.array([self.recordings[recording][1] for recording in self._recording], np.int64)

    def image(self, index: int, rotation_rad: float = 0.0) -> NDArray[np.uint8]:
        """Return the top view of a frame, shape (224, 224), rotated about the lidar."""
        x, y = self._coordinates(index)
        cos, sin = np.cos(rotation_rad), np.sin(rotation_rad)
        return mark_cells(np.stack((cos * x - sin * y, sin * x + cos * y, np.zeros(len(x)))), self.extent_m, IMAGE_SIZE)

    def images(self, indices: Sequence[int] | NDArray[np.int64], rng: np.random.Generator | None) -> NDArray[np.uint8]:
        """Return top views, shape (B, 1, 224, 224), rotated at random if there is a generator.

        Half of them are rotated by any angle, a quarter by multiples of 90°, and a quarter by `alignment_rad` plus such
        a multiple: a quay parallel to own ship looks unlike all others, and would hardly ever occur.
        """
        rotations = np.zeros(len(indices))
        if rng is not None:
            kinds, quarters = rng.integers(4, size=(2, len(indices)))
            rotations = np.where(kinds < 2, rng.uniform(0, 2 * np.pi, len(indices)), quarters * np.pi / 2)
            rotations += [
                self.alignment_rad(int(index)) if kind == 3 else 0.0 for index, kind in zip(indices, kinds, strict=True)
            ]
        views = [self.image(int(index), angle) for index, angle in zip(indices, rotations.tolist(), strict=True)]
        return np.stack(views)[:, None]

    def alignment_rad(self, index: int) -> float:
        """Return the rotation that aligns the straight lines of a frame with rows or columns."""
        if index not in self._alignments_rad:
            x, y = self._coordinates(index)
            step = -(-len(x) // _ENOUGH_CELLS)
            coarse = _best_alignment(x[::step], y[::step], np.radians(np.arange(90)), 2 * self.extent_m / IMAGE_SIZE)
            nearby = coarse + np.radians(np.linspace(-1, 1, 21))
            self._alignments_rad[index] = _best_alignment(x[::step], y[::step], nearby, 2 * self.extent_m / IMAGE_SIZE)
        return self._alignments_rad[index]

    def _coordinates(self, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y of the cells of a frame in metres."""
        row, column = np.divmod(self._sketches[index], _SKETCH_SIZE)
        middle, cell_m = _SKETCH_SIZE / 2 - 0.5, 2 * self.extent_m / (IMAGE_SIZE * _FINER)
        return (middle - row) * cell_m, (middle - column) * cell_m

    def split(self, seed: int) -> "Split":
        """Return the frames split by recording, each class in the shares of `SHARES`.

        `InputError` if a class has fewer than three recordings.
        """
        rng = np.random.default_rng(seed)
        part = np.zeros(len(self.recordings), np.int64)
        known = set(self._recording)
        for scene, name in enumerate(self.classes):
            members = [i for i, (_, kind) in enumerate(self.recordings) if kind == scene and i in known]
            if len(members) < len(SHARES):
                raise InputError(
                    f"{count(len(members), 'recording')} of {name}: at least {len(SHARES)} are needed, one each for "
                    "training, validation and test"
                )
            held_out = [max(1, round(share * len(members))) for share in SHARES[1:]]
            part[rng.permutation(members)] = np.repeat(range(len(SHARES)), (len(members) - sum(held_out), *held_out))
        of_frame = part[self._recording]
        return Split(*(np.flatnonzero(of_frame == number) for number in range(len(SHARES))))


def _best_alignment(
    x: NDArray[np.float64], y: NDArray[np.float64], rotations: NDArray[np.float64], cell_m: float
) -> float:
    """Return the rotation, in radians, that gathers the most cells in the fewest rows and columns."""

    def concentration(rotation: float) -> int:
        cos, sin = np.cos(rotation), np.sin(rotation)
        lines = ((axis - axis.min()) / cell_m for axis in (cos * x - sin * y, sin * x + cos * y))
        return sum(int((np.bincount(line.astype(np.int64)) ** 2).sum()) for line in lines)

    return float(max(rotations.tolist(), key=concentration))


class Split(NamedTuple):
    """Indices of the frames for training, validation and test; no recording is in two parts."""

    train: NDArray[np.int64]
    validation: NDArray[np.int64]
    test: NDArray[np.int64]
