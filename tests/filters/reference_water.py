"""The water surface of the method ``confirmed`` as plain loops, for `reference_confirmed`.

It shares with the program only the constants, so that tuning them changes both.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from seaclutter_cli.water import plane, surface, tracker

XYZ = tuple[float, float, float]


class Plane(NamedTuple):
    """The plane z = a + b x + c y."""

    a: float
    b: float
    c: float

    def height_of(self, x: float, y: float, z: float) -> float:
        """Return the height of a point above the plane."""
        return z - (self.a + self.b * x + self.c * y)


@dataclass
class Surface:
    """The water in one frame: plane, deviation, swell, and which points stand upright."""

    plane: Plane
    sigma: float
    swell: "Swell"
    upright: list[bool]

    def above(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Return the height of a point above the water, its standard deviation, and how many echoes show the water."""
        swell, echoes = self.swell.at(x, y)
        unknown = surface._SHRINKAGE / (echoes + surface._SHRINKAGE)
        deviation = self.sigma * math.sqrt(surface._ROUGHNESS**2 + unknown) + surface._RANGE_NOISE_M
        return self.plane.height_of(x, y, z) - swell, deviation, echoes

    def level(self, x: float, y: float) -> float:
        """Return z of the water at a position."""
        return self.plane.a + self.plane.b * x + self.plane.c * y + self.swell.at(x, y)[0]


class Water:
    """The water from frame to frame."""

    def __init__(self) -> None:
        self.plane: Plane | None = None
        self.sigma = 0.0
        self.seen_s = 0.0

    def step(self, points: Sequence[XYZ], time_s: float) -> Surface | None:
        """Return the water of a frame; None where none was seen in the last five seconds."""
        if not 0 <= time_s - self.seen_s <= tracker._MEMORY_S:
            self.plane = None
        near = [k for k, (x, y, _) in enumerate(points) if plane.NEAREST_M <= math.hypot(x, y) < plane.FARTHEST_M]
        cells = {k: cell_of(*points[k][:2]) for k in near}
        bearings = {bearing for bearing, _ in cells.values()}
        sigma = tracker._START_SIGMA_M if self.plane is None else self.sigma
        stands: list[bool] | None = None
        if len(set(cells.values())) >= plane._MIN_CELLS and len(bearings) >= plane._MIN_BEARINGS:
            stands = self.update(points, cells, sigma, time_s)
        if self.plane is None:
            return None
        if stands is None:
            stands = upright(points, [self.plane.height_of(*point) for point in points], 0.25 + sigma)
        return self.surface(self.plane, points, stands)

    def update(
        self, points: Sequence[XYZ], cells: Mapping[int, tuple[int, int]], sigma: float, time_s: float
    ) -> list[bool]:
        """Estimate the plane and the deviation; return which points stand upright."""
        lowest: dict[tuple[int, int], XYZ] = {}
        for k, cell in cells.items():
            if cell not in lowest or points[k][2] < lowest[cell][2]:
                lowest[cell] = points[k]
        fitted, weights = self.fit(lowest)
        water_cells = {cell for cell, weight in weights.items() if weight > plane._ABOVE / 3}
        first = self.plane is None
        stands = upright(points, [fitted.height_of(*point) for point in points], 0.25 + sigma)
        flat = [(points[k], cell) for k, cell in cells.items() if not stands[k]]
        offset = 0.0
        for _ in range(tracker._START_PASSES if first else 1):
            offset, sigma = mean_level(flat, water_cells, fitted, band(sigma))
        if fitted.a + offset < 0:
            old = 0.0 if first else math.exp((self.seen_s - time_s) / tracker._SIGMA_TIME_S)
            self.sigma = old * self.sigma + (1 - old) * sigma
            self.plane = Plane(fitted.a + offset, fitted.b, fitted.c)
            self.seen_s = time_s
        return stands

    def fit(self, lowest: dict[tuple[int, int], XYZ]) -> tuple[Plane, dict[tuple[int, int], float]]:
        """Return the plane through the lowest points, and the weight of each cell."""
        if self.plane is not None:
            return reweighted(lowest, self.plane)
        heights = sorted(z for _, _, z in lowest.values())
        levels = [heights[int(share * len(heights))] for share in plane._START_SHARES]
        fits = [reweighted(lowest, Plane(level, 0, 0)) for level in levels]
        fits = [one for one in fits if one[0].a < 0] or fits
        most = max(sum(weights.values()) for _, weights in fits)
        supported = [one for one in fits if sum(one[1].values()) >= plane._SUPPORT * most]
        return min(supported, key=lambda one: one[0].a)

    def surface(self, level: Plane, points: Sequence[XYZ], stands: list[bool]) -> Surface:
        flat = [(x, y, level.height_of(x, y, z)) for (x, y, z), up in zip(points, stands, strict=True) if not up]
        swell = Swell((x, y, h) for x, y, h in flat if abs(h) <= band(self.sigma))
        swell = Swell((x, y, h) for x, y, h in flat if abs(h - swell.at(x, y)[0]) <= band(self.sigma))
        return Surface(level, self.sigma, swell, stands)


def cell_of(x: float, y: float) -> tuple[int, int]:
    """Return bearing and ring of the polar cell of a position."""
    turn = (math.atan2(y, x) + math.pi) * (plane._BEARINGS / (2 * math.pi))
    ring = int((math.hypot(x, y) - plane.NEAREST_M) // plane._STEP_M)
    return math.floor(turn) % plane._BEARINGS, min(ring, plane._RINGS - 1)


def band(sigma: float) -> float:
    """Return the height around the water within which echoes count as water."""
    return max(tracker._MIN_BAND_M, tracker._BAND_SIGMAS * sigma)


def reweighted(lowest: dict[tuple[int, int], XYZ], start: Plane) -> tuple[Plane, dict[tuple[int, int], float]]:
    """Return the result of iteratively reweighted least squares with Tukey's weights."""
    fitted, weights = start, dict.fromkeys(lowest, 0.0)
    for scale in plane._SCALES_M:
        for cell, point in lowest.items():
            residual = fitted.height_of(*point)
            weight = max(0.0, 1 - (residual / (3 * scale)) ** 2) ** 2
            weights[cell] = weight * plane._ABOVE if residual > 0 else weight
        if sum(weights.values()) < plane._MIN_BEARINGS:
            break
        matrix = [[0.0] * 3 for _ in range(3)]
        right = [0.0] * 3
        for cell, (x, y, z) in lowest.items():
            row = (1.0, x, y)
            for i in range(3):
                right[i] += weights[cell] * row[i] * z
                for j in range(3):
                    matrix[i][j] += weights[cell] * row[i] * row[j]
        for i, ridge in enumerate((1e-9, plane._TILT_RIDGE, plane._TILT_RIDGE)):
            matrix[i][i] += ridge
        fitted = Plane(*solved(matrix, right))
    return fitted, weights


def solved(matrix: list[list[float]], right: list[float]) -> list[float]:
    """Return the solution of three linear equations by Gaussian elimination."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for i in range(3):
        best = max(range(i, 3), key=lambda k: abs(rows[k][i]))
        rows[i], rows[best] = rows[best], rows[i]
        for k in range(3):
            if k != i:
                factor = rows[k][i] / rows[i][i]
                rows[k] = [a - factor * b for a, b in zip(rows[k], rows[i], strict=True)]
    return [rows[i][3] / rows[i][i] for i in range(3)]


def mean_level(
    echoes: Sequence[tuple[XYZ, tuple[int, int]]],
    water_cells: set[tuple[int, int]],
    level: Plane,
    reach: float,
) -> tuple[float, float]:
    """Return median and deviation of the water's height above a plane, each cell with the same weight."""
    heights = [
        (level.height_of(*point), cell)
        for point, cell in echoes
        if cell in water_cells and abs(level.height_of(*point)) <= reach
    ]
    if not heights:
        return 0.0, 0.0
    count: dict[tuple[int, int], int] = {}
    for _, cell in heights:
        count[cell] = count.get(cell, 0) + 1
    ordered = [(height, 1 / count[cell]) for height, cell in sorted(heights, key=lambda one: one[0])]
    low, middle = (weighted_quantile(ordered, share) for share in (0.16, 0.5))
    return middle, middle - low


def weighted_quantile(ordered: Sequence[tuple[float, float]], share: float) -> float:
    """Return the first value at which the weights add up to a share of all."""
    whole = 0.0
    for _, weight in ordered:
        whole += weight
    total = 0.0
    for value, weight in ordered:
        total += weight
        if total >= whole * share:
            return value
    raise AssertionError("the weights add up to their sum")


def upright(points: Sequence[XYZ], heights: Sequence[float], span: float) -> list[bool]:
    """Return which points are in columns of 1 m with echoes at several heights, in either of two grids."""
    found = [False] * len(points)
    for shift in (0.0, 0.5):
        members: dict[tuple[int, int], list[int]] = {}
        for number, (x, y, _) in enumerate(points):
            if abs(x) < tracker._REACH - 1 and abs(y) < tracker._REACH - 1:
                column = math.floor(x + (tracker._REACH + shift)), math.floor(y + (tracker._REACH + shift))
                members.setdefault(column, []).append(number)
        for own in members.values():
            if max(heights[number] for number in own) - min(heights[number] for number in own) >= span:
                for number in own:
                    found[number] = True
    return found


class Swell:
    """Height of the water above its plane: a Gaussian mean on a grid, shrunk towards 0 where echoes are few."""

    def __init__(self, points: Iterable[tuple[float, float, float]]) -> None:
        self.cells: dict[tuple[int, int], list[float]] = {}
        for x, y, height in points:
            cell = grid_cell(x, y)
            if cell is not None:
                self.cells.setdefault(cell, []).append(height)
        counts, sums = np.zeros((2, surface._CELLS, surface._CELLS))
        for cell, heights in self.cells.items():
            counts[cell] = min(len(heights), surface._MAX_PER_CELL)
            sums[cell] = counts[cell] * sum(heights) / len(heights)
        self.echoes, smooth = smoothed(counts), smoothed(sums)
        self.height = smooth / (self.echoes + surface._SHRINKAGE)

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return height and number of echoes at a position; 0 beyond the grid."""
        cell = grid_cell(x, y)
        return (0.0, 0.0) if cell is None else (float(self.height[cell]), float(self.echoes[cell]))


def grid_cell(x: float, y: float) -> tuple[int, int] | None:
    """Return the grid cell of a position; None beyond the grid."""
    column, row = (math.floor((value + surface._REACH_M) / surface._CELL_M) for value in (x, y))
    return (column, row) if 0 <= column < surface._CELLS and 0 <= row < surface._CELLS else None


def smoothed(grid: np.ndarray) -> np.ndarray:
    """Return the sum of a grid around each cell with Gaussian weights: 1 at the cell, 0 beyond four deviations."""
    deviation = surface._SMOOTHING_M / surface._CELL_M
    reach = math.floor(surface._TRUNCATION * deviation)
    for _ in range(2):  # along one axis, then along the other
        padded = np.pad(grid, ((reach, reach), (0, 0)))
        steps = range(-reach, reach + 1)
        rows = (math.exp(-0.5 * (step / deviation) ** 2) * padded[reach + step :][: len(grid)] for step in steps)
        grid = sum(rows).T
    return grid
