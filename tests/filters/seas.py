"""Small seas with objects that move, appear, hide and leave, frame by frame, for the tests of ``confirmed``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seaclutter_cli.cloud import from_array
from seaclutter_cli.frame import FilterResult, Frame

MAST_M = 2.5
BEAM_DEG, ROWS = 0.5, 4
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])


@dataclass(frozen=True)
class Body:
    """A box on the water that moves at constant velocity.

    Parameters
    ----------
    x, y : float
        Position of its centre at time 0 in metres.
    vx, vy : float
        Velocity in m/s.
    length, width, height : float
        Size in metres; its points lie on the sides that the lidar sees, above each other in a few directions.
    points : int
        Number of points in each frame where four beams meet it; one in each direction where none does.
    intensity : float
        Mean intensity.
    seen : tuple of float
        Times in seconds at which it comes and goes, in turn; it is seen from the first to the second, and so on.
    faint : tuple of float
        Times in seconds at which it begins and ceases to be low and to have few points, in turn.
    solid : bool
        Whether it has sides; else its points fill its volume, as those of spray.
    """

    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0
    length: float = 3.0
    width: float = 1.5
    height: float = 1.5
    points: int = 15
    intensity: float = 60.0
    seen: Sequence[float] = (-math.inf,)
    faint: Sequence[float] = ()
    solid: bool = True

    def center(self, time_s: float) -> tuple[float, float]:
        """Return its position at a time."""
        return self.x + self.vx * time_s, self.y + self.vy * time_s


def within(times_s: Sequence[float], time_s: float) -> bool:
    """Return whether a time is between the first and the second of some times, the third and the fourth, and so on."""
    return sum(time_s >= one for one in times_s) % 2 == 1


def frame_at(time_s: float, rows: np.ndarray, *, index: int = 0) -> Frame:
    """Return a frame of points, shape (N, 4): coordinates and intensity."""
    points = np.zeros(len(rows), POINT)
    for column, name in enumerate(POINT.names):
        points[name] = rows[:, column]
    return Frame(from_array(points), stamp_ns=round(time_s * 1e9), index=index)


def waves(x: np.ndarray, y: np.ndarray, time_s: float, amplitude_m: float) -> np.ndarray:
    """Return the height of the water at positions."""
    swell = np.sin(0.35 * x + 0.2 * y - 1.5 * time_s)
    return amplitude_m * (swell + 0.5 * np.sin(0.8 * y - 0.3 * x - 2.5 * time_s))


def water(rng: np.random.Generator, time_s: float, size: int, amplitude_m: float = 0.15) -> np.ndarray:
    """Return echoes of the water in beams around the lidar, shape (size, 4)."""
    elevation = np.radians(rng.choice(np.arange(2.75, 21, 1.5), size))
    bearing = rng.uniform(-math.pi, math.pi, size)
    distance = MAST_M / np.tan(elevation) * rng.uniform(0.97, 1.03, size)
    x, y = distance * np.cos(bearing), distance * np.sin(bearing)
    z = waves(x, y, time_s, amplitude_m) - MAST_M + rng.normal(0, 0.02, size)
    return np.column_stack([x, y, z, rng.exponential(5, size)])


def body_points(rng: np.random.Generator, body: Body, time_s: float, amplitude_m: float = 0.15) -> np.ndarray:
    """Return echoes of a body, shape (n, 4); none where it is not seen."""
    faint = 0.25 if within(body.faint, time_s) else 1.0
    size = round(faint * body.points) if within(body.seen, time_s) else 0
    if not body.solid:
        shares, extent = rng.uniform(-0.5, 0.5, (2, size)), np.array((body.length, body.width))
        x, y = np.array(body.center(time_s))[:, None] + shares * extent[:, None]
        z = waves(x, y, time_s, amplitude_m) - MAST_M + rng.uniform(0, 1, size) * body.height
        return np.column_stack([x, y, z, rng.uniform(0.5, 1.5, size) * body.intensity])
    directions = math.ceil(size / ROWS)
    x, y = side(rng, body, time_s, directions)
    foot, distance, height = waves(x, y, time_s, amplitude_m) - MAST_M, np.hypot(x, y), faint * body.height
    first, last = (np.degrees(np.arctan2(z, distance)) / BEAM_DEG for z in (foot, foot + height))
    rows = [np.arange(math.ceil(low), high) * BEAM_DEG for low, high in zip(first, last, strict=True)]
    # What no beam meets has an echo anywhere up to the top.
    z = [np.tan(np.radians(row)) * own for row, own in zip(rows, distance, strict=True)]
    z = [own if len(own) else low + rng.uniform(0, height, 1) for own, low in zip(z, foot, strict=True)]
    of = np.repeat(np.arange(directions), [len(own) for own in z])
    intensity, noise = rng.uniform(0.5, 1.5, len(of)) * body.intensity, rng.uniform(-0.009, 0.009, (2, len(of)))
    return np.column_stack([x[of] + noise[0], y[of] + noise[1], np.concatenate([np.empty(0), *z]), intensity])


def side(rng: np.random.Generator, body: Body, time_s: float, size: int) -> np.ndarray:
    """Return positions along the side of a body that looks widest from the lidar, shape (2, size)."""
    center, half = np.array(body.center(time_s)), np.array((body.length, body.width)) / 2
    if (np.abs(center) <= half).all():  # around the lidar
        return center[:, None] + rng.uniform(-1, 1, (2, size)) * half[:, None]
    nearest = center - np.copysign(half, center)
    across = int(np.argmax((np.abs(center) - half) * half[::-1]))  # x or y, whichever the side is across
    share = 2 * (np.arange(size) + rng.uniform(0.4, 0.6, size)) / max(size, 1) - 1
    sides = center[:, None] + half[:, None] * share
    sides[across] = nearest[across]
    return sides


def spray(rng: np.random.Generator, size: int) -> np.ndarray:
    """Return isolated bright points above the water, shape (size, 4)."""
    xyz = rng.uniform((-40, -40, -2.4), (40, 40, 0), (size, 3))
    return np.column_stack([xyz, rng.uniform(10, 90, size)])


def own_ship(rng: np.random.Generator, size: int) -> np.ndarray:
    """Return points of own ship, shape (size, 4): some nearer than 3 m, all nearer than 10 m."""
    xyz = rng.uniform((-7, -1.5, -1.5), (7, 1.5, 1.0), (size, 3))
    return np.column_stack([xyz, rng.uniform(0, 200, size)])


def mirrored(rng: np.random.Generator, size: int) -> np.ndarray:
    """Return echoes by way of the water, which appear below it, shape (size, 4)."""
    xyz = rng.uniform((-30, -30, -5.2), (30, 30, -5), (size, 3))
    return np.column_stack([xyz, rng.uniform(1, 30, size)])


def sea_log(
    seed: int,
    bodies: Sequence[Body],
    times_s: Sequence[float],
    *,
    size: int = 250,
    drops: int = 8,
    mirrors: int = 0,
    amplitude_m: float = 0.15,
) -> list[Frame]:
    """Return the frames of a log at given times: water, bodies, spray, own ship, and points without a return."""
    frames = []
    for index, time_s in enumerate(times_s):
        rng = np.random.default_rng([seed, index])
        parts = [water(rng, time_s, size, amplitude_m), spray(rng, drops), own_ship(rng, size // 20), np.zeros((3, 4))]
        parts += [mirrored(rng, mirrors)]
        parts += [body_points(rng, body, time_s, amplitude_m) for body in bodies]
        rows = rng.permutation(np.concatenate(parts))
        rows[rng.integers(len(rows)), rng.integers(4)] = math.nan
        frames.append(frame_at(time_s, rows, index=index))
    return frames


def random_bodies(seed: int, count: int = 7) -> list[Body]:
    """Return bodies of all kinds: tall, low, small, large, dark, bright, moving, and hidden for some time."""
    rng = np.random.default_rng(seed)
    bodies = [
        Body(*rng.uniform(12, 16, 2), vx=-5, vy=-4.5, height=1.5, points=40, length=5),  # comes near own ship
        Body(*rng.uniform(30, 45, 2), height=0.25, length=1, width=1, intensity=40, points=8),  # a low one far away
        Body(-20, 12, 1, 0, height=1.5, points=24, faint=(1.2, 1.6, 1.9)),  # one that is lost from view twice
        Body(0, -11.9, length=1, width=3, points=20),  # a large one, part of which appears near own ship
        Body(0, -8.3, length=1, width=1.6, points=10, seen=(1.0,)),
        Body(-25, -20, height=2, points=30, solid=False),
    ]
    for _ in range(count):
        bearing, distance = rng.uniform(-math.pi, math.pi), rng.uniform(11, 75)
        bodies.append(
            Body(
                distance * math.cos(bearing),
                distance * math.sin(bearing),
                *rng.normal(0, 3, 2),
                length=rng.choice([0.5, 3, 12]),
                width=rng.choice([0.5, 2]),
                height=rng.choice([0.15, 0.4, 1.5, 4]),
                points=int(rng.integers(3, 25)),
                intensity=rng.choice([3, 12, 60]),
                seen=np.cumsum(rng.exponential((0.3, 1, 0.4, 1))).tolist(),
                solid=bool(rng.random() < 0.6),
            )
        )
    return bodies


def on_body(frame: Frame, body: Body, time_s: float) -> np.ndarray:
    """Return which points of a frame are within a body, at least half a metre above the mean water."""
    x, y = body.center(time_s)
    px, py, pz = frame.coordinates
    inside = (np.abs(px - x) <= body.length / 2 + 0.01) & (np.abs(py - y) <= body.width / 2 + 0.01)
    return inside & (pz >= 0.5 - MAST_M) & frame.valid


def share_kept(result: FilterResult, body: Body) -> float:
    """Return the share of the points of a body that a result keeps; NaN if it has none."""
    own = on_body(result.frame, body, result.frame.stamp_ns / 1e9)
    return float(result.keep[own].mean()) if own.any() else math.nan
