"""Metadata of Ouster sensors: beams, frames and packets."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Mask
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import InputError

_LEGACY_COLUMNS = 16
_NESTED = ("sensor_info", "beam_intrinsics", "lidar_intrinsics", "lidar_data_format", "config_params")
_MAX_COLUMNS = 1 << 16


@dataclass(frozen=True)
class OusterMetadata:
    """Metadata of an Ouster sensor with H rows and W columns per revolution; texts are empty if they are missing.

    The profile is a packet layout, such as ``LEGACY`` or ``RNG19_RFL8_SIG16_NIR16``. The window is the first and the
    last column that the sensor sends; the first may be greater than the last. Beams have angles, shape (H,), and begin
    at a distance from the axis and a height. ``to_sensor``, shape (4, 4), transforms the lidar frame to the sensor
    frame, in metres.
    """

    model: str
    serial: str
    firmware: str
    clock: str
    profile: str
    columns: int
    packet_columns: int
    window: tuple[int, int]
    altitude_rad: Floats
    azimuth_rad: Floats
    beam_offset_m: tuple[float, float]
    to_sensor: Floats

    def expected_packets(self) -> Mask:
        """Return which packets of a revolution, shape (W / packet_columns,), have columns in the window."""
        first, last = self.window
        column = np.arange(self.columns)
        inside = (column >= first) & (column <= last) if first <= last else (column >= first) | (column <= last)
        return np.asarray(inside.reshape(-1, self.packet_columns).any(axis=1))

    def directions(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return direction and origin of each beam in the sensor frame, each of shape (3, W, H).

        In Ouster's manuals, the position of a point is range times direction plus origin. Ranges are measured from the
        axis, so the distance between axis and beam is subtracted.
        """
        distance, height = self.beam_offset_m
        encoder = 2 * np.pi * (1 - np.arange(self.columns) / self.columns)[:, None]
        angle = encoder - self.azimuth_rad
        across = np.cos(self.altitude_rad)
        up = np.broadcast_to(np.sin(self.altitude_rad), angle.shape)
        direction = np.stack([np.cos(angle) * across, np.sin(angle) * across, up])
        foot = np.stack(np.broadcast_arrays(distance * np.cos(encoder), distance * np.sin(encoder), height))
        origin = foot - np.hypot(distance, height) * direction
        rotation, shift = self.to_sensor[:3, :3], self.to_sensor[:3, 3]
        rotated = np.tensordot(rotation, direction, 1)
        moved = np.tensordot(rotation, origin, 1) + shift[:, None, None]
        return rotated.astype(np.float32), moved.astype(np.float32)


def parse_metadata(data: bytes, name: str) -> OusterMetadata:
    """Return metadata from flat (older) or nested JSON; `InputError` with a name if it is incomplete."""
    try:
        content = load_json(data)
        flat = dict(content)
        for part in _NESTED:
            flat.update(content.get(part, {}))
        return _metadata(flat)
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else error
        raise InputError(f"{name}: not valid Ouster metadata: {reason}") from error


def _metadata(flat: Mapping[str, Any]) -> OusterMetadata:
    layout = flat.get("data_format") or flat
    altitude = _angles(flat["beam_altitude_angles"])
    columns = int(layout.get("columns_per_frame") or str(flat["lidar_mode"]).partition("x")[0])
    packet_columns = int(layout.get("columns_per_packet", _LEGACY_COLUMNS))
    if not (0 < packet_columns <= columns < _MAX_COLUMNS and columns % packet_columns == 0):
        raise ValueError(f"invalid numbers of columns: {columns} per revolution, {packet_columns} per packet")
    first, last = layout.get("column_window") or (0, columns - 1)
    azimuth = _angles(flat["beam_azimuth_angles"])
    if len(altitude) != len(azimuth) or len(altitude) != layout.get("pixels_per_column", len(altitude)):
        raise ValueError(f"expected one altitude and one azimuth angle per row, got {len(altitude)} and {len(azimuth)}")
    # The transform of newer firmware overrides the distance of older firmware.
    distance = float(flat.get("lidar_origin_to_beam_origin_mm") or 0.0)
    beams = _transform(flat.get("beam_to_lidar_transform"), [1, 0, 0, distance, 0, 1, 0, 0, 0, 0, 1, 0])
    family = re.match(r"OS-?([0-9A-Z]+)", str(flat.get("prod_line", "")))  # OS-1-128 and OS-1-128-U1 are an OS1-128
    return OusterMetadata(
        model=f"OS{family[1]}-{len(altitude)}" if family else f"OS-{len(altitude)}",
        serial=str(flat.get("prod_sn", "")),
        firmware=str(flat.get("build_rev", "")),
        clock=str(flat.get("timestamp_mode", "")),
        profile=str(layout.get("udp_profile_lidar") or "LEGACY"),
        columns=columns,
        packet_columns=packet_columns,
        window=(int(first), int(last)),
        altitude_rad=altitude,
        azimuth_rad=azimuth,
        beam_offset_m=(float(beams[0, 3]), float(beams[2, 3])),
        to_sensor=_transform(flat.get("lidar_to_sensor_transform"), [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18]),
    )


def _angles(degrees: Any) -> Floats:
    angles = np.radians(np.asarray(degrees, np.float64))
    if angles.ndim != 1 or not 0 < angles.size <= 1024 or not np.isfinite(angles).all():
        raise ValueError("beam angles must be a list of 1 to 1024 finite numbers")
    return angles


def _transform(values: Any, default: list[float]) -> Floats:
    """Return a 4 by 4 transform with its translation converted from millimetres to metres."""
    matrix = np.array([*default, 0, 0, 0, 1] if values is None else values, np.float64).reshape(4, 4)
    if not np.isfinite(matrix).all():
        raise ValueError("a transform contains non-finite numbers")
    matrix[:3, 3] /= 1000
    return matrix
