"""Device information packets (DIFOP) of RoboSense sensors: settings, and the angles of lasers, also from a file."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.packets import read_calibration
from seaclutter_cli.sensors.robosense.models import RUBY, RobosenseModel, with_old_firmware

VERTICAL_AT = 468
"""Offset of the vertical angles in device information."""
_MIN_ANGLE, _ANGLE_LIMIT = -9000, 18000
_SIXTEEN = 16
_CLASSIC = ("RS-LiDAR-32", "RS-LiDAR-16")
"""Models that state how their intensities are calibrated, and of which there is old firmware."""
_OLD_VERSIONS = {bytes.fromhex(text) for text in ("000000", "ffffff", "55aa5a", "e90100")}
_TWO_RETURNS_SINCE = bytes((8, 2, 9))
_MODES = {1: "strongest", 2: "last", 4: "strongest", 5: "last", 6: "nearest"}
_INTENSITY = {0xC1: "calibrated by the sensor (mode 3)", 0xB1: "raw (mode 2)"}
_INTENSITY |= dict.fromkeys((0x00, 0xFF, 0xA1), "raw (mode 1)")


@dataclass(frozen=True)
class Angles:
    """Elevation and azimuth offset of each channel of a block, shape (C,), in hundredths of a degree."""

    vertical: NDArray[np.int64]
    horizontal: NDArray[np.int64]

    @property
    def rings(self) -> NDArray[np.uint16]:
        """Ring of each channel, shape (C,): the number of lasers with a lower elevation."""
        first, second = np.split(self.vertical, 2)
        lasers = first if np.array_equal(first, second) else self.vertical
        return np.searchsorted(np.sort(lasers), self.vertical).astype(np.uint16)


def make_angles(vertical: NDArray[np.int64], horizontal: NDArray[np.int64]) -> Angles | None:
    """Return the angles of all channels of a block from those of its lasers; None if an angle is out of range.

    The channels of 16 lasers repeat.
    """
    both = np.stack([vertical, horizontal])
    if ((both < _MIN_ANGLE) | (both >= _ANGLE_LIMIT)).any():
        return None
    vertical, horizontal = np.tile(both, 2 if both.shape[1] == _SIXTEEN else 1)
    return Angles(vertical, horizontal)


def _packet_angles(model: RobosenseModel, packet: NDArray[np.uint8]) -> Angles | None:
    """Return the angles in a device information packet, shape (1248,); None if they are not programmed."""
    if model.name != "RS-LiDAR-16":
        begins, size = (VERTICAL_AT, model.format.horizontal_at), 3 * model.lasers
        tables = np.stack([packet[begin : begin + size] for begin in begins]).astype(np.int64).reshape(2, -1, 3)
        if (tables[..., 0] == 0xFF).any() or (model.name == "RS-LiDAR-32" and not tables[0, 0].any()):
            return None
        raw = (tables[..., 1] << 8 | tables[..., 2]).astype(np.float32)
        # Single precision, and halves rounded up, as in the vendor's driver.
        sizes = np.floor((raw * np.float32(model.angle_unit)).astype(np.float64) + 0.5).astype(np.int64)
        vertical, horizontal = np.where(tables[..., 0] != 0, -sizes, sizes)
        return make_angles(vertical, horizontal)
    table = packet[1165:1213].astype(np.int64).reshape(16, 3)
    if (packet[1165:1169] == 0).all() or (packet[1165:1169] == 0xFF).all():
        return None
    sizes = (table[:, 0] << 16 | table[:, 1] << 8 | table[:, 2]) // 100
    return make_angles(np.where(np.arange(16) < 8, -sizes, sizes), np.zeros(16, np.int64))


def file_angles(model: RobosenseModel, path: Path) -> Angles:
    """Return the angles in a file that RoboSense ships with a unit; `InputError` if it is not such a file.

    It has one line per laser: its elevation and, after a comma, its azimuth offset, in degrees.
    """
    lines = read_calibration(path).decode(errors="replace").splitlines()
    rows = [row for line in lines if (row := _numbers(line))]
    if len(rows) != model.lasers:
        raise InputError(f"{path}: expected {model.lasers} lines of angles for the {model.name}, got {len(rows)}")
    table = np.array([[*row, 0.0][:2] for row in rows])
    hundredths = np.where(np.isfinite(table), np.rint(np.clip(table, -1000, 1000) * 100), _ANGLE_LIMIT).astype(np.int64)
    angles = make_angles(*hundredths.T)
    if angles is None:
        raise InputError(f"{path}: angles must be between -90 and 180 degrees")
    return angles


def _numbers(line: str) -> list[float]:
    try:
        return [float(part) for part in re.split(r"[,;\s]+", line.strip()) if part]
    except ValueError:
        return []


@dataclass(frozen=True)
class Device:
    """A sensor and its settings.

    The model has the units of its firmware; angles are None if they are not programmed. ``fov`` is the start and the
    end of the field of view in hundredths of a degree, ``details`` are facts for display. If it is reversed, azimuths
    grow anticlockwise.
    """

    model: RobosenseModel
    angles: Angles | None
    dual: bool
    rotation_hz: int
    fov: tuple[int, int]
    details: dict[str, str]
    reversed: bool = False

    @property
    def step_ns(self) -> int:
        """Time between blocks, or between pairs of blocks, in nanoseconds."""
        return self.model.block_ns * self.model.firings(dual=self.dual)

    @property
    def step(self) -> int:
        """Rotation in `step_ns`, in hundredths of a degree."""
        single = round(36000 * self.rotation_hz * self.model.block_ns / 10**9)
        return single * self.model.firings(dual=self.dual)

    @property
    def paired(self) -> bool:
        """Whether two blocks contain the two returns of one firing."""
        return self.dual and self.model.lasers == self.model.channels

    @property
    def gap_ns(self) -> int:
        """Time in the blind sector per revolution, in nanoseconds."""
        start, end = self.fov
        seen = end - start if start < end else end + 36000 - start
        return round((36000 - seen) / (36000 * self.rotation_hz) * 10**9)


def read_device(model: RobosenseModel, packet: NDArray[np.uint8]) -> Device:
    """Return the sensor described by a device information packet, shape (1248,)."""
    is_classic = model.name in _CLASSIC
    old = is_classic and packet[41:44].tobytes() in _OLD_VERSIONS
    angles = _packet_angles(model, packet)
    rpm, start, end = (int(packet[offset]) << 8 | int(packet[offset + 1]) for offset in (8, 32, 34))
    mode = int(packet[300])
    dual = mode in model.format.dual_modes and not (old and packet[45:48].tobytes() < _TWO_RETURNS_SINCE)
    used = with_old_firmware(model) if old else model
    details = {
        "serial number": packet[292:298].tobytes().hex(),
        "firmware": f"top board {packet[40:45].tobytes().hex()}, bottom board {packet[45:50].tobytes().hex()}",
        "rotation rate": f"{rpm} rpm",
        "return mode": "dual" if dual else f"single ({_name(mode, model)})",
        "distance unit": f"{used.unit_m * 1000:g} mm",
    }
    if is_classic:
        details["intensity"] = _INTENSITY.get(int(packet[291]), f"unknown (mode byte {packet[291]:#04x})")
    is_reversed = model.name == "RS-Bpearl" and packet[337] != 0
    return Device(used, angles, dual, rpm // 60 or 10, (start, end), details, bool(is_reversed))


def _name(mode: int, model: RobosenseModel) -> str:
    """Return the name of a mode with one return; those of the RS-Ruby differ between its versions."""
    known = {} if model.format.begin == RUBY.begin else _MODES
    return known.get(mode, f"mode {mode}")


def assumed_device(model: RobosenseModel, azimuth: NDArray[np.int64]) -> Device:
    """Return a sensor inferred from block azimuths, shape (P, B), without device information."""
    steps = np.diff(azimuth, axis=1) % 36000
    if model.lasers == model.channels:
        dual = len(steps) > 0 and float((steps[:, ::2] == 0).mean()) > 0.5
        steps = steps[:, 1::2] if dual else steps
        rotation_hz = _rotation_hz(steps, model.block_ns)
    else:
        # With dual returns, a block has one firing instead of two. At 5, 10 or 20 Hz, the azimuth step is ambiguous.
        dual = 0 < _rotation_hz(steps, 2 * model.block_ns) <= 5
        rotation_hz = _rotation_hz(steps, model.block_ns * (1 if dual else 2))
    details = {
        "return mode": "dual (inferred)" if dual else "single (inferred)",
        "distance unit": f"{model.unit_m * 1000:g} mm (assumed)",
    }
    return Device(model, None, dual, rotation_hz or 10, (0, 36000), details)


def _rotation_hz(steps: NDArray[np.int64], step_ns: int) -> int:
    return round(float(np.median(steps)) / 36000 / (step_ns / 10**9)) if steps.size else 0
