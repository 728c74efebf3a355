"""Frames for the tests of the filters: from arrays and from a random sea."""

import math
from dataclasses import replace

import numpy as np

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.frame import Frame
from seaclutter_cli.records import Channel

CHANNEL = Channel(1, "/points", "cdr", None)


def frame_of(cloud: Cloud, index: int = 0) -> Frame:
    """Return the frame of a cloud, with the stamp of a log at 10 frames per second."""
    time_ns = index * 100_000_000
    return Frame(cloud, stamp_ns=time_ns, index=index)


def make_frame(xyz, intensity=None, *, index=0, coordinates="f8", intensities="f8") -> Frame:
    """Return a frame of points of shape (N, 3); ``intensity`` is an array, one value for all points, or None."""
    xyz = np.asarray(xyz, float).reshape(-1, 3)
    fields = [(axis, coordinates) for axis in "xyz"]
    if intensity is not None:
        fields.append(("intensity", intensities))
    points = np.zeros(len(xyz), fields)
    for axis, values in zip("xyz", xyz.T, strict=True):
        points[axis] = values
    if intensity is not None:
        points["intensity"] = intensity
    return frame_of(from_array(points), index)


def on_axis(ranges, intensity=100, **kwargs) -> Frame:
    """Return a frame of points on the x axis at the given ranges."""
    ranges = np.atleast_1d(np.asarray(ranges, float))
    return make_frame(np.column_stack([ranges, np.zeros((len(ranges), 2))]), intensity, **kwargs)


def take(frame: Frame, order) -> Frame:
    """Return a frame with the points at the indices ``order``."""
    return frame_of(from_array(frame.cloud.points[order]), frame.index)


def big_endian(frame: Frame) -> Frame:
    """Return a frame with the same points in big-endian byte order."""
    data = frame.cloud.points.astype(frame.cloud.dtype.newbyteorder(">")).tobytes()
    return frame_of(replace(frame.cloud, big_endian=True, data=data), frame.index)


def organised(frame: Frame, *, height: int, padding: int) -> Frame:
    """Return a frame with the same points as an organised cloud whose rows end with padding bytes."""
    cloud = frame.cloud
    width = cloud.size // height
    rows = np.full((height, width * cloud.point_step + padding), 255, np.uint8)
    rows[:, : width * cloud.point_step] = np.frombuffer(cloud.data, np.uint8).reshape(height, -1)
    image = replace(cloud, height=height, width=width, row_step=rows.shape[1], data=rows.tobytes())
    return frame_of(image, frame.index)


def around(rng, size, ranges, heights):
    """Return points all around the lidar, shape (size, 3), uniform between two ranges and two heights."""
    bearing = rng.uniform(-math.pi, math.pi, size)
    range_m = rng.uniform(*ranges, size)
    return np.column_stack([range_m * np.cos(bearing), range_m * np.sin(bearing), rng.uniform(*heights, size)])


def sea_frame(seed, *, size=400, index=0, coordinates="f4", intensities="f4", scale=1) -> Frame:
    """Return a random frame of roughly ``size`` points.

    It contains the sea surface in dense dark circles, bright targets, sparse bright spray, own structure, a far coast,
    duplicates, points without a return and, in floating-point fields, NaN and infinity.

    Parameters
    ----------
    seed : int
        Equal seeds give equal frames.
    size, index : int, optional
        Approximate number of points, and index of the frame.
    coordinates, intensities : str, optional
        Types of the fields. Intensities are rounded down for integer types.
    scale : int, optional
        Factor of the intensities, for types of more than 8 bits.
    """
    rng = np.random.default_rng([seed, index])
    share = size // 20
    wave = around(rng, 8 * share, (-0.2, 0.2), (-2.2, -1.8))
    bearing = rng.uniform(-math.pi, math.pi, 8 * share)
    radius = rng.choice([12.0, 18.0, 24.9, 30.0, 45.0, 60.0], 8 * share)
    wave[:, 0] += radius * np.cos(bearing)
    wave[:, 1] += radius * np.sin(bearing)
    targets = [around(rng, 1, (12, 68), (-1, 2)) + rng.normal(0, (1.0, 0.4, 0.6), (2 * share, 3)) for _ in range(3)]
    spray = around(rng, 2 * share, (8, 75), (-2, 1))
    own = around(rng, share, (0.5, 10.5), (-1, 1))
    coast = around(rng, share, (65, 110), (0, 8))
    xyz = np.concatenate([wave, *targets, spray, own, coast, np.zeros((share, 3))])
    brightness = np.concatenate(
        [
            rng.exponential(6, len(wave)),
            rng.uniform(20, 200, 6 * share),
            rng.uniform(10, 120, len(spray)),
            rng.uniform(0, 255, len(own) + len(coast)),
            np.zeros(share),
        ]
    )
    order = rng.permutation(len(xyz))
    order[: len(order) // 10] = rng.choice(order, len(order) // 10)
    xyz, brightness = xyz[order], np.clip(brightness[order], 0, 255) * scale
    xyz[rng.integers(len(xyz), size=2), rng.integers(3, size=2)] = math.nan, math.inf
    if intensities.startswith("f"):
        brightness[rng.integers(len(xyz), size=2)] = math.nan, math.inf
    else:
        brightness = np.floor(brightness)
    return make_frame(xyz, brightness, index=index, coordinates=coordinates, intensities=intensities)


def row_and_points(*distances):
    """Return the ranges of 11 points, 1/8 m apart from 20 m, and of one at each distance behind the last."""
    row = 20 + np.arange(11) / 8
    return np.concatenate([row, row[-1] + np.array(distances, float)])
