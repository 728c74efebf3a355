"""Random objects of airborne tiles as small height maps."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import ndimage

from seaclutter_cli.arrays import Floats, Indices, Mask, Rng, Rows

Map = Floats
Size = tuple[float, float, float]
Motion = Literal["fixed", "floats", "drifts"]

STEP_M = 0.25
"""Width of the cells of a map in metres."""


PATCH = np.dtype([(name, np.float64) for name in ("top", "cover", "depth", "base", "reflectivity")])
"""A cell of the map of one object in its own axes, length along the first, in cells of `STEP_M`: a patch.

``top`` is the height above the waterline, minus infinity without an object; ``cover`` the share of the rays that the
object stops, less than 1 for nets, debris and leaves, within ``depth`` below the top; ``base`` the height of the ground
below, minus infinity over water.
"""


def _noise(rng: Rng, shape: tuple[int, ...], scale_m: float) -> Map:
    """Return smooth noise of mean 0 and standard deviation 1."""
    raw = ndimage.gaussian_filter(rng.standard_normal(shape), scale_m / STEP_M, mode="reflect")
    return np.asarray((raw - raw.mean()) / max(float(raw.std()), 1e-9))


def _blob(rng: Rng, x: Map, y: Map, ragged: float) -> Map:
    """Return 1 in the middle of an irregular shape that fills its rectangle, 0 at its edge, less outside."""
    bearing = np.arctan2(y / (y.max() + STEP_M), x / (x.max() + STEP_M))
    lobes = np.arange(2, 7)
    swing = rng.normal(0, ragged, (5, 2)) / lobes[:, None]
    waves = sum(a * np.cos(n * bearing) + b * np.sin(n * bearing) for n, (a, b) in zip(lobes, swing, strict=True))
    edge = np.clip(0.88 + np.asarray(waves), 0.4, 1.0)
    return np.asarray(1 - np.hypot(x / (x.max() + STEP_M), y / (y.max() + STEP_M)) / edge)


def _blocks(shape: tuple[int, ...], sides: tuple[int, int]) -> tuple[tuple[Indices, ...], list[int]]:
    """Return the block, of some cells along each axis, that each cell of a map is in, and the numbers of blocks."""
    block = np.ix_(*(np.arange(cells) // side for cells, side in zip(shape, sides, strict=True)))
    return block, [int(at.max()) + 1 for at in block]


def _patch(
    top: Map, reflectivity: Map, *, cover: Map | float = 1.0, depth: Map | float = 0.0, base: Map | float = -np.inf
) -> Rows:
    """Return a patch, by default a solid one over water."""
    patch = np.empty(top.shape, PATCH)
    for name, values in zip(PATCH.names or (), (top, cover, depth, base, reflectivity), strict=True):
        patch[name] = values
    return patch


def _ship(rng: Rng, x: Map, y: Map, size: Size, reflectivity: float) -> Rows:
    """Return a ship with bulwark, house, containers, masts: a freighter, a tanker or a fishing boat."""
    length, width, height = size
    along = x / (length / 2)
    half = width / 2 * np.clip(1.15 - np.abs(np.clip(along, 0, 1)) ** rng.uniform(1.8, 4), 0, 1) * (along > -0.97)
    inside = np.abs(y) <= np.minimum(half, width / 2)
    deck = height * rng.uniform(0.18, 0.35)
    top = np.where(inside, deck * (1 + 0.25 * np.clip(along, 0, 1) ** 2), -np.inf)
    rail = inside & ~ndimage.binary_erosion(inside, iterations=2)
    top[rail] += min(1.1, 0.12 * height)
    bright = _noise(rng, top.shape, 1.5) > rng.uniform(-0.8, 0.8)
    paint = np.where(bright, reflectivity, reflectivity * rng.uniform(0.35, 0.9))
    kind = rng.choice(["freighter", "tanker", "fishing"]) if length > 35 else "fishing"
    if kind == "freighter":
        _stack(rng, top, inside & (np.abs(along) < 0.62), deck, (height - deck) * 0.75)
    elif kind == "tanker":
        pipes = inside & (np.abs(y) < 0.09 * width) & (np.abs(along) < 0.7)
        top[pipes] += rng.uniform(0.8, 1.8)
    house = rng.choice([-0.72, -0.68, 0.3]) if kind != "fishing" else rng.uniform(-0.4, 0.45)
    ends = np.abs(along - house) < rng.uniform(0.1, 0.2)
    top[inside & ends & (np.abs(y) < 0.4 * width)] = height * rng.uniform(0.7, 0.85)
    for position in rng.uniform(-0.5, 0.8, rng.integers(1, 4)):
        top[inside & (np.abs(x - position * length / 2) <= STEP_M) & (np.abs(y) <= STEP_M)] = height
    return _patch(top, paint)


def _stack(rng: Rng, top: Map, where: Mask, deck: float, height: float) -> None:
    """Stack containers of 6 by 2.5 m to random heights."""
    block, count = _blocks(top.shape, (26, 10))
    piles = rng.integers(0, max(2, int(height / 2.6)) + 1, count)
    top[where] = (deck + 2.6 * piles[block])[where]


def _reef(rng: Rng, x: Map, y: Map, size: Size, reflectivity: float) -> Rows:
    """Return bare rocks, rough at all scales, with channels between them."""
    body = _blob(rng, x, y, 0.35)
    rough = sum(weight * _noise(rng, body.shape, scale) for weight, scale in ((0.30, 3.0), (0.18, 1.2), (0.12, 0.5)))
    top = size[2] * (1.1 * np.sqrt(np.clip(body, 0, 1)) * (0.62 + rough) - 0.08)
    top[(body <= 0) | (top < -0.3)] = -np.inf
    return _patch(top, reflectivity * (1 + 0.25 * _noise(rng, body.shape, 0.8)).clip(0.3, 2))


def _shoal(rng: Rng, x: Map, y: Map, size: Size, reflectivity: float) -> Rows:
    """Return a sandbank that dries at low water: smooth, with ripples, darker where it is wet."""
    body = _blob(rng, x, y, 0.25)
    ripples = 0.03 * np.sin(2 * np.pi * (x * rng.uniform(0.2, 0.5) + y * rng.uniform(-0.3, 0.3)))
    top = size[2] * np.clip(body, 0, 1) ** 0.33 * (1 + 0.10 * _noise(rng, body.shape, 6.0)) + ripples
    top[body <= 0] = -np.inf
    return _patch(top, reflectivity * np.clip(0.45 + 0.55 * top / size[2], 0.4, 1.1))


def _aquaculture(rng: Rng, x: Map, y: Map, size: Size, reflectivity: float) -> Rows:
    """Return rows of round cages with rails and nets over them, or rafts of beams with a hut."""
    shape = (x.size, y.size)
    top, cover = np.full(shape, -np.inf), np.ones(shape)
    if rng.random() < 0.55:
        _cages(rng, x, y, top, cover, size)
    else:
        _rafts(rng, x, y, top, size)
    tint = reflectivity * (1 + 0.2 * _noise(rng, shape, 1.0)).clip(0.3, 2)
    return _patch(top, tint, cover=cover)


def _cages(rng: Rng, x: Map, y: Map, top: Map, cover: Map, size: Size) -> None:
    across = rng.uniform(8, 15)
    pitch = across + rng.uniform(2, 5)
    rows = [max(1, int((side + pitch - across) / pitch)) for side in size[:2]]
    for i, j in np.ndindex(*rows):
        apart = np.hypot(x - (i - (rows[0] - 1) / 2) * pitch, y - (j - (rows[1] - 1) / 2) * pitch) - across / 2
        net, rail, tube = apart < -0.4, np.abs(apart) <= 0.3, np.abs(apart + 0.5) <= 0.5
        top[net], cover[net] = size[2] * (0.75 + 0.25 * np.clip(-apart[net] / across, 0, 1)), 0.12
        top[tube], cover[tube] = rng.uniform(0.35, 0.7), 0.95
        top[rail], cover[rail] = size[2] * rng.uniform(0.55, 0.8), 0.6


def _rafts(rng: Rng, x: Map, y: Map, top: Map, size: Size) -> None:
    pitch, beam, deck = rng.uniform(2.5, 4.5), rng.uniform(0.5, 0.8), rng.uniform(0.6, 0.95)
    beams = (np.mod(x, pitch) < beam) | (np.mod(y, pitch) < beam)
    top[beams] = deck
    for _ in range(rng.integers(1, 4)):
        hut_x, hut_y = (rng.uniform(-0.4, 0.4) * side for side in size[:2])
        hut = (np.abs(x - hut_x) < rng.uniform(1.2, 2.5)) & (np.abs(y - hut_y) < rng.uniform(1.2, 2))
        top[hut] = size[2]


def _seaweed(rng: Rng, x: Map, y: Map, size: Size, reflectivity: float) -> Rows:
    """Return a dense floating mat with soft humps; leaves are bright in the near infrared."""
    body = _blob(rng, x, y, 0.5)
    humps = 0.8 + 0.16 * _noise(rng, body.shape, 2.5) + 0.08 * _noise(rng, body.shape, 0.6)
    top = size[2] * np.clip(body, 0, 1) ** 0.3 * humps.clip(0.2, 1.2)
    holes = _noise(rng, body.shape, 2.0) > rng.uniform(1.1, 2.0)
    top[(body <= 0) | holes] = -np.inf
    cover = rng.uniform(0.8, 0.97)
    tint = reflectivity * (1 + 0.15 * _noise(rng, body.shape, 1.5)).clip(0.4, 1.6)
    return _patch(top, tint, cover=cover, depth=0.12)


def _island(rng: Rng, x: Map, y: Map, size: Size, reflectivity: float) -> Rows:
    """Return ground with hills and a shore of rock or sand, partly covered by trees and bushes."""
    body = _blob(rng, x, y, 0.25)
    hills = 1 + 0.25 * _noise(rng, body.shape, 12.0) + 0.05 * _noise(rng, body.shape, 2.0)
    ground = 0.65 * size[2] * np.clip(body, 0, 1) ** rng.uniform(0.4, 0.8) * hills.clip(0.3, 2)
    ground[body <= 0] = -np.inf
    tall = rng.uniform(0.2, 0.35) * size[2]
    crowns = np.clip(0.7 + 0.35 * _noise(rng, body.shape, 1.2), 0.15, 1.3)
    green = (_noise(rng, body.shape, 7.0) > rng.uniform(-1.2, 0.5)) & (body > 0.08)
    top = np.where(green, ground + tall * crowns, ground)
    leaves = np.where(green, rng.uniform(0.5, 0.75), 1.0)
    tint = np.where(green, rng.uniform(0.35, 0.55), reflectivity)
    tint *= (1 + 0.15 * _noise(rng, body.shape, 1.0)).clip(0.4, 1.6)
    return _patch(top, tint, cover=leaves, depth=np.where(green, 0.5 * tall, 0.0), base=ground)


def _fence(rng: Rng, x: Map, y: Map, size: Size, reflectivity: float) -> Rows:
    """Return rows of stakes with nets between them: a leader, wings and a pen, or several rows side by side."""
    shape, (length, width, height) = (x.size, y.size), size
    top, cover = np.full(shape, -np.inf), np.ones(shape)
    spacing, sag = rng.uniform(2, 5), rng.uniform(0.55, 0.85)
    mesh = rng.uniform(0.35, 0.6)
    if rng.random() < 0.5:
        pen, end, side = 0.3 * length, 0.48 * length, 0.4 * width
        ends = [(-length / 2, 0.0, pen, 0.0), (pen, 0.0, end, side), (pen, 0.0, end, -side), (end, side, end, -side)]
    else:
        rows = max(1, round(width / rng.uniform(7, 14)))
        ends = [(-0.48 * length, y0, 0.48 * length, y0) for y0 in np.linspace(-0.45, 0.45, rows) * width * (rows > 1)]
    for x0, y0, x1, y1 in ends:
        run = float(np.hypot(x1 - x0, y1 - y0))
        for net, step in ((True, STEP_M / 2), (False, spacing)):
            along = np.arange(0, run, step) / run
            i = np.clip(np.round((x0 + along * (x1 - x0)) / STEP_M + (shape[0] - 1) / 2), 0, shape[0] - 1).astype(int)
            j = np.clip(np.round((y0 + along * (y1 - y0)) / STEP_M + (shape[1] - 1) / 2), 0, shape[1] - 1).astype(int)
            top[i, j] = height * sag if net else height * rng.uniform(0.8, 1.0, len(i))
            cover[i, j] = mesh if net else 0.9
    depth = np.where(cover < 0.9, 0.6 * height * sag, 0.2)
    tint = reflectivity * rng.uniform(0.7, 1.3, shape)
    return _patch(top, tint, cover=cover, depth=depth)


def _garbage(rng: Rng, x: Map, y: Map, size: Size, reflectivity: float) -> Rows:
    """Return loose debris of all sizes and reflectivities, close together in a drifting patch."""
    body = _blob(rng, x, y, 0.5)
    top, tint = np.full(body.shape, -np.inf), np.full(body.shape, reflectivity)
    for side, share in ((2, 0.35), (3, 0.30), (5, 0.15), (8, 0.05)):
        block, count = _blocks(body.shape, (side, side))
        present, height = rng.random(count) < share, size[2] * rng.beta(1.6, 2.2, count)
        brightness = np.clip(reflectivity * rng.lognormal(0, 0.7, count), 0.03, 0.9)
        here = present[block] & (body > 0)
        top[here], tint[here] = height[block][here], brightness[block][here]
    return _patch(top, tint)


@dataclass(frozen=True)
class Kind:
    """A class of objects: how to draw one of a size and reflectivity on axes, and the ranges of random ones.

    It is fixed to the ground, floats as one body, or drifts, following the surface everywhere.
    """

    draw: Callable[[Rng, Map, Map, Size, float], Rows]
    smallest: Size
    largest: Size
    reflectivities: tuple[float, float]
    motion: Motion

    def make(self, rng: Rng, size: Size, reflectivity: float) -> Rows:
        """Return a random object."""
        sides = (max(1, round(side / STEP_M)) for side in size[:2])
        x, y = (np.asarray((np.arange(cells) - (cells - 1) / 2) * STEP_M, np.float64) for cells in sides)
        return self.draw(rng, x[:, None], y[None, :], size, reflectivity)


KINDS: Mapping[str, Kind] = {
    "ship": Kind(_ship, (12, 3.5, 4), (110, 19, 22), (0.12, 0.6), "floats"),
    "reef": Kind(_reef, (7, 6, 1.2), (26, 18, 4.5), (0.08, 0.3), "fixed"),
    "shoal": Kind(_shoal, (22, 9, 0.9), (75, 18, 1.9), (0.22, 0.5), "fixed"),
    "aquaculture": Kind(_aquaculture, (28, 22, 1.4), (80, 55, 3.2), (0.12, 0.5), "drifts"),
    "seaweed": Kind(_seaweed, (10, 7, 0.9), (40, 16, 1.6), (0.3, 0.6), "drifts"),
    "island": Kind(_island, (35, 28, 5), (130, 90, 28), (0.15, 0.4), "fixed"),
    "fishing fence": Kind(_fence, (60, 14, 1.6), (200, 45, 4), (0.12, 0.4), "fixed"),
    "garbage patch": Kind(_garbage, (9, 7, 1.0), (32, 16, 1.9), (0.1, 0.45), "drifts"),
}
"""Classes of objects by their names in truth; to add one, add a line here and one in `OBJECT_CLASSES`."""
