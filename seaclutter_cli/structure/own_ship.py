"""Where own ship ends in each direction, learned from the frames of a recording while they come."""

from collections import deque
from dataclasses import replace

import numpy as np

from seaclutter_cli.arrays import Floats, Indices, Ints, Mask
from seaclutter_cli.cloud import from_array
from seaclutter_cli.frame import Frame
from seaclutter_cli.structure.mask import StructureMask, azimuth_deg
from seaclutter_cli.structure.search import MIN_FRAMES, StructureSearch
from seaclutter_cli.water import Mounting, WaterSurface

_EVERY = 5
_WINDOWS = 6
_MARGIN_M = 0.5
_BESIDE = 5
_MIN_POINTS = 5
_MOST_POINTS = 1 << 17


class OwnShip:
    """The range to which own ship reaches in each degree of azimuth, from ``least_m`` to at most ``reach_m``.

    ``beside`` is the number of ``seen`` frames in which something else stands out of the water within the reach;
    ``level_m`` is the mean height of the water at the lidar, ``beams_deg`` are the elevations of its beams, None while
    they are not known.

    1. A `StructureSearch` looks at windows of 20 frames: the first ones, then every ``every``-th.
    2. Windows in which the vessel is at rest do not show it, because a quay is as constant as own ship. Until another
       does, all that is constant belongs to it.
    3. Own ship reaches 0.5 m beyond what the last six other windows show within 5° of a direction. What is nearer
       belongs to it, constant or not: crew, flags and ropes do.

    **State**: the counts of a window, six outlines of 360 ranges, and what was constant in the last window.
    """

    def __init__(self, reach_m: float, least_m: float, mounting: Mounting | None = None, every: int = _EVERY) -> None:
        self.reach_m, self._least_m, self._mounting, self._every = reach_m, least_m, mounting, every
        self.reset()

    def reset(self) -> None:
        """Forget own ship."""
        self._outlines: deque[Floats] = deque(maxlen=_WINDOWS)
        self._constant: Floats | None = None
        self._structure = StructureMask(())
        self._frames = self.seen = self.beside = 0
        self._is_due = False
        self.is_at_rest = False
        """Whether the vessel was at rest in the last window."""
        self.level_m: float | None = None
        self.beams_deg: Floats | None = None
        self._begin()

    def _begin(self) -> None:
        self._search = StructureSearch(self.reach_m, self._mounting, MIN_FRAMES)
        self._standing: list[tuple[Ints, Floats]] = []

    @property
    def outline_m(self) -> Floats | None:
        """Range to which own ship reaches in each degree from -180°, shape (360,); None while it is not known."""
        return np.max(self._outlines, axis=0) if self._outlines else None

    @property
    def is_known(self) -> bool:
        """Whether it is known where own ship ends, or at least what is constant."""
        return self._constant is not None

    @property
    def end_m(self) -> float | None:
        """Range of the farthest structure; 0 if all that is constant is nearer than ``least_m``, None if not known."""
        outline = self.outline_m
        if outline is None:
            return None
        return float(outline.max()) - _MARGIN_M if outline.max() > self._least_m else 0.0

    def add(self, frame: Frame, *, finds_water: bool = True) -> None:
        """Add the next frame; unless it ``finds_water`` itself, `see` must follow."""
        self._frames += 1
        self._is_due = self._frames <= MIN_FRAMES or self._frames % self._every == 0
        if self._is_due:
            thinned = _thinned(frame)
            self._search.add(thinned, finds_water=finds_water)
            if finds_water:
                self._look(thinned, self._search.bodies)

    def see(self, frame: Frame, water: WaterSurface | None, standing: Indices) -> None:
        """Receive the water of the frame added last, in the levelled frame, and the points that stand out of it."""
        if self._is_due:
            self._search.see(water)
            self._look(frame, standing if water is not None else standing[:0])

    def _look(self, frame: Frame, standing: Indices) -> None:
        xyz = frame.coordinates_of(standing)  # the frame may be released
        range_m = np.sqrt(xyz[0] * xyz[0] + xyz[1] * xyz[1] + xyz[2] * xyz[2])
        near = range_m < self.reach_m
        self._standing.append((_columns(xyz[:, near]), range_m[near]))
        if self._search.frames == MIN_FRAMES:
            self._decide()

    def _decide(self) -> None:
        found = self._search.found()
        self.level_m, self.beams_deg = self._search.level_m, self._search.beams_deg
        self.is_at_rest = found.is_at_rest
        self._structure = found.constant
        self._constant = np.maximum(_outline(found.constant), self._least_m)
        if not found.is_at_rest:
            self._outlines.append(self._constant)
            outline = np.max(self._outlines, axis=0)
            beyond = [np.count_nonzero(range_m > outline[column]) for column, range_m in self._standing]
            self.seen += len(beyond)
            self.beside += sum(int(points >= _MIN_POINTS) for points in beyond)
        self._begin()

    def contains(self, frame: Frame) -> Mask:
        """Return whether each point is own ship, shape (N,): all within the reach while nothing is known."""
        inside, outline = frame.range_m < self.reach_m, self.outline_m if self._outlines else self._constant
        if outline is not None:
            near = np.flatnonzero(inside)
            inside[near] = frame.range_m[near] < outline[_columns(frame.coordinates[:, near])]
        return inside

    def is_structure(self, frame: Frame, points: Indices) -> Mask:
        """Return whether some points were constant in the last window, as decks, masts and rails are, shape (n,)."""
        return self._structure.contains(frame.coordinates_of(points), frame.range_m[points])


def _thinned(frame: Frame) -> Frame:
    """Return a frame with its points, or every second, third and so on of very many: own ship is dense."""
    step = -(-frame.size // _MOST_POINTS)
    return frame if step < 2 else replace(frame, cloud=from_array(frame.cloud.points[::step]))


def _columns(xyz: Floats) -> Ints:
    return np.minimum((azimuth_deg(xyz) + 180).astype(np.int64), 359)  # 180° itself belongs to the last


def _outline(mask: StructureMask) -> Floats:
    outline = np.zeros(360)
    for one in mask.sectors:
        column = int(one.azimuth_min_deg + 180)
        outline[column] = max(outline[column], one.range_max_m + _MARGIN_M)
    return np.asarray(np.max([np.roll(outline, shift) for shift in range(-_BESIDE, _BESIDE + 1)], axis=0))
