"""The water of a tile, wind sea and swell; maps of its land, its water levels and sheltered waves."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import fft, ndimage

from seaclutter_cli.arrays import Floats, Indices, Mask, Rng
from seaclutter_cli.simulation.airborne.scene import LANDS, LandParams, Map, WaterParams
from seaclutter_cli.simulation.marine.sea import directional_variance

GROUND, VEGETATION, BUILDING = LAND_CODES = 2, 5, 6
"""ASPRS classes of land."""
_STEP_M, _MOST_CELLS = 0.5, 5_000_000
_BREAKING = 0.6
_SHELTERED = 0.15
_PLOT_M, _HOUSE_M = 30.0, ((6.0, 14.0), (7.0, 10.0), (4.0, 9.0))
_TREE_M = 5.0, 14.0
_LEAVES = 0.65
_CLEAR_M = 0.3
_TINT = ((0.12, 0.6), (0.12, 6.0), (0.2, 60.0))
"""Standard deviation of the logarithm of the reflectivity, and width in metres, of variations of the ground."""
_BOTTOM_M, _WET_SAND, _WET_M = -1000.0, 0.3, 0.5
_WIND_SEA, _SWELL = (3.3, 4), (6.0, 40)
"""Peak enhancement, and exponent of the directional spread."""


@dataclass(frozen=True)
class TileWater:
    """The surface at one moment, and that of the swell alone, which moves ships: elevations by x and y, shape (M, M).

    Cells are a metre wide. Along a coast, the water is at the levels of the coast, and waves are lower where it is
    shallow, and in basins.
    """

    heights: Floats
    swell: Floats
    coast: "Coast | None" = None

    def height(self, x: Floats, y: Floats) -> Floats:
        """Return elevations at given positions by linear interpolation, shape (N,)."""
        return self._on_coast(x, y, ndimage.map_coordinates(self.heights, (x, y), order=1, mode="grid-wrap"))

    def heave(self, x: float, y: float) -> float:
        """Return the elevation of the swell at a position."""
        at = np.array([x]), np.array([y])
        swell = float(ndimage.map_coordinates(self.swell, at, order=1, mode="grid-wrap")[0])
        return float(self._on_coast(*at, swell).item())

    def _on_coast(self, x: Floats, y: Floats, waves: Floats | float) -> Floats:
        if self.coast is None:
            return np.asarray(waves)
        cell = self.coast.cells(x, y)
        return np.asarray(self.coast.level[cell] + self.coast.damping[cell] * waves)

    def slope(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return slopes along x and y at given positions, as differences over a metre to both sides."""
        along = self.height(x + 1, y) - self.height(x - 1, y)
        return along / 2, (self.height(x, y + 1) - self.height(x, y - 1)) / 2


def water(params: WaterParams, size_m: float, rng: Rng, coast: "Coast | None" = None) -> TileWater:
    """Return a random surface, at least ``size_m`` wide, along a coast if there is one.

    Wind sea and swell each have a JONSWAP spectrum with their own height and peak period, and a directional spread;
    their sum is the inverse Fourier transform of random amplitudes. Waves shorter than 2 m are left out.
    """
    cells = int(fft.next_fast_len(int(size_m) + 64))
    wind = _field(cells, (params.wave_m, params.wave_period_s, *_WIND_SEA), params.direction_deg, rng)
    swell = _field(cells, (params.swell_m, params.swell_period_s, *_SWELL), params.direction_deg, rng)
    return TileWater(wind + swell, swell, coast)


def _field(cells: int, waves: tuple[float, float, float, int], direction_deg: float, rng: Rng) -> Floats:
    height_m, period_s, enhancement, spreading = waves
    wave = 2 * np.pi * fft.fftfreq(cells)
    noise = rng.standard_normal((2, cells, cells))
    if not height_m:
        return np.zeros((cells, cells))
    spectrum = height_m, 2 * np.pi / period_s, enhancement
    variance = directional_variance((wave[:, None], wave[None, :]), spectrum, direction_deg, spreading)
    heights = fft.ifft2(np.sqrt(variance) * (noise[0] + 1j * noise[1]), workers=1).real
    # The grid truncates the spectrum, so the remainder is scaled to the wave height.
    return np.asarray(heights * (height_m / 4) / max(float(heights.std()), 1e-12))


class Coast:
    """Ground and water levels of a tile, in cells of ``step_m``, by x and y; all maps have the shape (X, Y).

    ``ground`` is the elevation of the ground, or of the roof of a building, ``level`` the mean level of the water,
    ``damping`` the height of the waves in shallow or sheltered water, divided by that in open water, ``canopy`` the
    height of trees above the ground, 0 for none, and ``code`` the class of the ground, `GROUND` or `BUILDING`. They
    grow with each piece of land, until they are finished.
    """

    def __init__(self, step_m: float, shape: tuple[int, ...]) -> None:
        self.step_m, self._shape = step_m, shape
        self._x, self._y = ((np.arange(count, dtype=np.float64) + 0.5) * step_m for count in shape)
        self.ground: Map = np.full(shape, _BOTTOM_M)
        self.level: Map = np.zeros(shape)
        self.damping: Map = np.ones(shape)
        self.reflectivity: Map = np.full(shape, _WET_SAND)
        self.canopy: Map = np.zeros(shape)
        self.code = np.full(shape, GROUND, np.uint8)

    def add(self, land: LandParams, rng: Rng) -> None:
        """Cover the maps with a piece of land; outside, its slope is the bottom of the water if nothing is higher."""
        values = land.relief
        distance = land.distance(self._x[:, None], self._y[None, :]) + values.ragged_m * self._noise(rng, 25.0)
        own, level = LANDS[land.kind].profile(distance, values)
        own = own + values.relief_m * (0.9 * self._noise(rng, 12.0) + 0.4 * self._noise(rng, 2.5))
        inside = distance > 0
        reach = inside | (own > self.ground)
        self.ground[reach], self.reflectivity[reach] = own[reach], values.reflectivity
        self.damping[inside] = 1.0
        if level is not None:
            self.level[inside], self.damping[inside] = level, _SHELTERED
        dry = inside & (own > self.level + _CLEAR_M)
        trees, roofs = self._trees(rng, values.trees, dry), self._roofs(rng, values.houses, dry)
        self.ground += roofs
        self.code[inside] = np.where(roofs > 0, BUILDING, GROUND)[inside]
        self.canopy[inside] = np.where(roofs > 0, 0, trees)[inside]

    def finish(self, wave_m: float, rng: Rng) -> None:
        """Give the maps the reflectivity of different and of wet ground, and waves that break; make them float32."""
        tint = np.ones(self._shape)
        for deviation, scale_m in _TINT:
            tint *= np.exp(deviation * self._noise(rng, scale_m))
        above = self.ground - self.level
        self.reflectivity = (self.reflectivity * tint * np.clip(above / _WET_M, 0.5, 1)).clip(0.02, 0.9)
        self.damping = self.damping * np.clip(-_BREAKING * above / max(wave_m, 1e-6), 0, 1)
        for name in ("ground", "level", "damping", "canopy", "reflectivity"):
            setattr(self, name, getattr(self, name).astype(np.float32))

    def _noise(self, rng: Rng, scale_m: float) -> Map:
        """Return smooth noise of mean 0 and standard deviation 1; if it is wide, from a coarse grid."""
        cells = scale_m / self.step_m
        coarse = max(1, int(cells / 4))
        raw = rng.standard_normal([count // coarse + 8 for count in self._shape])
        smooth = ndimage.gaussian_filter(raw, cells / coarse, mode="wrap")
        smooth = (smooth - smooth.mean()) / max(float(smooth.std()), 1e-9)
        at = [np.arange(count) / coarse for count in self._shape]
        return np.asarray(ndimage.map_coordinates(smooth, np.meshgrid(*at, indexing="ij"), order=1))

    def _roofs(self, rng: Rng, share: float, dry: Mask) -> Map:
        """Return the height of buildings above the ground; at most one in the middle of each plot."""
        plots = [np.floor(at / _PLOT_M).astype(np.intp) for at in (self._x, self._y)]
        count = plots[0][-1] + 1, plots[1][-1] + 1
        built = rng.random(count) < share
        length, width, height = (rng.uniform(*sides, count) for sides in _HOUSE_M)
        plot = np.ix_(*plots)
        along, across = (np.abs(at % _PLOT_M - _PLOT_M / 2) for at in (self._x, self._y))
        house = (along[:, None] < length[plot] / 2) & (across[None, :] < width[plot] / 2)
        return np.where(house & built[plot] & dry, height[plot], 0)

    def _trees(self, rng: Rng, share: float, dry: Mask) -> Map:
        where, crowns = self._noise(rng, 7.0), np.clip(0.8 + 0.25 * self._noise(rng, 1.2), 0.3, 1.2)
        height = rng.uniform(*_TREE_M)
        return np.where(dry & (where > np.quantile(where, 1 - share)), height * crowns, 0)

    def cells(self, x: Floats, y: Floats) -> tuple[Indices, ...]:
        """Return the cells of positions; those beyond the tile have the nearest one."""
        sides = zip((x, y), self.ground.shape, strict=True)
        return tuple(np.clip(at / self.step_m, 0, count - 1).astype(np.intp) for at, count in sides)

    def descend(self, x: Floats, y: Floats, slope: Floats) -> tuple[Floats, tuple[Indices, ...]]:
        """Return the elevation at which rays end on ground or still water, shape (P,), and their cells.

        Rays are located by their intersection with mean sea level; ``slope`` is their displacement along y per metre
        of descent.
        """
        solid = np.maximum(self.ground, self.level)
        top, bottom = float(solid.max()) + 0.01, float(solid.min())
        steps = max(1, int(np.ceil((top - bottom) * float(np.abs(slope).max(initial=0)) / self.step_m)))
        edges = np.linspace(top, bottom, steps + 1)
        z, remaining = np.full(len(x), bottom), np.arange(len(x))
        cells = self.cells(x, y - slope * bottom)
        for upper, lower in pairwise(edges.tolist()):
            middle = y[remaining] - slope[remaining] * 0.5 * (upper + lower)
            below = self.cells(x[remaining], middle)
            height = solid[below]
            stopped = height >= lower
            ended = remaining[stopped]
            z[ended] = np.minimum(height[stopped], upper)
            for own, at in zip(cells, below, strict=True):
                own[ended] = at[stopped]
            remaining = remaining[~stopped]
        return z, cells


def make_coast(lands: Sequence[LandParams], size_m: tuple[float, ...], wave_m: float, seed: int) -> Coast:
    """Return the coast of a tile; each piece of land covers those before it.

    ``wave_m`` is the significant wave height in open water; waves are lower where the water is less than 1.7 times as
    deep.
    """
    step = max(_STEP_M, float(np.sqrt(np.prod(size_m) / _MOST_CELLS)))
    coast = Coast(step, tuple(int(np.ceil(side / step)) for side in size_m))
    for index, params in enumerate(lands):
        coast.add(params, np.random.default_rng([seed, 5, index]))
    coast.finish(wave_m, np.random.default_rng([seed, 6]))
    return coast


def leaves(canopy: Floats, ground: Floats, rays: int, rng: Rng) -> tuple[Floats, Mask]:
    """Return the elevation at which each ray of pulses into trees ends, shape (P, rays), and whether in leaves."""
    stopped = rng.random((len(canopy), rays)) < _LEAVES
    depth = 0.6 * rng.beta(1.0, 3.0, stopped.shape)
    return np.where(stopped, ground[:, None] + canopy[:, None] * (1 - depth), ground[:, None]), stopped
