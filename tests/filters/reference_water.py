"""The water surface of the method ``confirmed`` as plain loops, for `reference_confirmed`.

It shares with the program only the constants, so that tuning them changes both.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from seaclutter_cli.water import plane, surface, tracker
from seaclutter_cli.water.faces import LEAST_M
from tests.filters.reference_faces import Face

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
    """The water in one frame: plane, deviation, variance of the slope, swell, errors of level and plane."""

    plane: Plane
    sigma: float
    swell: "Swell"
    level_sigma: float
    covariance: list[list[float]]

    def above(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Return the height of a point above the water, its standard deviation, and how many echoes show the water."""
        swell, echoes = self.swell.at(x, y)
        unknown = surface._SHRINKAGE / (echoes + surface._SHRINKAGE)
        variance = self.sigma**2 * (surface._ROUGHNESS**2 + unknown)
        deviation = math.sqrt(variance) + surface.RANGE_NOISE_M
        return self.plane.height_of(x, y, z) - swell, deviation, echoes

    def is_below(self, x: float, y: float, z: float, factor: float = 1.0) -> bool:
        """Return whether a point is below the water, also if the plane is wrong, by a factor more than it says."""
        height, deviation, _ = self.above(x, y, z)
        if height >= -surface._MIN_DEPTH_M:  # most points are
            return False
        row = (1.0, x, y)
        variance = sum(row[i] * self.covariance[i][j] * row[j] for i in range(3) for j in range(3))
        error = math.sqrt(deviation**2 + factor**2 * variance)
        return height < -max(surface._MIN_DEPTH_M, surface._DEPTH_SIGMAS * error)

    def level(self, x: float, y: float) -> float:
        """Return z of the water at a position."""
        return self.plane.a + self.plane.b * x + self.plane.c * y + self.swell.at(x, y)[0]


class Water:
    """The water from frame to frame."""

    def __init__(self) -> None:
        self.plane: Plane | None = None
        self.sigma = 0.0
        self.covariance = [[0.0] * 3] * 3
        self.seen_s = 0.0

    def step(
        self, points: Sequence[XYZ], faces: Sequence[Face], time_s: float, own: Sequence[int] = ()
    ) -> Surface | None:
        """Return the water of a frame; None where none was seen in the last five seconds."""
        if not 0 <= time_s - self.seen_s <= tracker._MEMORY_S:
            self.plane = None
        sigma = tracker._START_SIGMA_M if self.plane is None else self.sigma
        span = LEAST_M + sigma
        near = [k for k, (x, y, _) in enumerate(points) if plane.NEAREST_M <= math.hypot(x, y) < plane.FARTHEST_M]
        near = [k for k in near if k not in own]
        bodies = [k for k in near if faces[k].height > tracker._BODY_M + 2 * sigma]
        feet = feet_of([(cell_of(*points[k][:2]), faces[k].low) for k in bodies])
        used = [k for k in near if faces[k].height <= span]
        used = [k for k in used if not is_part(points[k], feet)]
        cells = cells_of(points, used, feet)
        for k in bodies:
            foot = cells[*cell_of(*points[k][:2]), True]
            foot.top = max(foot.top, faces[k].top)
        fitted, weights = self.plane, None
        if len(cells) >= plane._MIN_CELLS and len({bearing for bearing, *_ in cells}) >= plane.MIN_SUPPORT:
            fitted, weights = self.fit(cells)
        if fitted is None:
            return None
        if weights is not None and contradict(cells, fitted, weights):
            self.plane, self.sigma, self.seen_s = None, 0.0, 0.0
            fitted, weights = self.fit(cells)
            span = LEAST_M + tracker._START_SIGMA_M
            if contradict(cells, fitted, weights):
                return None
        stands = []
        for (x, y, z), face in zip(points, faces, strict=True):
            stands.append(face.above(z - fitted.height_of(x, y, z)) > span)
        if weights is not None:
            flat = [points[k] for k in used if not stands[k]]
            trust = {key[:2]: cells[key].trust for key in sorted(cells)}  # that of feet counts
            water = {key[:2] for key, weight in weights.items() if is_water(weight, cells[key].trust)}
            trust = {key: trust[key] for key in water}
            if any(weights.values()):
                self.update(fitted, flat, trust, self.new_covariance(cells, fitted, weights, time_s), time_s)
        return None if self.plane is None else self.surface(self.plane, points, stands, time_s)

    def update(
        self,
        fitted: Plane,
        flat: Sequence[XYZ],
        trust: Mapping[tuple[int, int], float],
        covariance: list[list[float]],
        time_s: float,
    ) -> None:
        """Estimate level and deviation around a plane from flat points in the cells of water."""
        first = self.plane is None
        sigma, offset = tracker._START_SIGMA_M if first else self.sigma, 0.0
        for _ in range(tracker._START_PASSES if first else 1):
            offset, sigma = mean_level(flat, trust, fitted, band(sigma))
        if fitted.a + offset < 0:
            old = 0.0 if first else math.exp((self.seen_s - time_s) / tracker._SIGMA_TIME_S)
            self.sigma = old * self.sigma + (1 - old) * sigma
            self.plane = Plane(fitted.a + offset, fitted.b, fitted.c)
            self.covariance, self.seen_s = covariance, time_s

    def fit(self, cells: "Cells") -> tuple[Plane, dict["Key", float]]:
        """Return the plane through the lowest points, and the weight of each cell."""
        if self.plane is not None:
            fits = [reweighted(cells, self.plane, coarse) for coarse in (plane._COARSE_M, ())]
            return max(fits, key=lambda fit: fit[2])[:2]
        weighted = sorted((cell.lowest[2], cell.trust) for cell in cells.values())
        levels = [weighted_quantile(weighted, part) for part in plane._START_SHARES]
        fits = [reweighted(cells, Plane(level, 0, 0), plane._COARSE_M)[:2] for level in levels]
        below = [one for one in fits if one[0].a < 0 and sum(one[1].values()) >= plane.LEAST_SUPPORT]
        below = [one for one in below or fits if not contradict(cells, *one)] or below
        enough = plane._SUPPORT * max(sum(weights.values()) for _, weights in below or fits)
        return min((one for one in below or fits if sum(one[1].values()) >= enough), key=lambda one: one[0].a)

    def surface(self, level: Plane, points: Sequence[XYZ], stands: list[bool], time_s: float) -> Surface:
        flat = [(x, y, level.height_of(x, y, z)) for (x, y, z), up in zip(points, stands, strict=True) if not up]
        swell = Swell((x, y, h) for x, y, h in flat if abs(h) <= band(self.sigma))
        swell = Swell((x, y, h) for x, y, h in flat if abs(h - swell.at(x, y)[0]) <= band(self.sigma))
        held = self.held_covariance(time_s)
        variance = held[0][0] + (tracker._CRESTS * self.sigma) ** 2 + surface.RANGE_NOISE_M**2
        return Surface(level, self.sigma, swell, math.sqrt(variance), held)

    def new_covariance(
        self, cells: "Cells", fitted: Plane, weights: Mapping["Key", float], time_s: float
    ) -> list[list[float]]:
        if self.plane is None or sum(weights.values()) >= plane.LEAST_SUPPORT:
            return covariance_of(cells, fitted, weights)
        return self.held_covariance(time_s)

    def held_covariance(self, time_s: float) -> list[list[float]]:
        heave = self.sigma**2 * (time_s - self.seen_s) / tracker._SIGMA_TIME_S
        return [[self.covariance[0][0] + heave, *self.covariance[0][1:]], *self.covariance[1:]]


@dataclass
class Cell:
    """A polar cell: its lowest point, how far that may be trusted to be water, and the top of bodies above it."""

    lowest: XYZ
    trust: float
    top: float | None = None

    @property
    def distance_squared(self) -> float:
        x, y, _ = self.lowest
        return x * x + y * y


Key = tuple[int, int, bool]
"""Bearing and ring of a cell, and whether it is that of a foot."""
Cells = Mapping[Key, Cell]


def feet_of(lows: Sequence[tuple[tuple[int, int], float]]) -> dict[tuple[int, int], float]:
    """Return the foot of the bodies in each cell, higher than a tenth of the others, in whole centimetres."""
    own: dict[tuple[int, int], list[int]] = {}
    for cell, low in lows:
        own.setdefault(cell, []).append(math.floor((low + plane._DEEPEST_M) * 100))
    return {cell: sorted(values)[len(values) // 10] / 100 - plane._DEEPEST_M for cell, values in own.items()}


def foot_around(cell: tuple[int, int], feet: Mapping[tuple[int, int], float]) -> float:
    """Return the lowest foot in a cell, those beside it, and those in front of them; infinite without any."""
    return foot_within(cell, feet, 2)


def foot_within(cell: tuple[int, int], feet: Mapping[tuple[int, int], float], rings: int) -> float:
    """Return the lowest foot in a cell, those beside it, and those before them within some rings."""
    bearing, ring = cell
    beside = [(bearing + step) % plane._BEARINGS for step in (-1, 0, 1)]
    return min(feet.get((b, ring - step), math.inf) for b in beside for step in range(rings))


def is_part(point: XYZ, feet: Mapping[tuple[int, int], float]) -> bool:
    """Return whether a point is part of a body, such as its deck."""
    return point[2] > foot_within(cell_of(*point[:2]), feet, plane._RINGS) + plane._FLAT_M


def cells_of(points: Sequence[XYZ], used: Sequence[int], feet: Mapping[tuple[int, int], float]) -> dict[Key, Cell]:
    """Return the cells of some points. Those with several points at one height, and near, are trusted most."""
    members: dict[tuple[int, int], list[XYZ]] = {}
    for k in used:
        members.setdefault(cell_of(*points[k][:2]), []).append(points[k])
    found = {}
    for key, own in members.items():
        cell = Cell(min(own, key=lambda point: point[2]), 0.0)
        count = sum(z <= cell.lowest[2] + plane._FLAT_M for _, _, z in own)
        cell.trust = (count / len(own)) ** 2 * min(count, plane._ENOUGH) / plane._ENOUGH
        cell.trust /= 1 + cell.distance_squared / plane._SURE_M**2
        if foot_around(key, feet) < math.inf:
            cell.trust *= plane._BESIDE
            cell.top = math.inf
        found[*key, False] = cell
    for (bearing, ring), low in feet.items():
        angle = (bearing + 0.5) * 2 * math.pi / plane._BEARINGS - math.pi
        distance = plane.NEAREST_M + (ring + 0.5) * plane._STEP_M
        foot = Cell((distance * math.cos(angle), distance * math.sin(angle), low), plane._BESIDE, -math.inf)
        foot.trust /= 1 + foot.distance_squared / plane._SURE_M**2
        found[bearing, ring, True] = foot
    return found


def is_water(weight: float, trust: float) -> bool:
    """Return whether a cell of a weight in the fit is one of water."""
    return weight > plane._ABOVE / 3 * trust


def contradict(cells: "Cells", fitted: Plane, weights: Mapping["Key", float]) -> bool:
    """Return whether more cells are below a plane, without a body above that is as high, than are water."""
    below = 0
    for cell in cells.values():
        x, y, _ = cell.lowest
        rise = 0.0 if cell.top is None else fitted.height_of(x, y, cell.top)
        below += fitted.height_of(*cell.lowest) + rise < -plane._BELOW_M
    return below > sum(is_water(weight, cells[key].trust) for key, weight in weights.items())


def cell_of(x: float, y: float) -> tuple[int, int]:
    """Return bearing and ring of the polar cell of a position."""
    turn = (math.atan2(y, x) + math.pi) * (plane._BEARINGS / (2 * math.pi))
    ring = int((math.hypot(x, y) - plane.NEAREST_M) // plane._STEP_M)
    return math.floor(turn) % plane._BEARINGS, min(ring, plane._RINGS - 1)


def band(sigma: float) -> float:
    """Return the height around the water within which echoes count as water."""
    return max(tracker._MIN_BAND_M, tracker._BAND_SIGMAS * sigma)


def reweighted(cells: Cells, start: Plane, coarse: Sequence[float]) -> tuple[Plane, dict[Key, float], float]:
    """Return the result of iteratively reweighted least squares, at the likeliest scale, and its log-likelihood."""
    fitted, fits = start, []
    for scale in (*coarse, *plane._SCALES_M):
        weights = weights_of(cells, fitted, scale)
        if sum(weights.values()) < plane.LEAST_SUPPORT:
            break
        fitted = least_squares(cells, weights)
        fits.append((scale, fitted))
    if not fits:
        return fitted, weights, -math.inf
    fine = [fit for fit in fits if fit[0] in plane._SCALES_M] or fits[-1:]
    likely = [(log_likelihood(cells, fitted, scale), scale, fitted) for scale, fitted in fine]
    likelihood, scale, fitted = max(likely, key=lambda one: one[0])
    return fitted, weights_of(cells, fitted, plane._WIDER * scale), likelihood


def weights_of(cells: Cells, fitted: Plane, scale: float) -> dict[Key, float]:
    """Return Tukey's weights, of points above the plane a part."""
    weights = {}
    for key, cell in cells.items():
        residual = fitted.height_of(*cell.lowest)
        weight = max(0.0, 1 - (residual / (3 * scale)) ** 2) ** 2
        weights[key] = (weight * plane._ABOVE if residual > 0 else weight) * cell.trust
    return weights


def least_squares(cells: Cells, weights: Mapping[Key, float]) -> Plane:
    """Return the plane through the lowest points of weighted cells, with a ridge on its slopes."""
    matrix = [[0.0] * 3 for _ in range(3)]
    right = [0.0] * 3
    for key, cell in cells.items():
        if not weights[key]:
            continue
        x, y, z = cell.lowest
        row = (1.0, x, y)
        for i in range(3):
            right[i] += weights[key] * row[i] * z
            for j in range(3):
                matrix[i][j] += weights[key] * row[i] * row[j]
    for i, ridge in enumerate((0.0, plane._TILT_RIDGE, plane._TILT_RIDGE)):
        matrix[i][i] += ridge
    return Plane(*solved(matrix, right))


def log_likelihood(cells: Cells, fitted: Plane, scale: float) -> float:
    """Return the log-likelihood of a mixture of water of a deviation and others, with the share that it has."""
    water = NormalDist(0, scale)
    seen = [(cell.trust, water.pdf(fitted.height_of(*cell.lowest))) for cell in cells.values()]
    other, total, share = 1 / plane._OTHERS_M, sum(trust for trust, _ in seen), 0.5
    for _ in range(plane._PASSES):
        share = sum(trust * share * pdf / (share * pdf + (1 - share) * other) for trust, pdf in seen) / total
        share = min(max(share, 1 - plane._MOST), plane._MOST)
    return sum(trust * math.log(share * pdf + (1 - share) * other) for trust, pdf in seen)


def covariance_of(cells: Cells, fitted: Plane, weights: Mapping[Key, float]) -> list[list[float]]:
    """Return the covariance of a plane of least squares: mean square of residuals, times the inverse."""
    total, squares, matrix = 0.0, 0.0, [[0.0, 0.0, 0.0], [0.0, plane._TILT_RIDGE, 0.0], [0.0, 0.0, plane._TILT_RIDGE]]
    for key, cell in cells.items():
        total += weights[key]
        squares += weights[key] * fitted.height_of(*cell.lowest) ** 2
        row = (1.0, *cell.lowest[:2])
        for i in range(3):
            for j in range(3):
                matrix[i][j] += weights[key] * row[i] * row[j]
    columns = [solved(matrix, [float(i == j) for j in range(3)]) for i in range(3)]
    return [[squares / total * value for value in column] for column in columns]


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
    points: Sequence[XYZ], trust: Mapping[tuple[int, int], float], level: Plane, reach: float
) -> tuple[float, float]:
    """Return median and deviation of the water's height above a plane, each cell with the weight of its trust."""
    heights = [(level.height_of(*point), cell_of(*point[:2])) for point in points]
    heights = [(height, cell) for height, cell in heights if cell in trust and abs(height) <= reach]
    if not heights:
        return 0.0, 0.0
    count: dict[tuple[int, int], int] = {}
    for _, cell in heights:
        count[cell] = count.get(cell, 0) + 1
    ordered = [(height, trust[cell] / count[cell]) for height, cell in sorted(heights, key=lambda one: one[0])]
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
    column = math.floor((x + surface._REACH_M) / surface._CELL_M)
    row = math.floor((y + surface._REACH_M) / surface._CELL_M)
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
