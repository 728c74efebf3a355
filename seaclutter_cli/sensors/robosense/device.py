"""A RoboSense sensor, as far as its packets show it: model, settings, and angles of its lasers, also from a file."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from seaclutter_cli.arrays import Bytes, Ints
from seaclutter_cli.documents import read_document
from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.catalog import ADVICE
from seaclutter_cli.sensors.packets import DecoderOptions, view_packets
from seaclutter_cli.sensors.robosense import models
from seaclutter_cli.sensors.robosense.models import RobosenseModel
from seaclutter_cli.sensors.robosense.packets import ANGLE_LIMIT, VERTICAL_AT, Angles, data_layout, make_angles

_ANGLES_HINT = "pass the angles with --calibration FILE (one line 'elevation,azimuth offset' in degrees per laser)"
_CLASSIC = ("RS-LiDAR-32", "RS-LiDAR-16")
"""Models that state how their intensities are calibrated, and of which there is old firmware."""
_OLD_VERSIONS = {bytes.fromhex(text) for text in ("000000", "ffffff", "55aa5a", "e90100")}
_TWO_RETURNS_SINCE = bytes((8, 2, 9))
_MODES = {1: "strongest", 2: "last", 4: "strongest", 5: "last", 6: "nearest"}
_INTENSITY = {0xC1: "calibrated by the sensor (mode 3)", 0xB1: "raw (mode 2)"}
_INTENSITY |= dict.fromkeys((0x00, 0xFF, 0xA1), "raw (mode 1)")
_SHARED = ("RS-LiDAR-32", "RS-LiDAR-16", "RS-Bpearl")
_HELIOS = ("RS-Helios", "RS-Helios-16P")
_RUBIES = (("RS-Ruby", "RS-Ruby-Plus"), ("RS-Ruby-80", "RS-Ruby-Plus-80"), ("RS-Ruby-48", "RS-Ruby-Plus-48"))
_BPEARL_4_TYPE, _80V_MODEL = (3, 4), 3
_AIRY_48, _AIRY_192, _AIRY_MOUNTING_AT = 1, 3, 289


def find_model(data: Bytes, info: Bytes, options: DecoderOptions, warnings: list[str]) -> RobosenseModel:
    """Return the model of a sensor that sent a data packet, shape (L,), and device information, shape (I, 1248).

    There is a warning if the user names a model and the device information is of another one. `InputError` if the
    packets do not identify the model, or are of another or an unsupported one.
    """
    wanted, allowed = options.model, _possible(data)
    guessed = _guess(allowed, info)
    if wanted is None and guessed is None:
        names = f"{', '.join(allowed[:-1])} and {allowed[-1]}"
        hint = "" if len(info) or options.calibration else f", and {_ANGLES_HINT}"
        raise InputError(f"RoboSense: {names} share a packet format: select one with --sensor{hint}")
    name = wanted if wanted in allowed else guessed
    if name is None or (name != wanted and wanted in models.MODELS):
        raise InputError(f"RoboSense: the packets are from {' or '.join(allowed)}, not from {wanted}")
    if name == wanted and guessed not in (None, wanted):
        warnings.append(f"the device information is from {guessed}, but the packets are decoded as {wanted}")
    return _version(models.MODELS[name], data, info)


def _possible(data: Bytes) -> Sequence[str]:
    if data[:4].tobytes() == models.CLASSIC_ID:
        return _SHARED
    if len(data) != models.INFO_BYTES:
        return _RUBIES[-1]
    # Eight blocks of 48 channels, of which each begins with FF EE.
    if (data[models.AIRY.begin : models.AIRY.begin + 1184].reshape(8, 148)[:, :2] == (0xFF, 0xEE)).all():
        return ("RS-Airy-48" if data[32] == _AIRY_48 else "RS-Airy",)
    for names in _RUBIES:
        model = models.MODELS[names[0]]
        ids = data[models.RUBY.begin :: 4 + 3 * model.channels][: model.blocks]
        if (ids == models.RUBY.block_id[1] >> 8).all():
            return names
    return _HELIOS


def _guess(allowed: Sequence[str], info: Bytes) -> str | None:
    if allowed == _SHARED:
        return next((name for packet in info if (name := _guess_classic(packet))), None)
    if allowed == _HELIOS:
        # A sensor with 16 lasers lacks the angles of others.
        is_16p = len(info) and _is_used(info[0, 468:516]) and not _is_used(info[0, 516:564])
        return "RS-Helios-16P" if is_16p else "RS-Helios"
    return allowed[0] if len(allowed) == 1 else None


def _version(model: RobosenseModel, data: Bytes, info: Bytes) -> RobosenseModel:
    if model.name == "RS-Airy":
        if data[32] == _AIRY_192:
            raise InputError(f"packets of a RoboSense RS-Airy with 192 lasers are not supported; {ADVICE}")
        return models.AIRY_BY_MOUNTING.get(int(info[0, _AIRY_MOUNTING_AT]), model) if len(info) else model
    if model.name == models.BPEARL_4.name and tuple(data[31:33].tolist()) == _BPEARL_4_TYPE:
        return models.BPEARL_4
    return models.RUBY_PLUS_80V if model.name == models.RUBY_PLUS_80V.name and data[31] == _80V_MODEL else model


def _guess_classic(packet: Bytes) -> str | None:
    """Return the classic model that sent a device information packet; None if its tables do not identify it."""
    of_32 = _is_used(packet[468:564])
    of_16 = _is_used(packet[1165:1213])
    if of_32 == of_16:
        return None
    if of_16:
        return "RS-LiDAR-16"
    # All lasers of an RS-Bpearl look up, half of those of an RS-LiDAR-32 look down.
    return "RS-LiDAR-32" if packet[468:564:3].any() else "RS-Bpearl"


def _is_used(table: Bytes) -> bool:
    return bool(((table != 0) & (table != 0xFF)).any())


def packet_angles(model: RobosenseModel, packet: Bytes) -> Angles | None:
    """Return the angles in a device information packet, shape (1248,); None if they are not programmed."""
    if model.name != "RS-LiDAR-16":
        begins, size = (VERTICAL_AT, model.format.horizontal_at), 3 * model.lasers
        tables = np.stack([packet[begin : begin + size] for begin in begins]).view([("sign", "u1"), ("size", ">u2")])
        if (tables["sign"] == 0xFF).any() or (model.name == "RS-LiDAR-32" and not any(tables[0, 0].tolist())):
            return None
        # Single precision, and halves rounded up, as in the vendor's driver.
        raw = tables["size"].astype(np.float32) * np.float32(model.angle_unit)
        sizes = np.floor(raw.astype(np.float64) + 0.5).astype(np.int64)
        return make_angles(*np.where(tables["sign"] != 0, -sizes, sizes))
    table = packet[1165:1213].astype(np.int64).reshape(16, 3)
    if (packet[1165:1169] == 0).all() or (packet[1165:1169] == 0xFF).all():
        return None
    sizes = (table[:, 0] << 16 | table[:, 1] << 8 | table[:, 2]) // 100
    return make_angles(np.where(np.arange(16) < 8, -sizes, sizes), np.zeros(16, np.int64))


def _file_angles(model: RobosenseModel, path: Path) -> Angles:
    """Return the angles in a file with one line per laser, ``elevation,azimuth offset`` in degrees; or `InputError`."""
    lines = read_document(path).decode(errors="replace").splitlines()
    rows = [row for line in lines if (row := _numbers(line))]
    if len(rows) != model.lasers:
        raise InputError(f"{path}: expected {model.lasers} lines of angles for the {model.name}, got {len(rows)}")
    table = np.array([[*row, 0.0][:2] for row in rows])
    hundredths = np.where(np.isfinite(table), np.rint(np.clip(table, -1000, 1000) * 100), ANGLE_LIMIT).astype(np.int64)
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

    The model has the units of its firmware. ``fov`` is the start and the end of the field of view in hundredths of a
    degree, ``details`` are facts for display. If it is reversed, azimuths grow anticlockwise.
    """

    model: RobosenseModel
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


def find_device(
    model: RobosenseModel, data: Bytes, info: Bytes, options: DecoderOptions, warnings: list[str]
) -> tuple[Device, Angles]:
    """Return a sensor and its angles, from packets, (P, L), and device information, (I, 1248); or `InputError`."""
    tables = [packet_angles(model, packet) for packet in info]
    place = next((number for number, table in enumerate(tables) if table), 0)
    angles = _file_angles(model, options.calibration) if options.calibration else tables[place] if tables else None
    if angles is None:
        problem = "the device information (DIFOP) contains no angles" if tables else "no device information (DIFOP)"
        raise InputError(f"{model.name}: {problem}: {_ANGLES_HINT}")
    if tables:
        device = _read_device(model, info[place])
    else:
        warnings.append(
            "no device information (DIFOP): rotation rate and return mode are inferred, the distance unit is assumed"
        )
        device = _assumed_device(model, view_packets(data, data_layout(model))["blocks"]["azimuth"].astype(np.int64))
    intensity = device.details.get("intensity", "")
    if intensity.startswith(("raw", "unknown")):
        warnings.append(f"intensity is {intensity}: thresholds for calibrated intensity do not apply")
    if device.model.unit_m > model.unit_m:
        warnings.append("old firmware: the distance unit is 1 cm")
    if (at := model.format.mode_at) is not None:
        device = replace(device, dual=int(data[0, at]) in model.format.dual_modes)
        device.details["return mode"] = "dual" if device.dual else "single"
    if options.calibration:
        device.details["angles"] = str(options.calibration)
    return device, angles


def _read_device(model: RobosenseModel, packet: Bytes) -> Device:
    is_classic = model.name in _CLASSIC
    old = is_classic and packet[41:44].tobytes() in _OLD_VERSIONS
    rpm, start, end = (int(packet[offset]) << 8 | int(packet[offset + 1]) for offset in (8, 32, 34))
    mode = int(packet[300])
    dual = mode in model.format.dual_modes and not (old and packet[45:48].tobytes() < _TWO_RETURNS_SINCE)
    used = models.with_old_firmware(model) if old else model
    # The names of the RS-Ruby's modes differ between its versions.
    names = {} if model.format.begin == models.RUBY.begin else _MODES
    details = {
        "serial number": packet[292:298].tobytes().hex(),
        "firmware": f"top board {packet[40:45].tobytes().hex()}, bottom board {packet[45:50].tobytes().hex()}",
        "rotation rate": f"{rpm} rpm",
        "return mode": "dual" if dual else f"single ({names.get(mode, f'mode {mode}')})",
        "distance unit": f"{used.unit_m * 1000:g} mm",
    }
    if is_classic:
        details["intensity"] = _INTENSITY.get(int(packet[291]), f"unknown (mode byte {packet[291]:#04x})")
    is_reversed = model.name == "RS-Bpearl" and packet[337] != 0
    return Device(used, dual, rpm // 60 or 10, (start, end), details, bool(is_reversed))


def _assumed_device(model: RobosenseModel, azimuth: Ints) -> Device:
    """Return a sensor inferred from block azimuths, shape (P, B), without device information."""
    steps = np.diff(azimuth, axis=1) % 36000
    if model.lasers == model.channels:
        dual = len(steps) > 0 and float((steps[:, ::2] == 0).mean()) > 0.5
        steps = steps[:, 1::2] if dual else steps
    else:
        # With dual returns, a block has one firing instead of two. At 5, 10 or 20 Hz, the azimuth step is ambiguous.
        dual = 0 < _rotation_hz(steps, 2 * model.block_ns) <= 5
    rotation_hz = _rotation_hz(steps, model.block_ns * model.firings(dual=dual))
    details = {
        "return mode": "dual (inferred)" if dual else "single (inferred)",
        "distance unit": f"{model.unit_m * 1000:g} mm (assumed)",
    }
    return Device(model, dual, rotation_hz or 10, (0, 36000), details)


def _rotation_hz(steps: Ints, step_ns: int) -> int:
    return round(float(np.median(steps)) / 36000 / (step_ns / 10**9)) if steps.size else 0
