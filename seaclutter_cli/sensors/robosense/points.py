"""Conversion of RoboSense blocks to points, in single precision and the order of operations of RoboSense's driver."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.packets import point_dtype
from seaclutter_cli.sensors.robosense.angles import Angles
from seaclutter_cli.sensors.robosense.blocks import BLIND, Blocks
from seaclutter_cli.sensors.robosense.device import Device
from seaclutter_cli.sensors.robosense.models import RobosenseModel
from seaclutter_cli.sensors.robosense.packets import channels

_MIN_AZIMUTH, _MAX_AZIMUTH = -9000, 45000
_SWAPPED, _ALL_BITS = 0x8000, 0xFFFF


class Geometry:
    """Converter from the blocks of one sensor to points.

    Parameters
    ----------
    device : Device
        The sensor.
    angles : Angles
        Directions of its lasers.
    """

    def __init__(self, device: Device, angles: Angles) -> None:
        model = device.model
        self._device, self._horizontal, self._rings = device, angles.horizontal, angles.rings
        channel_ns = model.channel_ns(dual=device.dual)
        self.last_ns = int(channel_ns[-1])
        self._channel_s = channel_ns / 1e9
        share = (channel_ns / device.step_ns).astype(np.float32)
        rotation = np.arange(max(BLIND, device.step) + 1, dtype=np.float32)[:, None] * share
        self._rotation = rotation.astype(np.int64)
        self._reversed = device.reversed
        self._directions = _directions()
        forward, up = np.array(model.lens_m, np.float32)
        self._lens = _lens(float(forward))
        vertical = angles.vertical * 0.01 * np.pi / 180
        self._cos, self._sin, self._up = np.cos(vertical).astype("f4"), np.sin(vertical).astype("f4"), up
        self._unit, self._limits = np.float32(model.unit_m), _limits(model)
        self._dtype = point_dtype(returns=device.dual)
        self._packed = _packed(self._dtype)

    def points(self, blocks: Blocks) -> NDArray[np.void]:
        """Return the points of blocks, shape (N,), in firing order."""
        distance, intensity = self._measured(channels(blocks.channels))
        azimuth = blocks.azimuth[:, None] + self._rotation[blocks.step] - _MIN_AZIMUTH
        range_m = distance * self._unit
        points = np.empty(distance.shape, self._packed)
        positions = self._directions.take(azimuth + self._horizontal, mode="clip")
        positions *= range_m * self._cos
        positions += self._lens.take(azimuth, mode="clip")
        points["xy"] = positions.conj() if self._reversed else positions
        points["z"] = range_m * self._sin + self._up
        points["intensity"] = intensity
        points["ring"] = self._rings
        points["timestamp"] = (blocks.times_ns / 1e9)[:, None] + self._channel_s
        if self._device.dual:
            points["return_number"] = self._return_numbers(blocks)
        least, most = self._limits
        return _select(points.reshape(-1).view(self._dtype), (distance >= least) & (distance <= most))

    def _measured(self, measured: NDArray[Any]) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
        """Return distances in units and intensities, shape (B, C)."""
        distance, intensity = measured["distance"].astype(np.uint16), measured["intensity"]
        if (mask := self._device.model.format.distance_mask) != _ALL_BITS:
            distance &= mask
        if self._device.model.swaps_halves:
            swapped = distance[:, 0] >= _SWAPPED
            distance &= _SWAPPED - 1
            intensity = intensity.copy()
            for values in (distance, intensity):
                values[swapped] = np.roll(values[swapped], values.shape[1] // 2, axis=1)
        return distance, intensity

    def _return_numbers(self, blocks: Blocks) -> NDArray[np.int64]:
        if self._device.paired:
            return 1 + blocks.second[:, None].astype(np.int64)
        return 1 + np.arange(self._device.model.channels) // self._device.model.lasers


@cache
def _limits(model: RobosenseModel) -> tuple[np.uint16, np.uint16]:
    """Return the least and greatest valid distance in units."""
    least, most = np.array(model.range_m, np.float32)
    ranges = np.arange(2**16, dtype=np.float32) * np.float32(model.unit_m)
    valid = np.flatnonzero((ranges >= least) & (ranges <= most))
    return np.uint16(max(valid[0], 1)), np.uint16(valid[-1])


@cache
def _directions() -> NDArray[np.complex64]:
    """Return unit vectors by azimuth in hundredths of a degree, for any two-byte azimuth plus offsets."""
    hundredths = np.arange(_MIN_AZIMUTH, 2**17)
    hundredths[hundredths >= _MAX_AZIMUTH] = 0
    radians = hundredths * 0.01 * np.pi / 180
    directions = np.empty(len(radians), np.complex64)
    directions.real, directions.imag = np.cos(radians), -np.sin(radians)
    return directions


@cache
def _lens(forward: float) -> NDArray[np.complex64]:
    """Return the position of the lens by azimuth, as in `_directions`."""
    return (_directions() * np.float32(forward)).astype(np.complex64)


def _packed(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return the layout of points with x and y as one complex number, which is faster to write."""
    fields = dict(dtype.fields or {})
    names = [name for name in fields if name not in "xy"]
    formats = ["<c8", *(fields[name][0] for name in names)]
    offsets = [0, *(fields[name][1] for name in names)]
    return np.dtype({"names": ["xy", *names], "formats": formats, "offsets": offsets, "itemsize": dtype.itemsize})


def _select(points: NDArray[np.void], keep: NDArray[np.bool_]) -> NDArray[np.void]:
    kept = np.flatnonzero(keep)
    if len(kept) == len(points):
        return points
    # Points copy several times faster as raw bytes.
    return points.view(np.dtype((np.void, points.dtype.itemsize))).take(kept).view(points.dtype)
