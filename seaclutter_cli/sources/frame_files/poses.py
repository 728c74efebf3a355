"""Poses of the lidar beside the frames of a data set, as messages ``geometry_msgs/PoseStamped``."""

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.messages.serialisation import Header, Writer

_MAX_BYTES = 64 * 2**20
_COLUMNS = 7
_ENU = "enu"
_MICRO_NS = 1000


class Pose(NamedTuple):
    """Position in metres, and orientation as the quaternion x, y, z, w; from the lidar to a fixed frame."""

    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]


def poses_beside(folder: Path) -> Mapping[int, Pose]:
    """Return the poses by stamp in nanoseconds that CANOE has beside its folder ``lidar``; empty if there are none.

    Raises
    ------
    InputError
        If they cannot be read.
    """
    path = folder.parent / "novatel" / "lidar_poses.csv"
    if folder.name != "lidar" or not path.is_file():
        return {}
    try:
        with path.open(encoding="utf-8", newline="") as file:
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


def pose_message(pose: Pose, stamp_ns: int, frame_id: str = _ENU) -> bytes:
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
    return int(float(row[0])) * _MICRO_NS, Pose((x, y, z), _quaternion(_rotation(*angles)))


def _rotation(x_rad: float, y_rad: float, z_rad: float) -> NDArray[np.float64]:
    """Return the rotation from the lidar to the fixed frame, C1(x) C2(y) C3(z) with passive principal rotations."""
    (cx, sx), (cy, sy), (cz, sz) = ((math.cos(a), math.sin(a)) for a in (x_rad, y_rad, z_rad))
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    about_z = np.array([[cz, sz, 0], [-sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_x @ about_y @ about_z)


def _quaternion(matrix: NDArray[np.float64]) -> tuple[float, float, float, float]:
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(matrix).as_quat()
    sign = 1 if w >= 0 else -1
    return sign * float(x), sign * float(y), sign * float(z), sign * float(w)
