"""Simulated tiles: the pulses of each strip, their echoes with the truth of each, and LAS or LAZ files of them."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Floats, Indices, Rng, Rows
from seaclutter_cli.simulation.airborne.coast import VEGETATION, Coast, TileWater, leaves, make_coast, water
from seaclutter_cli.simulation.airborne.scene import AirborneParams, TileObject, TileScene, WaterParams
from seaclutter_cli.simulation.airborne.shapes import KINDS, STEP_M
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.las import import_laspy, write_las
from seaclutter_cli.threads import in_order, threads

_BEAMS = 7
_BLOCK = 2**15
_RESOLUTION_M = 0.6
_WEAKEST = 0.0015
_MEAN_SQUARE_SLOPE = 0.03
_GROUND_NOISE_M = 0.02
_LEAF_REFLECTIVITY = 0.45
_DIFFUSE = 0.12
_LOW_NOISE, _HIGH_NOISE, _WATER, _OTHER = 7, 18, 9, 1

POINT = np.dtype(
    [
        *((axis, "f8") for axis in "xyz"),
        ("intensity", "u2"),
        ("return_number", "u1"),
        ("number_of_returns", "u1"),
        ("scan_angle", "f4"),
        ("gps_time", "f8"),
        ("point_source_id", "u2"),
        ("classification", "u1"),
        ("object_class", "u1"),
        ("object_id", "u2"),
    ]
)
"""One echo of a simulated tile; the last three fields are truth."""


@dataclass(frozen=True)
class Pulses:
    """Pulses of a strip, located by their intersection with mean sea level; all arrays have the shape (P,).

    Positions are from the corner of the tile; ``slope`` is the displacement of the ray along y per metre of descent:
    the tangent of its angle.
    """

    x: Floats
    y: Floats
    slope: Floats
    times_s: Floats


_RAY = np.dtype([("z", "f8"), ("reflectivity", "f8"), ("number", "u2"), ("code", "u1")])
"""End of a ray: its height and reflectivity, the number of the object (0: none), and its class."""

_ECHO = np.dtype([("pulse", "i8"), ("z", "f8"), ("power", "f8"), ("number", "u2"), ("code", "u1")])
"""A possible echo of a pulse: its mean height and power, object and class of the ray in its middle."""


def _rays(z: Floats, reflectivity: Floats, code: Bytes | int, number: int = 0) -> Rows:
    """Return the rays of P pulses, shape (P, 7), from arrays of that shape or, for equal rays, (P, 1)."""
    rays = np.empty((len(z), _BEAMS), _RAY)
    rays["z"], rays["reflectivity"], rays["number"], rays["code"] = z, reflectivity, number, code
    return rays


def strips(lidar: AirborneParams, size_m: tuple[float, ...]) -> list[float]:
    """Return the y of each strip's flight line."""
    swath = 2 * lidar.height_m * np.tan(np.radians(lidar.scan_angle_deg / 2)) * (1 - lidar.overlap)
    count = max(1, int(np.ceil(size_m[1] / swath - 1e-9)))
    return [float(size_m[1] * (k + 0.5) / count) for k in range(count)]


def fly(lidar: AirborneParams, size_m: tuple[float, ...], line_y: float, rng: Rng) -> Pulses:
    """Return the pulses of a strip that end in the tile."""
    reach = lidar.height_m * np.tan(np.radians(lidar.scan_angle_deg / 2))
    low, high = max(-reach, -line_y - 20), min(reach, size_m[1] - line_y + 20)
    spacing = 1 / np.sqrt(lidar.pulses_m2)
    lines, across = int(np.ceil(size_m[0] / spacing)), int(np.ceil((high - low) / spacing))
    angles = np.linspace(np.arctan(low / lidar.height_m), np.arctan(high / lidar.height_m), across)
    sweep = np.concatenate([angles if line % 2 else angles[::-1] for line in range(lines)])
    count = len(sweep)
    x = np.arange(count) * (size_m[0] / count) + rng.normal(0, 0.05, count)
    roll, height = rng.normal(0, 2e-4, count), lidar.height_m
    y = line_y + height * np.tan(sweep + roll)
    inside = (y >= 0) & (y < size_m[1]) & (x >= 0) & (x < size_m[0])
    times = np.arange(count, dtype=np.float64) * 1e-5
    return Pulses(x[inside], y[inside], np.tan(sweep[inside]), times[inside])


class TileRenderer:
    """Renderer of the strips of a scene, which are independent and can be rendered in any order.

    A pulse is seven rays across its beam. A ray descends until it is below the top of an object or of the water; nets,
    debris and leaves let some rays through. Rays that end within 0.6 m of each other in height form one echo. Its
    strength is the sum of theirs, reflectivity times cosine of incidence for diffuse surfaces; echoes that are too weak
    are lost. Intensities are as delivered by surveys: corrected for range and flying height, but not for incidence.
    Water is a mirror with facets (mean square slope 0.03) and a weak diffuse part: bright below the aircraft, often
    without an echo at the edge of the swath. Fixed objects do not move, ships rise with the swell, mats and rafts
    follow the surface.
    """

    def __init__(self, scene: TileScene) -> None:
        self.scene = scene
        self.objects = scene.placed_objects()
        seed = scene.tile.seed
        self._patches = [
            KINDS[item.kind].make(np.random.default_rng([seed, 2, item.number]), item.size_m, item.reflectivity)
            for item in self.objects
        ]
        self.lines = strips(scene.lidar, scene.tile.size_m)
        wave_m = float(np.hypot(scene.water.wave_m, scene.water.swell_m))
        self.coast = make_coast(scene.land, scene.tile.size_m, wave_m, seed) if scene.land else None

    def strip(self, index: int) -> Rows:
        """Return the echoes of a strip, as `POINT`."""
        scene, seed = self.scene, self.scene.tile.seed
        rng = np.random.default_rng([seed, 3, index])
        sea = water(scene.water, max(scene.tile.size_m), np.random.default_rng([seed, 4, index]), self.coast)
        pulses = fly(scene.lidar, scene.tile.size_m, self.lines[index], rng)
        hits = self._sea_hits(pulses, sea, rng)
        if self.coast is not None:
            hits = _land_hits(self.coast, pulses, hits, rng)
        for item, patch in zip(self.objects, self._patches, strict=True):
            self._hit_object(item, patch, pulses, sea, hits, rng)
        points = _echoes(pulses, hits, scene.lidar, rng)
        points["gps_time"] += 1000.0 * index
        points["point_source_id"] = index + 1
        _add_noise_points(points, scene.water, rng)
        codes = np.array([0, *(item.code for item in self.objects)], np.uint8)
        points["object_class"] = codes[points["object_id"]]
        for axis, origin in zip("xy", scene.tile.origin_m, strict=True):
            points[axis] += origin
        return points

    def _sea_hits(self, pulses: Pulses, sea: TileWater, rng: Rng) -> Rows:
        params = self.scene.water
        along, across = sea.slope(pulses.x, pulses.y)
        tilt = along**2 + (across + pulses.slope) ** 2
        mirror = np.exp(-tilt / (2 * _MEAN_SQUARE_SLOPE))
        reflectivity = params.reflectivity * (_DIFFUSE + (1 - _DIFFUSE) * mirror) * rng.gamma(2.0, 0.5, len(tilt))
        z = sea.height(pulses.x, pulses.y) + rng.normal(0, 0.02, len(tilt))
        return _rays(z[:, None], reflectivity[:, None], _WATER)

    def _hit_object(self, item: TileObject, patch: Rows, pulses: Pulses, sea: TileWater, hits: Rows, rng: Rng) -> None:
        motion, heave = KINDS[item.kind].motion, sea.heave(*item.position_m)
        highest = float(patch["top"].max()) + 1.0 + abs(heave)
        reach = 0.5 * float(np.hypot(*item.size_m[:2])) + 2.0
        along, across = np.abs(pulses.x - item.position_m[0]), np.abs(pulses.y - item.position_m[1])
        near = np.flatnonzero((along < reach) & (across < reach + highest * np.abs(pulses.slope)))
        if not len(near):
            return
        x, y = _beams(pulses.x[near], pulses.y[near], self.scene.lidar)
        slope = np.repeat(pulses.slope[near], _BEAMS)
        waterline = sea.height(x, y) if motion == "drifts" else np.full_like(x, heave if motion == "floats" else 0.0)
        z, reflectivity = _trace(item, patch, (x, y, slope), waterline, highest, rng)
        tilt = np.cos(np.arctan(slope)) ** (0.5 if motion == "fixed" else 1)
        shape = len(near), _BEAMS
        found = _rays(z.reshape(shape), (reflectivity * tilt).reshape(shape), _OTHER, item.number)
        hits[near] = np.where(found["z"] > hits[near]["z"], found, hits[near])


def _land_hits(coast: Coast, pulses: Pulses, water: Rows, rng: Rng) -> Rows:
    """Return the rays of pulses on water, ground, buildings and trees from those on water."""
    z, cells = coast.descend(pulses.x, pulses.y, pulses.slope)
    z += rng.normal(0, _GROUND_NOISE_M, len(z))
    reflectivity = coast.reflectivity[cells] * np.cos(np.arctan(pulses.slope)) ** 0.5
    dry = (coast.ground[cells] >= coast.level[cells]) & (z > water["z"][:, 0])
    land = _rays(z[:, None], reflectivity[:, None], coast.code[cells][:, None])
    rays = np.where(dry[:, None], land, water)
    trees = np.flatnonzero(dry & (coast.canopy[cells] > 0))
    if len(trees):
        own, canopy = rays[trees], coast.canopy[cells][trees].astype(np.float64)
        own["z"], stopped = leaves(canopy, z[trees], _BEAMS, rng)
        own["code"][stopped], own["reflectivity"][stopped] = VEGETATION, _LEAF_REFLECTIVITY
        rays[trees] = own
    return rays


def _beams(x: Floats, y: Floats, lidar: AirborneParams) -> tuple[Floats, Floats]:
    """Return the rays of pulses: one in the middle of the beam and six around it, shape (P * 7,)."""
    radius = 0.35 * lidar.divergence_mrad / 1000 * lidar.height_m
    around = np.arange(_BEAMS - 1) * (2 * np.pi / (_BEAMS - 1))
    dx, dy = np.append(0.0, radius * np.cos(around)), np.append(0.0, radius * np.sin(around))
    return (x[:, None] + dx).reshape(-1), (y[:, None] + dy).reshape(-1)


def _trace(
    item: TileObject, patch: Rows, rays: tuple[Floats, Floats, Floats], waterline: Floats, highest: float, rng: Rng
) -> tuple[Floats, Floats]:
    """Return the height at which each of R rays ends on an object, or minus infinity, and the reflectivity there."""
    x, y, slope = rays
    z, reflectivity = np.full(len(x), -np.inf), np.zeros(len(x))
    draw, depth = rng.random(len(x)), rng.random(len(x))
    steps = max(1, int(np.ceil(highest * float(np.abs(slope).max()) / STEP_M)))
    remaining = np.arange(len(x))
    for step in range(steps):
        upper, lower = highest * (1 - step / steps), highest * (1 - (step + 1) / steps) - (step + 1 == steps)
        above, cells = _cells_below(item, patch, x[remaining], y[remaining] - slope[remaining] * 0.5 * (upper + lower))
        top = cells["top"] + waterline[remaining[above]]
        stopped = (top >= lower) & (draw[remaining[above]] < cells["cover"])
        ended, cells = remaining[above[stopped]], cells[stopped]
        z[ended] = np.minimum(top[stopped], upper) - depth[ended] * cells["depth"]
        reflectivity[ended] = cells["reflectivity"]
        remaining = np.delete(remaining, above[stopped])
    above, cells = _cells_below(item, patch, x[remaining], y[remaining])
    z[remaining[above]], reflectivity[remaining[above]] = cells["base"], 0.6 * cells["reflectivity"]
    return z, reflectivity


def _cells_below(item: TileObject, patch: Rows, x: Floats, y: Floats) -> tuple[Indices, Rows]:
    """Return which positions are on the map of an object, and its cells there."""
    c, s = np.cos(item.heading), np.sin(item.heading)
    dx, dy = x - item.position_m[0], y - item.position_m[1]
    along, across = (
        np.floor(side / STEP_M + count / 2).astype(np.intp)
        for side, count in zip((c * dx + s * dy, c * dy - s * dx), patch.shape, strict=True)
    )
    inside = (along >= 0) & (along < patch.shape[0]) & (across >= 0) & (across < patch.shape[1])
    return np.flatnonzero(inside), patch[along[inside], across[inside]]


def _echoes(pulses: Pulses, hits: Rows, lidar: AirborneParams, rng: Rng) -> Rows:
    starts = range(0, len(hits), _BLOCK)
    blocks = [_groups(hits, np.arange(start, min(start + _BLOCK, len(hits))), lidar) for start in starts]
    found: list[Rows] = []
    for echo in range(lidar.max_returns):
        possible: Rows = np.concatenate([block[echo] for block in blocks])
        weakest = _WEAKEST * rng.exponential(3.0, len(hits))
        found.append(possible[possible["power"] > weakest[possible["pulse"]]])
    echoes = np.concatenate(found)
    return _points(pulses, echoes[np.argsort(echoes["pulse"], kind="stable")], lidar, rng)


def _groups(hits: Rows, block: Indices, lidar: AirborneParams) -> list[Rows]:
    """Return the possible echoes of a block of pulses, `_ECHO` for each number, from the highest down."""
    rays = hits[block]
    order = np.argsort(-rays["z"], axis=1, kind="stable")
    z, reflectivity, number, code = (np.take_along_axis(rays[name], order, 1) for name in _RAY.names or ())
    group = np.cumsum(-np.diff(z, axis=1, prepend=z[:, :1]) > _RESOLUTION_M, axis=1)
    found = []
    for echo in range(lidar.max_returns):
        rows = np.flatnonzero((group == echo).any(axis=1))
        in_echo = group[rows] == echo
        count = in_echo.sum(axis=1)
        middle = np.argmax(in_echo, axis=1) + (count - 1) // 2
        echoes = np.empty(len(rows), _ECHO)
        echoes["pulse"], echoes["number"], echoes["code"] = block[rows], number[rows, middle], code[rows, middle]
        echoes["z"] = (z[rows] * in_echo).sum(axis=1) / count
        echoes["power"] = (reflectivity[rows] * in_echo).sum(axis=1) / _BEAMS
        found.append(echoes)
    return found


def _points(pulses: Pulses, echoes: Rows, lidar: AirborneParams, rng: Rng) -> Rows:
    pulse = echoes["pulse"]
    out = np.zeros(len(pulse), POINT)
    z = echoes["z"] + rng.normal(0, lidar.range_noise_m, len(pulse))
    out["x"], out["y"], out["z"] = pulses.x[pulse], pulses.y[pulse] - pulses.slope[pulse] * z, z
    digital = lidar.gain * echoes["power"] * rng.lognormal(0, 0.08, len(pulse))
    out["intensity"] = np.clip(np.round(digital), 1, 65535)
    echoes_of = np.bincount(pulse, minlength=len(pulses.x))
    before = np.cumsum(echoes_of) - echoes_of
    out["return_number"] = np.arange(len(pulse)) - before[pulse] + 1
    out["number_of_returns"] = echoes_of[pulse]
    out["scan_angle"] = np.degrees(np.arctan(pulses.slope[pulse]))
    out["gps_time"] = pulses.times_s[pulse]
    out["object_id"], out["classification"] = echoes["number"], echoes["code"]
    return out


def _add_noise_points(points: Rows, params: WaterParams, rng: Rng) -> None:
    chosen = np.flatnonzero(rng.random(len(points)) < params.stray_echo_share)
    low = rng.random(len(chosen)) < 0.5
    points["z"][chosen] = np.where(low, -rng.uniform(2, 15, len(chosen)), rng.uniform(8, 80, len(chosen)))
    points["object_id"][chosen] = 0
    points["classification"][chosen] = np.where(low, _LOW_NOISE, _HIGH_NOISE)


TRUTH = {"object_class": ("u1", "0 none, 1 ship ... 8 garbage"), "object_id": ("u2", "number of the object, 0 none")}
_MOST_PULSES = 300_000
_SCALE_M = 0.001
_ANGLE_UNIT_DEG = 0.006
_CREATION_DATE = date(2024, 1, 1)


def simulate_strips(scene: TileScene) -> Iterator[Rows]:
    """Yield the echoes of a scene strip by strip, rendered in threads; the number of threads does not change them."""
    renderer = TileRenderer(scene)
    pulses = math.prod(scene.tile.size_m) * scene.lidar.pulses_m2 / len(renderer.lines)
    workers = min(2, threads()) if pulses < _MOST_PULSES else 1  # a strip of a million takes 400 MB
    return in_order(renderer.strip, len(renderer.lines), workers=workers, ahead=workers)


def record_tile(
    scene: TileScene, path: Path, on_strip: Callable[[Rows], object] = lambda _: None, group: OutputGroup | None = None
) -> None:
    """Write a scene to a LAS or LAZ file with point format 6.

    It appears, together with the files of the group, when it is complete. Raise `MissingExtraError` if laspy or its LAZ
    backend is not installed, `OutputError` if the file cannot be written.
    """
    laspy = import_laspy()
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, _SCALE_M)
    header.offsets = np.array([*scene.tile.origin_m, 0.0])
    header.system_identifier, header.generating_software = "simulated", "seaclutter simulate"
    header.creation_date = _CREATION_DATE
    header.uuid = UUID(int=0)
    header.global_encoding.wkt = True  # LAS 1.4 requires it from point format 6; some readers check

    def parts() -> Iterator[tuple[Any, dict[str, NDArray[Any]]]]:
        for points in simulate_strips(scene):
            record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
            for name in (name for name in POINT.names or () if name not in TRUTH):
                record[name] = points[name] / _ANGLE_UNIT_DEG if name == "scan_angle" else points[name]
            yield record, {name: points[name] for name in TRUTH}
            on_strip(points)

    write_las(path, header, parts(), TRUTH, group=group)
