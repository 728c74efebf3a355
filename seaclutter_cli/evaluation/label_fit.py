"""The fit of boxes to points, and changes that make it better: probable mistakes of whoever wrote the labels."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Mask
from seaclutter_cli.frame import Frame
from seaclutter_cli.truth import Boxes, Truth

_SMALLEST_M, LARGEST_M = 0.2, 500.0
"""The longest side of a target is not smaller or larger."""

_MIN_FIT = {1: 0.5, 2: 0.65}
"""Fit with a mistake undone, or two at once: among many pairs, one fits a little by chance."""

_MIN_GAIN = 0.15
_MIN_GAIN_OF_INACCURACY = 0.3
"""For changes that could also undo inaccurate work."""

_ALIKE = 0.02
_HOPELESS = 0.3
_MAX_CHANGES = 3
_LEAST_REACH_M = 2.0
_MANY_POINTS, _LONG_M = 20, 10.0
_SHIFT_STEPS, _SHIFT_STARTS = 3, 4
_BIN_M, _SMALL_SHIFT_M = 0.5, 2.0
_MAX_FRAMES, _MAX_POINTS = 12, 2_000_000
_MAX_BOXES, _MAX_BOXES_IN_FRAME = 120, 40


class LabelledFrame(NamedTuple):
    """Points (3, N) of a frame in metres in the order of x, without those in areas to ignore; boxes of its targets."""

    xyz: NDArray[np.float32]
    targets: Boxes


class FrameSample:
    """Evenly spaced frames among those with boxes: at most 12, with at most 2 million points and 120 boxes.

    When there are more, every other one is dropped, and from then on every other frame is passed over. Of the targets
    of a frame, the nearest 40 are used. Areas to ignore are inflated by a margin.
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
            used = frame.valid & ~truth.ignored.covers(frame.coordinates, self._margin_m)
            nearest = np.argsort(np.hypot(*truth.targets.centers[:, :2].T), kind="stable")[:_MAX_BOXES_IN_FRAME]
            xyz = frame.coordinates[:, used].astype(np.float32)
            targets = truth.targets.chosen(nearest)
            self.frames.append(LabelledFrame(xyz[:, np.argsort(xyz[0], kind="stable")], targets))
        self._seen += 1
        while (
            len(self.frames) > _MAX_FRAMES
            or sum(one.xyz.shape[1] for one in self.frames) > _MAX_POINTS
            or sum(len(one.targets) for one in self.frames) > _MAX_BOXES
        ):
            del self.frames[1::2]
            self._stride *= 2


@dataclass(frozen=True)
class Change:
    """A change of boxes that undoes a mistake; it is probable if the fit is better by ``min_gain`` at least.

    Texts for messages are the mistake, and what to do about it.
    """

    mistake: str
    remedy: str
    apply: Callable[[Boxes], Boxes]
    min_gain: float = _MIN_GAIN


DEGREES = Change("yaws are in degrees", "convert them to radians", lambda one: replace(one, yaws=np.radians(one.yaws)))


def _scaled(factor: float, *, centers: bool = True) -> Callable[[Boxes], Boxes]:
    return lambda one: replace(one, sizes=one.sizes * factor, centers=one.centers * (factor if centers else 1.0))


def _turned(sign: float, from_rad: float) -> Callable[[Boxes], Boxes]:
    return lambda one: replace(one, yaws=from_rad + sign * one.yaws)


def _swapped_axes(one: Boxes) -> Boxes:
    return replace(one, centers=one.centers[:, [1, 0, 2]])


CHANGES = (
    Change(
        "lengths and widths are swapped",
        "swap them; the length is along the direction of yaw",
        lambda one: replace(one, sizes=one.sizes[:, [1, 0, 2]]),
    ),
    DEGREES,
    Change("yaws count clockwise", "change their signs; yaw counts from x to y", _turned(-1, 0)),
    Change("yaws count clockwise from y", "subtract them from pi/2; yaw counts from x to y", _turned(-1, np.pi / 2)),
    Change("x and y are swapped", "swap them", _swapped_axes),
    Change(
        "x and y are swapped",
        "swap them, and subtract yaws from pi/2",
        lambda one: _turned(-1, np.pi / 2)(_swapped_axes(one)),
    ),
    Change(
        "y has the opposite sign",
        "change the signs of y and yaw",
        lambda one: replace(one, centers=one.centers * [1, -1, 1], yaws=-one.yaws),
    ),
    Change("positions and sizes are in centimetres", "divide them by 100", _scaled(0.01)),
    Change("positions and sizes are in millimetres", "divide them by 1000", _scaled(0.001)),
    Change("sizes are in centimetres", "divide them by 100", _scaled(0.01, centers=False)),
    Change("sizes are in millimetres", "divide them by 1000", _scaled(0.001, centers=False)),
    Change("sizes are half sizes", "multiply them by 2", _scaled(2, centers=False), _MIN_GAIN_OF_INACCURACY),
)
"""Usual mistakes, the likelier of two alike first."""

_MOVING = frozenset(CHANGES[4:9])
"""Changes of positions: with a wrong one, no other change makes a difference."""


@dataclass(frozen=True)
class Guess:
    """A probable mistake: what undoes it, and the fit of the boxes without and with the change."""

    change: Change
    before: float
    after: float


@dataclass(frozen=True)
class LabelFit:
    """The fit of boxes, inflated by a margin, to the points of several frames; one that fits has ``min_points``."""

    frames: Sequence[LabelledFrame]
    margin_m: float
    min_points: int

    def of(self, changes: Iterable[Change] = ()) -> float:
        """Return the mean fit of the boxes after some changes, from 0 to 1.

        The fit of a box is the share of points inside it, among those inside it and those around it that are in no box.
        It is 0 with too few points inside, for a box around the lidar itself, and for one of impossible size. Boxes in
        the wrong place, or turned the wrong way, contain a part of their target or of the sea, which goes on around.
        """
        changes = list(changes)
        fits = [self._fits(one, _changed(one.targets, changes)) for one in self.frames]
        return float(np.concatenate(fits).mean()) if fits else 0.0

    def _fits(self, frame: LabelledFrame, boxes: Boxes) -> Floats:
        found = list(_neighbourhoods(frame.xyz, boxes, self.margin_m))
        unexplained = np.ones(frame.xyz.shape[1], np.bool_)
        for near in found:
            unexplained[near.strip][near.inside] = False
        own = np.array([np.count_nonzero(near.inside) for near in found], np.int64)
        around = np.array([np.count_nonzero(near.around & unexplained[near.strip]) for near in found], np.int64)
        longest = boxes.sizes.max(axis=1)
        possible = (own >= self.min_points) & (longest >= _SMALLEST_M) & (longest <= LARGEST_M)
        possible &= [not len(inside) for inside in boxes.members(np.zeros((3, 1)), 0)]
        return np.where(possible, own / np.maximum(own + around, 1), 0.0)

    def share_in_middle(self) -> float:
        """Return the share of the points of a box that are in the middle third of its length and width.

        It is the median over boxes of at least 10 m with enough points to show their target, 0 if there are none. A
        lidar sees the sides of a target, so there are few points in the middle of a box that fits.
        """
        found = []
        for one in self.frames:
            boxes = one.targets.chosen(np.flatnonzero(one.targets.sizes[:, :2].max(axis=1) >= _LONG_M))
            middles = replace(boxes, sizes=boxes.sizes * [1 / 3, 1 / 3, 1])
            both = (_neighbourhoods(one.xyz, some, self.margin_m) for some in (boxes, middles))
            counts = [[np.count_nonzero(near.inside) for near in some] for some in both]
            found += [middle / own for own, middle in zip(*counts, strict=True) if own >= _MANY_POINTS]
        return float(np.median(found)) if found else 0.0

    def guesses(self, known: Sequence[Change] = ()) -> list[Guess]:
        """Return the changes that make the fit much better, one after another, beside those that are known."""
        found: list[Guess] = []
        fit = self.of(known)
        while len(found) < _MAX_CHANGES and fit + _MIN_GAIN <= 1:
            made = (*known, *(one.change for one in found))
            shifts = self._shifts(made)
            better = self._best(made, fit, [(change,) for change in (*CHANGES, *shifts) if change not in made])
            if not better and fit < _HOPELESS:  # two mistakes at once
                pairs = [pair for pair in combinations(CHANGES, 2) if _MOVING.intersection(pair)]
                better = self._best(made, fit, [*pairs, *product(shifts, CHANGES)])
            found += better
            if not better:
                break
            fit = better[-1].after
        return found

    def _best(self, made: Sequence[Change], fit: float, ways: Sequence[Sequence[Change]]) -> list[Guess]:
        fits = [self.of((*made, *way)) for way in ways]
        least = [max(fit + max(change.min_gain for change in way), _MIN_FIT[len(way)]) for way in ways]
        probable = np.where(np.greater_equal(fits, least), fits, 0.0).tolist()
        if not (top := max(probable, default=0.0)):
            return []
        best = next(k for k, after in enumerate(probable) if after >= top - _ALIKE)
        return [Guess(change, fit, fits[best]) for change in ways[best]]

    def _shifts(self, made: Sequence[Change]) -> list[Change]:
        """Return the shift that fits best, along z only unless another one is better."""
        frames = [one._replace(targets=_changed(one.targets, made)) for one in self.frames]
        found = []
        for start_m in (0.0, *self._heights(frames)):
            shift_m = np.array([0.0, 0.0, start_m])
            for _ in range(_SHIFT_STEPS):
                shift_m += self._step(frames, shift_m)
            found.append(shift_m)
        changes = [_shift(shift_m * axes) for axes in ([0, 0, 1], [1, 1, 1]) for shift_m in found]
        fits = np.array([self.of((*made, change)) for change in changes])
        return [changes[int(np.argmax(fits >= fits.max() - _ALIKE))]]

    def _heights(self, frames: Iterable[LabelledFrame]) -> list[float]:
        """Return heights of points relative to the boxes above or below them, the commonest first."""
        votes: Counter[int] = Counter()
        for one in frames:
            columns = replace(one.targets, sizes=one.targets.sizes * [1, 1, 0] + [0, 0, np.inf])
            for near, center in zip(_neighbourhoods(one.xyz, columns, 0.0), one.targets.centers, strict=True):
                above_m = one.xyz[2, near.strip][near.inside] - center[2]
                bins, counts = np.unique(np.round(above_m / _BIN_M), return_counts=True)
                votes.update(bins[counts >= self.min_points].tolist())
        return [_BIN_M * number for number, _ in votes.most_common(_SHIFT_STARTS)]

    def _step(self, frames: Iterable[LabelledFrame], shift_m: Floats) -> Floats:
        """Return the median offset of the median of the points near each box, once boxes are shifted."""
        offsets = []
        for one in frames:
            boxes = replace(one.targets, centers=one.targets.centers + shift_m)
            for near, center in zip(_neighbourhoods(one.xyz, boxes, 0.0), boxes.centers, strict=True):
                if np.count_nonzero(near.around) >= self.min_points:
                    points = one.xyz[:, near.strip][:, near.around]
                    offsets.append(np.median(points, axis=1) - center)
        return np.median(offsets, axis=0) if offsets else np.zeros(3)


class _Neighbourhood(NamedTuple):
    """Points in a strip along y: whether each is inside a box, and inside or around it."""

    strip: slice
    inside: Mask
    around: Mask


def _neighbourhoods(xyz: NDArray[np.float32], boxes: Boxes, margin_m: float) -> Iterator[_Neighbourhood]:
    """Yield the points in and around each inflated box; those around are at most half its longest side away."""
    longest = np.where(np.isfinite(boxes.sizes), boxes.sizes, 0).max(axis=1)
    reaches = np.maximum(_LEAST_REACH_M, longest / 2)
    for center, half, yaw, reach in zip(boxes.centers, boxes.sizes / 2 + margin_m, boxes.yaws, reaches, strict=True):
        far = np.hypot(half[0] + reach, half[1] + reach) if reach <= LARGEST_M / 2 else 0.0
        strip = slice(*np.searchsorted(xyz[0], (center[0] - far, center[0] + far)).tolist())
        x, y, z = xyz[:, strip] - center.astype(np.float32)[:, None]
        sides = np.abs([np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x, z])
        inside, around = ((sides <= (half + more)[:, None]).all(axis=0) for more in (0.0, reach))
        yield _Neighbourhood(strip, inside, around)


def _shift(distance_m: Floats) -> Change:
    """Return the change for boxes that are off by a distance along the axes, to half a metre."""
    shift_m = np.round(distance_m / _BIN_M) * _BIN_M
    amounts = [(axis, float(amount)) for axis, amount in zip("xyz", shift_m, strict=True) if amount]
    where = " and ".join(f"{-amount:+g} m in {axis}" for axis, amount in amounts)
    how = " and ".join(f"{amount:+g} m to {axis}" for axis, amount in amounts)
    return Change(
        f"positions are off by about {where}",
        f"add {how}",
        lambda one: replace(one, centers=one.centers + shift_m),
        _MIN_GAIN if np.linalg.norm(shift_m) >= _SMALL_SHIFT_M else _MIN_GAIN_OF_INACCURACY,
    )


def _changed(boxes: Boxes, changes: Iterable[Change]) -> Boxes:
    for change in changes:
        boxes = change.apply(boxes)
    return boxes
