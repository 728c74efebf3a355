"""Training of the scene classifier on labelled frames, which are stored as top views; scores of classifiers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from seaclutter_cli.arrays import Bytes, Floats, Ints, Rng
from seaclutter_cli.errors import InputError, requiring
from seaclutter_cli.evaluation.confusion import Confusion
from seaclutter_cli.scenes import TrainingParams
from seaclutter_cli.scenes.model import IMAGE_SIZE, top_view
from seaclutter_cli.scenes.network import make_network
from seaclutter_cli.text import count, share, table
from seaclutter_cli.threads import in_order

_FINER = 4
_WIDER = 1.5
_ENOUGH_CELLS = 1500
_SKETCH_SIZE = int(_FINER * _WIDER * IMAGE_SIZE)
SHARES = (0.6, 0.2, 0.2)
"""Shares of the recordings of each class for training, validation and test, as in [Bi]."""


class Examples:
    """Frames with their scenes, stored as sketches of a few kilobytes, regardless of the frame size.

    A sketch lists the cells with points. Its cells are four times finer than those of a `top_view`, which shows
    ``extent_m`` to each side, and it extends 1.5 times as far, which leaves no empty corners in a rotated view.
    """

    def __init__(self, classes: Sequence[str], extent_m: float) -> None:
        self.classes, self.extent_m = classes, extent_m
        self.recordings: list[tuple[str, int]] = []
        """Name and class of each recording."""
        self._recording: list[int] = []
        self._sketches: list[np.ndarray[Any, np.dtype[np.int32]]] = []
        self._alignments_rad: dict[int, float] = {}

    def begin(self, recording: str, scene: int) -> None:
        """Start a recording; ``scene`` is the index of its class."""
        self.recordings.append((recording, scene))

    def add(self, xyz: Floats) -> bool:
        """Add a frame of the recording, coordinates of shape (3, N); return whether any point is in view."""
        sketch = np.flatnonzero(top_view(xyz, self.extent_m * _WIDER, _SKETCH_SIZE)).astype(np.int32)
        if len(sketch):
            self._recording.append(len(self.recordings) - 1)
            self._sketches.append(sketch)
        return len(sketch) > 0

    def __len__(self) -> int:
        return len(self._sketches)

    @property
    def scenes(self) -> Ints:
        """Class index of each frame, shape (N,)."""
        return np.array([self.recordings[recording][1] for recording in self._recording], np.int64)

    def image(self, index: int, rotation_rad: float = 0.0) -> Bytes:
        """Return the top view of a frame, shape (224, 224), rotated about the lidar."""
        x, y = self._coordinates(index)
        cos, sin = np.cos(rotation_rad), np.sin(rotation_rad)
        return top_view(np.stack((cos * x - sin * y, sin * x + cos * y, np.zeros(len(x)))), self.extent_m)

    def images(self, indices: Sequence[int] | Ints, rng: Rng | None) -> Bytes:
        """Return top views, shape (B, 1, 224, 224), rotated at random if there is a generator.

        Half of them are rotated by any angle, a quarter by multiples of 90°, and a quarter by `alignment_rad` plus such
        a multiple: a quay parallel to own ship looks unlike all others, and would hardly ever occur.
        """
        rotations = np.zeros(len(indices))
        if rng is not None:
            kinds, quarters = rng.integers(4, size=(2, len(indices)))
            rotations = np.where(kinds < 2, rng.uniform(0, 2 * np.pi, len(indices)), quarters * np.pi / 2)
            for number in np.flatnonzero(kinds == 3).tolist():
                rotations[number] += self.alignment_rad(int(indices[number]))
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

    def _coordinates(self, index: int) -> tuple[Floats, Floats]:
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


def _best_alignment(x: Floats, y: Floats, rotations: Floats, cell_m: float) -> float:
    """Return the rotation, in radians, that gathers the most cells in the fewest rows and columns."""

    def concentration(rotation: float) -> int:
        cos, sin = np.cos(rotation), np.sin(rotation)
        lines = ((axis - axis.min()) / cell_m for axis in (cos * x - sin * y, sin * x + cos * y))
        return sum(int((np.bincount(line.astype(np.int64)) ** 2).sum()) for line in lines)

    return float(max(rotations.tolist(), key=concentration))


class Split(NamedTuple):
    """Indices of the frames for training, validation and test; no recording is in two parts."""

    train: Ints
    validation: Ints
    test: Ints


_TEST_BATCH = 64


@dataclass(frozen=True)
class SceneScores(Confusion):
    """Confusion matrix of scenes: frames by true class (row) and predicted class (column), with their names."""

    classes: Sequence[str]

    @classmethod
    def count(cls, classes: Sequence[str], truth: Ints, predicted: Ints) -> "SceneScores":
        """Return the scores of frames from the indices of their true and predicted classes, shape (N,)."""
        return cls(Confusion.of(truth, predicted, range(len(classes))).counts, classes)

    @property
    def mean_precision(self) -> float:
        """Mean precision of the classes; a class that is never predicted counts as 0."""
        return float(np.nan_to_num(self.precision).mean())

    def as_dict(self) -> dict[str, Any]:
        """Return counts, precision and recall as JSON-compatible data."""
        shares = (
            [round(value, 6) if np.isfinite(value) else None for value in values.tolist()]
            for values in (self.precision, self.recall)
        )
        columns = zip(self.classes, self.counts.tolist(), *shares, strict=True)
        return {
            name: {"predicted": dict(zip(self.classes, row, strict=True)), "precision": precision, "recall": recall}
            for name, row, precision, recall in columns
        }

    def as_text(self) -> str:
        """Return a table of frames by true class (row) and predicted class (column)."""
        correct, predicted = self.counts.diagonal().tolist(), self.counts.sum(axis=0).tolist()
        rows = [
            (name, *(f"{frames:,}" for frames in row), share(right, sum(row)))
            for name, row, right in zip(self.classes, self.counts.tolist(), correct, strict=True)
        ]
        rows.append(("precision", *map(share, correct, predicted), ""))
        return table(("true \\ predicted", *self.classes, "recall"), rows)


@dataclass(frozen=True)
class Epoch:
    """Mean loss and mean precision of the classes after an epoch, in training and on validation."""

    train_loss: float
    validation_loss: float
    train_precision: float
    validation_precision: float


@dataclass(frozen=True)
class Trained:
    """A torch module with the weights of its best epoch, that of the lowest loss on the validation part.

    All epochs, the index of the best, the frames of each part, and the scores on the test part are kept, too.
    """

    network: Any
    epochs: Sequence[Epoch]
    best: int
    split: Split
    test: SceneScores


def train(examples: Examples, params: TrainingParams, on_epoch: Callable[[Epoch], object] = lambda _: None) -> Trained:
    """Return the network of [Bi], trained on labelled frames: softmax cross-entropy, Adam, random rotations.

    Only one thread computes; the same examples and seed give the same weights on the same machine. Another thread makes
    the next images. The learning rate falls to 0 along half a cosine.

    `MissingExtraError` if PyTorch is not installed; `InputError` if a class has too few recordings to be split.
    """
    torch = check_torch()
    split = examples.split(params.seed)
    threads = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        torch.manual_seed(params.seed)
        return _Trainer(examples, params, split).run(on_epoch)
    finally:
        torch.set_num_threads(threads)


def check_torch() -> Any:
    """Return PyTorch; raise `MissingExtraError` if it, or the package onnx, is not installed."""
    with requiring("training", "train"):
        import onnx  # noqa: F401 - must be installed
        import torch
    return torch


class _Trainer:
    def __init__(self, examples: Examples, params: TrainingParams, split: Split) -> None:
        import torch

        self._examples, self._params, self._split = examples, params, split
        self._scenes = examples.scenes
        self._network = make_network(len(examples.classes)).to(memory_format=torch.channels_last)
        self._optimiser = torch.optim.Adam(self._network.parameters(), lr=params.learning_rate)
        steps = params.epochs * len(_batches(split.train, params.batch))
        self._schedule = torch.optim.lr_scheduler.CosineAnnealingLR(self._optimiser, steps)
        self._rng = np.random.default_rng(params.seed)

    def run(self, on_epoch: Callable[[Epoch], object]) -> Trained:
        epochs: list[Epoch] = []
        weights: dict[str, Any] = {}
        for _ in range(self._params.epochs):
            train_loss, on_train = self._epoch(self._split.train, self._params.batch, training=True)
            loss, on_validation = self._epoch(self._split.validation, _TEST_BATCH, training=False)
            if not epochs or loss < min(epoch.validation_loss for epoch in epochs):
                weights = {name: value.clone() for name, value in self._network.state_dict().items()}
            epochs.append(Epoch(train_loss, loss, on_train.mean_precision, on_validation.mean_precision))
            on_epoch(epochs[-1])
        self._network.load_state_dict(weights)
        self._network.eval()
        best = int(np.argmin([epoch.validation_loss for epoch in epochs]))
        _, on_test = self._epoch(self._split.test, _TEST_BATCH, training=False)
        return Trained(self._network, epochs, best, self._split, on_test)

    def _epoch(self, part: Ints, size: int, *, training: bool) -> tuple[float, SceneScores]:
        """Train on a part once, in random order, or only evaluate it; return the mean loss and the scores."""
        import torch
        from torch.nn.functional import cross_entropy

        self._network.train(training)
        order, rng = (self._rng.permutation(part), self._rng) if training else (part, None)
        batches = _batches(order, size)
        views = in_order(lambda number: self._examples.images(batches[number], rng), len(batches), workers=1, ahead=2)
        losses, predicted = [], []
        with torch.set_grad_enabled(training):
            for batch, images in zip(batches, views, strict=True):
                scores = self._network(torch.from_numpy(images).float())
                loss = cross_entropy(scores, torch.from_numpy(self._scenes[batch]))
                if training:
                    self._optimiser.zero_grad()
                    loss.backward()
                    self._optimiser.step()
                    self._schedule.step()
                losses.append(float(loss.detach()) * len(batch))
                predicted.append(scores.detach().argmax(1).numpy())
        confusion = SceneScores.count(self._examples.classes, self._scenes[order], np.concatenate(predicted))
        return sum(losses) / len(order), confusion


def _batches(part: Ints, size: int) -> list[Ints]:
    return [part[start : start + size] for start in range(0, len(part), size)]
