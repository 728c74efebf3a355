"""Device information packets (DIFOP) of RoboSense sensors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.robosense.angles import Angles, packet_angles
from seaclutter_cli.sensors.robosense.models import RUBY, RobosenseModel, with_old_firmware

CLASSIC_MODELS = ("RS-LiDAR-32", "RS-LiDAR-16")
"""Models that state how their intensities are calibrated, and of which there is old firmware."""
_OLD_VERSIONS = {bytes.fromhex(text) for text in ("000000", "ffffff", "55aa5a", "e90100")}
_TWO_RETURNS_SINCE = bytes((8, 2, 9))
_MODES = {1: "strongest", 2: "last", 4: "strongest", 5: "last", 6: "nearest"}
_INTENSITY = {0xC1: "calibrated by the sensor (mode 3)", 0xB1: "raw (mode 2)"}
_INTENSITY |= dict.fromkeys((0x00, 0xFF, 0xA1), "raw (mode 1)")


@dataclass(frozen=True)
class Device:
    """A sensor and its settings.

    Parameters
    ----------
    model : RobosenseModel
        Model, with the units of its firmware.
    angles : Angles or None
        Directions of its lasers; None if they are not programmed.
    dual : bool
        Whether it sends two returns.
    rotation_hz : int
        Revolutions per second.
    fov : tuple of int
        Start and end of the field of view, in hundredths of a degree.
    details : dict of str to str
        Facts for display.
    reversed : bool
        Whether azimuths grow anticlockwise.
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
    is_classic = model.name in CLASSIC_MODELS
    old = is_classic and packet[41:44].tobytes() in _OLD_VERSIONS
    angles = packet_angles(model, packet)
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


def guess_model(packet: NDArray[np.uint8]) -> str | None:
    """Return the classic model that sent a device information packet; None if its tables do not identify it."""
    of_32 = _is_used(packet[468:564])
    of_16 = _is_used(packet[1165:1213])
    if of_32 == of_16:
        return None
    if of_16:
        return "RS-LiDAR-16"
    # All lasers of an RS-Bpearl look up, half of those of an RS-LiDAR-32 look down.
    return "RS-LiDAR-32" if packet[468:564:3].any() else "RS-Bpearl"


def guess_helios(packet: NDArray[np.uint8]) -> str:
    """Return the RS-Helios that sent a device information packet: one with 16 lasers lacks the angles of others."""
    return "RS-Helios-16P" if _is_used(packet[468:516]) and not _is_used(packet[516:564]) else "RS-Helios"


def _is_used(table: NDArray[np.uint8]) -> bool:
    return bool(((table != 0) & (table != 0xFF)).any())
