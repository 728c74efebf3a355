"""Blocks of RoboSense data packets: validity, firing times, rotation, and conversion to points.

Points are computed in single precision, in the order of operations of RoboSense's driver.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.packets import point_dtype
from seaclutter_cli.sensors.robosense.device import Device
from seaclutter_cli.sensors.robosense.models import PacketFormat, RobosenseModel
from seaclutter_cli.sensors.robosense.packets import Angles, channels, data_layout

_WHOLE = 0xFFFF
BLIND = 100
"""Azimuth step between blocks, in hundredths of a degree, above which a blind sector separates them."""
_MIN_AZIMUTH, _MAX_AZIMUTH = -9000, 45000
_SWAPPED = 0x8000


@cache
def block_dtype(model: RobosenseModel) -> np.dtype[Any]:
    """Return the layout of decoded blocks.

    They have the azimuth at their start and the rotation until the next one in hundredths of a degree, their start time
    in nanoseconds of Unix time, whether they contain second returns, and the raw bytes of distances and intensities.
    """
    numbers: list[Any] = [(name, np.int64) for name in ("azimuth", "step", "times_ns")]
    return np.dtype([*numbers, ("second", np.bool_), ("channels", data_layout(model)["blocks"].base["channels"])])


def valid_blocks(blocks: NDArray[Any], layout: PacketFormat) -> NDArray[np.bool_]:
    """Return which blocks, shape (P, B), are valid: azimuth below 360° and no invalid id up to the block."""
    mask, value = layout.block_id
    ids = blocks["id"] if mask == _WHOLE else blocks["id"] & mask
    return np.logical_and.accumulate(ids == value, axis=1) & (blocks["azimuth"] < 36000)


def second_returns(azimuth: NDArray[np.int64], device: Device, before: int) -> NDArray[np.bool_]:
    """Return which blocks contain second returns, shape (P, B), given their azimuths and that of the block before."""
    blocks = azimuth.shape[1]
    if device.paired and blocks % 2:
        # Pairs extend from one packet into the next.
        return np.asarray(np.diff(azimuth.ravel(), prepend=before) == 0).reshape(azimuth.shape)
    return np.broadcast_to((np.arange(blocks) % 2 == 1) & device.paired, azimuth.shape)


def steps(
    azimuth: NDArray[np.int64], second: NDArray[np.bool_], device: Device
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rotation during each block, and its start time relative to the first block of its packet.

    Azimuths and rotations, shape (P, B), are in hundredths of a degree, times in nanoseconds. The blocks with
    ``second`` returns start with those before them.
    """
    jump = np.diff(azimuth, axis=1)
    jump += np.where(jump < 0, 36000, 0)
    blind, later = jump > BLIND, ~second[:, 1:]
    step, time_ns = np.full(azimuth.shape, device.step, np.int64), np.zeros(azimuth.shape, np.int64)
    np.cumsum(np.where(blind, device.gap_ns, device.step_ns) * later, axis=1, out=time_ns[:, 1:])
    step[:, :-1] = np.where(blind, device.step, jump)
    return np.where(np.pad(later, ((0, 0), (0, 1)), constant_values=True), step, np.roll(step, -1, axis=1)), time_ns


class Geometry:
    """Converter from the blocks of a sensor, whose lasers have some angles, to points."""

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

    def points(self, blocks: NDArray[np.void]) -> NDArray[np.void]:
        """Return the points of blocks, shape (N,), in firing order."""
        distance, intensity = self._measured(channels(blocks["channels"]))
        azimuth = blocks["azimuth"][:, None] + self._rotation[blocks["step"]] - _MIN_AZIMUTH
        range_m = distance * self._unit
        points = np.empty(distance.shape, self._packed)
        positions = self._directions.take(azimuth + self._horizontal, mode="clip")
        positions *= range_m * self._cos
        positions += self._lens.take(azimuth, mode="clip")
        points["xy"] = positions.conj() if self._reversed else positions
        points["z"] = range_m * self._sin + self._up
        points["intensity"] = intensity
        points["ring"] = self._rings
        points["timestamp"] = (blocks["times_ns"] / 1e9)[:, None] + self._channel_s
        if self._device.dual:
            lasers = np.arange(self._device.model.channels) // self._device.model.lasers
            points["return_number"] = 1 + (blocks["second"][:, None] if self._device.paired else lasers)
        least, most = self._limits
        return _select(points.reshape(-1).view(self._dtype), (distance >= least) & (distance <= most))

    def _measured(self, measured: NDArray[Any]) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
        """Return distances in units and intensities, shape (B, C)."""
        distance, intensity = measured["distance"].astype(np.uint16), measured["intensity"]
        if (mask := self._device.model.format.distance_mask) != _WHOLE:
            distance &= mask
        if self._device.model.swaps_halves:
            swapped = distance[:, 0] >= _SWAPPED
            distance &= _SWAPPED - 1
            intensity = intensity.copy()
            for values in (distance, intensity):
                values[swapped] = np.roll(values[swapped], values.shape[1] // 2, axis=1)
        return distance, intensity


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
