"""Codecs for messages whose points have fixed fields: laser scans, and ``CustomMsg`` of Livox's ROS drivers.

``sensor_msgs/LaserScan`` and ``MultiEchoLaserScan`` have returns in the plane z = 0 of the scanner. A beam's place in
the message is its angle, so a written scan keeps all of its beams.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Ints, Mask
from seaclutter_cli.cloud import Cloud, PointField, from_array, point_dtype, structured
from seaclutter_cli.errors import CloudError
from seaclutter_cli.limits import above, limits
from seaclutter_cli.messages.serialisation import Header, Reader, RosCodec, Writer
from seaclutter_cli.text import count

_POINT_BYTES = 20
_MAX_BEAMS = 100_000
_LIMITS = "fffffff"
"""Code of angle_min, angle_max, angle_increment, time_increment, scan_time, range_min and range_max."""


@dataclass(frozen=True, slots=True)
class _Scan:
    """``Cloud.extra`` of scans: a message with N ranges in metres and N or no intensities.

    Each of B beams has a number of ``echoes``; the scans of several echoes have B or 0 lists of intensities, those of
    one echo have None.
    """

    header: Header
    limits: tuple[float, ...]
    ranges: NDArray[np.float32]
    intensities: NDArray[np.float32]
    echoes: Ints
    intensity_lists: int | None = None

    @property
    def starts(self) -> Ints:
        """Index of the first value of each beam, shape (B,)."""
        return np.asarray(np.cumsum(self.echoes) - self.echoes)

    @property
    def beam(self) -> Ints:
        """Index of the beam of each value, shape (N,)."""
        return np.repeat(np.arange(len(self.echoes)), self.echoes)

    @property
    def angle_rad(self) -> Floats:
        """Angle of each value, shape (N,)."""
        first, _, increment = self.limits[:3]
        return np.asarray(first + self.beam * float(increment))

    @property
    def is_return(self) -> Mask:
        """Whether each value is a return within the range limits, shape (N,)."""
        least, most = self.limits[5:]
        with np.errstate(invalid="ignore"):
            in_limits = (self.ranges >= least) & (self.ranges <= most) & (self.ranges > 0)
            return np.asarray(in_limits & np.isfinite(self.ranges) & np.isfinite(self.angle_rad))


def _cloud(scan: _Scan) -> Cloud:
    """Return the cloud of a scan: one point for each value, NaN where there is no return."""
    ranges, intensities = len(scan.ranges), len(scan.intensities)
    if intensities not in (0, ranges):
        raise CloudError(f"the scan has {count(ranges, 'range')}, but {intensities:,} intensities")
    if ranges * _POINT_BYTES > limits().message_bytes:
        raise CloudError(f"the points occupy {above(count(ranges * _POINT_BYTES, 'byte'), 'message_mib')}")
    beam, angle, is_return = scan.beam, scan.angle_rad, scan.is_return
    columns: dict[str, NDArray[Any]] = {}
    with np.errstate(invalid="ignore", over="ignore"):
        range_m = np.where(is_return, scan.ranges.astype(np.float64), np.nan)
        columns["x"], columns["y"] = range_m * np.cos(angle), range_m * np.sin(angle)
        columns["z"] = np.where(is_return, 0, np.nan)
        columns |= {"intensity": scan.intensities} if intensities else {}
        columns["index"] = beam
        columns |= {} if scan.intensity_lists is None else {"echo": np.arange(ranges) - scan.starts[beam]}
        kinds = {name: "<u4" if name in ("index", "echo") else "<f4" for name in columns}
        points = structured({name: values.astype(kinds[name]) for name, values in columns.items()})
    return replace(from_array(points, stamp_ns=scan.header.stamp_ns, frame_id=scan.header.frame_id), extra=scan)


def _begin(write: Writer, cloud: Cloud) -> tuple[_Scan, Mask]:
    """Write the header and the limits of a scan; return it, and which values remain or are no returns, shape (N,)."""
    scan, points = cloud.extra, cloud.points
    if not isinstance(scan, _Scan):
        raise CloudError("only the points of a scan can be written as a scan")
    names = ("index",) if scan.intensity_lists is None else ("index", "echo")
    if not set(names) <= set(points.dtype.names or ()):
        raise CloudError(f"a scan needs points with {' and '.join(names)}")
    kept = ~scan.is_return
    at = scan.starts[points["index"]] + (points["echo"] if "echo" in names else 0)
    kept[at[np.isfinite(points["x"])]] = True
    write.header(scan.header)
    write.numbers(_LIMITS, scan.limits)
    return scan, kept


class LaserScan(RosCodec):
    """Codec for scans with one echo; the ranges of removed points are written as NaN (REP 117)."""

    def _read(self, read: Reader) -> Cloud:
        header, numbers, ranges, intensities = read.header(), read.numbers(_LIMITS), read.floats(), read.floats()
        return _cloud(_Scan(header, numbers, ranges, intensities, np.ones(len(ranges), np.int64)))

    def _write(self, write: Writer, cloud: Cloud) -> None:
        scan, kept = _begin(write, cloud)
        write.floats(np.where(kept, scan.ranges, np.float32(np.nan)))
        write.floats(scan.intensities)


class MultiEchoLaserScan(RosCodec):
    """Codec for scans with several echoes a beam; removed ones are left out of the lists of their beams."""

    def _read(self, read: Reader) -> Cloud:
        header, numbers = read.header(), read.numbers(_LIMITS)
        ranges, echoes = self._lists(read)
        intensities, again = self._lists(read)
        if len(again) and not np.array_equal(echoes, again):
            raise CloudError("the echoes of ranges and intensities differ in number")
        return _cloud(_Scan(header, numbers, ranges, intensities, echoes, len(again)))

    def _write(self, write: Writer, cloud: Cloud) -> None:
        scan, kept = _begin(write, cloud)
        for values, lists in ((scan.ranges, len(scan.echoes)), (scan.intensities, scan.intensity_lists or 0)):
            write.number("I", lists)
            for start, number in zip(scan.starts[:lists], scan.echoes[:lists], strict=True):
                beam = slice(start, start + number)
                write.floats(values[beam][kept[beam]] if len(values) else values)

    def _lists(self, read: Reader) -> tuple[NDArray[np.float32], Ints]:
        """Return the values of all lists of a message, one after another, and the length of each list."""
        lists = [read.floats() for _ in range(read.length(_MAX_BEAMS, "beam"))]
        echoes = np.array([len(values) for values in lists], np.int64)
        return np.concatenate(lists).astype("<f4") if lists else np.zeros(0, np.float32), echoes


_LIVOX_FIELDS = (
    PointField("offset_time", 0, "u4"),
    *(PointField(axis, 4 + 4 * number, "f4") for number, axis in enumerate("xyz")),
    *(PointField(name, 16 + number, "u1") for number, name in enumerate(("reflectivity", "tag", "line"))),
)
_PACKED = 19
_RESERVED = "BBB"


@dataclass(frozen=True, slots=True)
class _CustomHeader:
    """``Cloud.extra`` of a ``CustomMsg``; ``offset_time`` of its points is relative to ``timebase_ns``."""

    header: Header
    timebase_ns: int
    lidar_id: int
    reserved: tuple[int, ...]


class LivoxCustomMsg(RosCodec):
    """Codec for Livox points; in ROS 2 a point has 20 bytes, but the last one of a message only 19."""

    def _read(self, read: Reader) -> Cloud:
        header, timebase_ns, _ = read.header(), read.number("Q"), read.number("I")
        extra = _CustomHeader(header, timebase_ns, read.number("B"), read.numbers(_RESERVED))
        number, step, padding = read.number("I"), _PACKED + self._padding, self._padding
        data, shape, size = read.take(max(number * step - padding, 0), is_declared=True), (1, number), number * step
        data = memoryview(bytes(data) + bytes(padding)) if number and padding else data
        return Cloud(
            header.stamp_ns, header.frame_id, *shape, _LIVOX_FIELDS, step, size, read.big_endian, True, data, extra
        )

    def _write(self, write: Writer, cloud: Cloud) -> None:
        extra = cloud.extra
        names = [field.name for field in _LIVOX_FIELDS]
        if not isinstance(extra, _CustomHeader) or not set(names) <= {field.name for field in cloud.fields}:
            raise CloudError("only the points of a Livox message can be written as one")
        points = np.zeros(cloud.size, point_dtype(_LIVOX_FIELDS, _PACKED + self._padding, big_endian=False))
        for name in names:
            points[name] = cloud.points[name]
        write.header(extra.header)
        write.numbers("QI", (extra.timebase_ns, cloud.size))
        write.numbers("B" + _RESERVED, (extra.lidar_id, *extra.reserved))
        write.number("I", cloud.size)
        write.raw(points.tobytes()[: max(points.nbytes - self._padding, 0)])

    @property
    def _padding(self) -> int:
        return 0 if self._ros == 1 else 1
