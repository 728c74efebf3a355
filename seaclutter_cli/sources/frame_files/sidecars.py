"""Stamps and poses of frames, from the names of their files and from files of data sets next to them."""

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seaclutter_cli.errors import InputError, opening
from seaclutter_cli.messages.metadata import SIDECAR
from seaclutter_cli.messages.serialisation import NANO, Header, Writer
from seaclutter_cli.paths import open_regular, read_whole
from seaclutter_cli.text import count

_LIMIT_NS = 2**31 * NANO  # ROS stamps have signed 32-bit seconds.
_UNITS_NS = ((10**18, 1), (10**15, 10**3), (10**12, 10**6))
_IN_NAME = re.compile(r"(?<![\d.])([1-9]\d{18}|[1-9]\d{15}|[1-9]\d{12}|[1-9]\d{9}\.\d+)(?![\d.])", re.ASCII)

_TWO_PARTS = re.compile(r"(?<![\d.])([1-9]\d{9})([._-])(\d{1,9})(?![\d.])", re.ASCII)
_NANO_DIGITS = 9

_USVINLAND = "Laser_Timestamp_Middle.txt"
_SECONDS_AND_NANOSECONDS = re.compile(r"(?<![\d.])([1-9]\d{9})[^\d.]+(\d{1,9})(?![\d.])", re.ASCII)

_MAX_BYTES = 64 * 2**20
_COLUMNS = 7
_MICRO_NS = 1000


def parse_time(text: str) -> int | None:
    """Return the exact nanoseconds of a time written by a recorder; None if the text is not a valid stamp.

    The text is a number (nano-, micro- or milliseconds since 1970 if it has 19, 16 or 13 digits before the point,
    otherwise seconds), or date and time (UTC if no zone is given).

    Examples
    --------
    >>> parse_time("1673400472.138016"), parse_time("1.037875e-01"), parse_time("1970-01-01 00:00:01.000000002")
    (1673400472138016000, 103787500, 1000000002)
    """
    try:
        value = Decimal(text.strip())
    except InvalidOperation:
        stamp_ns = _from_date(text.strip())
    else:
        if not (value.is_finite() and abs(value) < 10**19):
            return None
        unit = next((unit for least, unit in _UNITS_NS if value >= least), NANO)
        stamp_ns = int(value * unit)
    return stamp_ns if stamp_ns is not None and -_LIMIT_NS <= stamp_ns < _LIMIT_NS else None


def _from_date(text: str) -> int | None:
    match = re.fullmatch(r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d)(?:\.(\d{1,9})\d*)?(Z|[+-]\d\d:?\d\d)?", text, re.ASCII)
    if match is None:
        return None
    try:
        moment = datetime.fromisoformat(match[1] + (match[3] or ""))
    except ValueError:
        return None
    seconds = int((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp())
    return seconds * NANO + int((match[2] or "").ljust(9, "0"))


def from_names(files: Sequence[Path]) -> list[int] | None:
    """Return one stamp per file if all names contain different times in the same unit, otherwise None."""
    if (stamps := _in_two_parts(files)) is not None:
        return stamps
    times = [_IN_NAME.search(file.stem) for file in files]
    found = [match[0] for match in times if match]
    stamps = [stamp for text in found if (stamp := parse_time(text)) is not None]
    same_unit = len({len(text.partition(".")[0]) for text in found}) == 1
    return stamps if same_unit and len(set(stamps)) == len(files) else None


def _in_two_parts(files: Sequence[Path]) -> list[int] | None:
    """Return the stamps of files named by seconds and nanoseconds without leading zeros, as the exporter of ROS did."""
    found = [match.groups() for file in files if (match := _TWO_PARTS.search(file.stem))]
    if len(found) < len(files) or len({mark for _, mark, _ in found}) > 1:
        return None
    parts = [part for *_, part in found]
    longest = max(map(len, parts))
    is_padded = min(map(len, parts)) == longest or any(len(part) > 1 and part[0] == "0" for part in parts)
    is_decimal = found[0][1] == "." and is_padded
    if longest != _NANO_DIGITS or is_decimal or max(map(int, parts)) < NANO // 10:  # a counter, not a time
        return None
    stamps = [int(seconds) * NANO + int(part) for seconds, _, part in found]
    return stamps if len(set(stamps)) == len(files) and max(stamps) < _LIMIT_NS else None


def from_time_files(files: Sequence[Path]) -> list[int] | None:
    """Return one stamp per file from `times_beside`, None without; `InputError` if the times do not fit the frames."""
    if (times := times_beside(files[0].parent)) is None:
        return None
    stamps = [_in_file(times / f"{file.stem}.txt") for file in files] if times.is_dir() else _lines_for(files, times)
    late = next((index for index in range(1, len(stamps)) if stamps[index] <= stamps[index - 1]), None)
    if late is not None:
        raise InputError(f"the time of frame {files[late].name} is not later than the previous time")
    return stamps


def times_beside(folder: Path) -> Path | None:
    """Return the times of a folder of frames: a file beside it (KITTI), in it (USVInland, or our own), or a folder."""
    if (own := folder / "times.txt").is_file() and (folder / SIDECAR).is_file():
        return own
    if folder.name == "point_clouds" and (times := folder.parent / "timestamp").is_dir():
        return times
    if folder.name.endswith("-Lidar") and (times := folder / _USVINLAND).is_file():
        return times
    if folder.name not in ("velodyne", "data"):
        return None
    return next((path for name in ("times.txt", "timestamps.txt") if (path := folder.parent / name).is_file()), None)


def _in_file(path: Path) -> int:
    text = _text(path)
    if pair := _SECONDS_AND_NANOSECONDS.search(text):
        text = f"{pair[1]}.{pair[2]:0>9}"
    stamp_ns = next((stamp for part in (text, *text.split()) if (stamp := parse_time(part)) is not None), None)
    if stamp_ns is None:
        raise InputError(f"{path}: no valid time in this file")
    return stamp_ns


def _lines_for(files: Sequence[Path], times: Path) -> list[int]:
    """Return the stamps line by line or, if KITTI left frames out, from the lines with the frame numbers."""
    lines = _text(times).splitlines()
    if len(lines) != len(files):
        numbers = [int(file.stem) if re.fullmatch("[0-9]{1,18}", file.stem) else len(lines) for file in files]
        if max(numbers) >= len(lines):
            raise InputError(f"{times}: {count(len(lines), 'time')} for {count(len(files), 'frame')}")
        lines = [lines[number] for number in numbers]
    stamps = [parse_time(line) for line in lines]
    if None in stamps:
        raise InputError(f"{times}: {lines[stamps.index(None)][:40]!r} is not a valid time")
    return [stamp for stamp in stamps if stamp is not None]


def _text(path: Path) -> str:
    with opening(path):
        return read_whole(path).decode(errors="replace").strip()


class Pose(NamedTuple):
    """Position in metres, and orientation as the quaternion x, y, z, w; from the lidar to a fixed frame."""

    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]


def poses_beside(folder: Path) -> Mapping[int, Pose]:
    """Return the poses by stamp in nanoseconds that CANOE has beside ``lidar``; `InputError` if they cannot be read."""
    path = folder.parent / "novatel" / "lidar_poses.csv"
    if folder.name != "lidar" or not path.is_file():
        return {}
    try:
        with io.TextIOWrapper(open_regular(path), encoding="utf-8", newline="") as file:
            text = file.read(_MAX_BYTES + 1)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {getattr(error, 'strerror', None) or 'not UTF-8 text'}") from error
    if len(text) > _MAX_BYTES:
        raise InputError(f"{path}: has more than {_MAX_BYTES:,} characters")
    rows = csv.reader(text.splitlines())
    next(rows, None)  # the names of the columns
    try:
        return dict(_pose(row) for row in rows if row)
    except (ValueError, csv.Error) as error:
        raise InputError(f"{path}: line {rows.line_num}: {error}") from error


def pose_message(pose: Pose, stamp_ns: int, frame_id: str = "enu") -> bytes:
    """Return a pose as the bytes of a ROS 2 message ``geometry_msgs/msg/PoseStamped``."""
    write = Writer(2)
    write.header(Header(stamp_ns, frame_id))
    write.numbers("ddddddd", (*pose.position, *pose.orientation))
    return write.message()


def _pose(row: list[str]) -> tuple[int, Pose]:
    if len(row) < _COLUMNS:
        raise ValueError(f"must have at least {_COLUMNS} values, has {len(row)}")
    x, y, z, *angles = (float(value) for value in row[1:_COLUMNS])
    if not all(map(math.isfinite, (x, y, z, *angles))):
        raise ValueError("all values must be finite numbers")
    return int(float(row[0])) * _MICRO_NS, Pose((x, y, z), _quaternion(*angles))


def _quaternion(x_rad: float, y_rad: float, z_rad: float) -> tuple[float, float, float, float]:
    """Return the rotation from the lidar to the fixed frame, C1(x) C2(y) C3(z) with passive principal rotations."""
    from scipy.spatial.transform import Rotation

    (cx, sx), (cy, sy), (cz, sz) = ((math.cos(a), math.sin(a)) for a in (x_rad, y_rad, z_rad))
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    about_z = np.array([[cz, sz, 0], [-sz, cz, 0], [0, 0, 1]])
    x, y, z, w = Rotation.from_matrix(about_x @ about_y @ about_z).as_quat(canonical=True).tolist()
    return x, y, z, w
