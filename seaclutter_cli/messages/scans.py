"""Codecs for ``sensor_msgs/LaserScan`` and ``MultiEchoLaserScan``: returns in the plane z = 0 of the scanner.

A beam's place in the message is its angle, so a written scan keeps all of its beams.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.limits import above, limits
from seaclutter_cli.messages.serialisation import Header, Reader, RosCodec, Writer
from seaclutter_cli.text import count

_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("index", "<u4")])
_PLAIN = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("index", "<u4")])
_ECHO = ("echo", "<u4")


@dataclass(frozen=True, slots=True)
class Scan:
    """``Cloud.extra`` of scans: a message with N ranges in metres and N or no intensities.

    ``limits`` are angle_min, angle_max, angle_increment, time_increment, scan_time, range_min and range_max. Each of B
    beams has a number of ``echoes``, and ``intensity_lists`` is the number of lists of intensities of a scan with
    several: B or 0.
    """

    header: Header
    limits: tuple[float, ...]
    ranges: NDArray[np.float32]
    intensities: NDArray[np.float32]
    echoes: NDArray[np.int64]
    intensity_lists: int = 0

    @property
    def is_return(self) -> NDArray[np.bool_]:
        """Whether each value is a return within the range limits, shape (N,)."""
        least, most = self.limits[5:]
        with np.errstate(invalid="ignore"):
            in_limits = (self.ranges >= least) & (self.ranges <= most) & (self.ranges > 0)
            return np.asarray(in_limits & np.isfinite(self.ranges) & np.isfinite(self.angle_rad))

    @property
    def beam(self) -> NDArray[np.int64]:
        """Index of the beam of each value, shape (N,)."""
        return np.repeat(np.arange(len(self.echoes)), self.echoes)

    @property
    def angle_rad(self) -> NDArray[np.float64]:
        """Angle of each value, shape (N,)."""
        first, _, increment = self.limits[:3]
        return np.asarray(first + self.beam * float(increment))

    def cloud(self, *, with_echo: bool) -> Cloud:
        """Return the cloud: one point for each value, NaN where there is no return."""
        beam, angle = self.beam, self.angle_rad
        layout = list((_POINT if len(self.intensities) else _PLAIN).descr) + [_ECHO] * with_echo
        points = np.zeros(len(self.ranges), layout)
        with np.errstate(invalid="ignore", over="ignore"):
            range_m = np.where(self.is_return, self.ranges.astype(np.float64), np.nan)
            points["x"], points["y"] = range_m * np.cos(angle), range_m * np.sin(angle)
        points["z"] = np.where(self.is_return, 0, np.nan)
        points["index"] = beam
        if len(self.intensities):
            points["intensity"] = self.intensities
        if with_echo:
            starts = np.cumsum(self.echoes) - self.echoes
            points["echo"] = np.arange(len(beam)) - starts[beam]
        cloud = from_array(points, stamp_ns=self.header.stamp_ns, frame_id=self.header.frame_id)
        return replace(cloud, extra=self)

    def kept(self, cloud: Cloud, *, with_echo: bool) -> NDArray[np.bool_]:
        """Return which values remain, shape (N,): those of the cloud's points, and those that are no returns."""
        points = cloud.points
        names = ("index", "echo") if with_echo else ("index",)
        if not set(names) <= set(points.dtype.names or ()):
            raise CloudError(f"a scan needs points with {' and '.join(names)}")
        kept = ~self.is_return
        starts = np.cumsum(self.echoes) - self.echoes
        at = starts[points["index"]] + (points["echo"] if with_echo else 0)
        kept[at[np.isfinite(points["x"])]] = True
        return kept


class LaserScan(RosCodec):
    """Codec for scans with one echo; the ranges of removed points are written as NaN (REP 117)."""

    def _read(self, read: Reader) -> Cloud:
        header, numbers = read.header(), read.numbers("fffffff")
        ranges, intensities = read.floats(), read.floats()
        _check(len(ranges), len(intensities))
        return Scan(header, numbers, ranges, intensities, np.ones(len(ranges), np.int64)).cloud(with_echo=False)

    def _write(self, write: Writer, cloud: Cloud) -> None:
        scan = _scan_of(cloud)
        write.header(scan.header)
        write.numbers("fffffff", scan.limits)
        write.floats(np.where(scan.kept(cloud, with_echo=False), scan.ranges, np.float32(np.nan)))
        write.floats(scan.intensities)


class MultiEchoLaserScan(RosCodec):
    """Codec for scans with several echoes a beam; removed ones are left out of the lists of their beams."""

    def _read(self, read: Reader) -> Cloud:
        header, numbers = read.header(), read.numbers("fffffff")
        ranges, echoes = _lists(read)
        intensities, again = _lists(read)
        if len(again) and not np.array_equal(echoes, again):
            raise CloudError("the echoes of ranges and intensities differ in number")
        _check(len(ranges), len(intensities))
        return Scan(header, numbers, ranges, intensities, echoes, len(again)).cloud(with_echo=True)

    def _write(self, write: Writer, cloud: Cloud) -> None:
        scan = _scan_of(cloud)
        kept = scan.kept(cloud, with_echo=True)
        write.header(scan.header)
        write.numbers("fffffff", scan.limits)
        ends = np.cumsum(scan.echoes)
        for values, lists in ((scan.ranges, len(scan.echoes)), (scan.intensities, scan.intensity_lists)):
            write.number("I", lists)
            for start, end in zip((ends - scan.echoes)[:lists], ends[:lists], strict=True):
                write.floats(values[start:end][kept[start:end]] if len(values) else values)


def _lists(read: Reader) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return the values of all lists of a message, one after another, and the length of each list."""
    number = read.length(read.left // 4, "beam")
    lists = [read.floats() for _ in range(number)]
    echoes = np.array([len(values) for values in lists], np.int64)
    return np.concatenate(lists).astype("<f4") if lists else np.zeros(0, np.float32), echoes


def _check(ranges: int, intensities: int) -> None:
    if intensities not in (0, ranges):
        raise CloudError(f"the scan has {count(ranges, 'range')}, but {intensities:,} intensities")
    if ranges * _POINT.itemsize > limits().message_bytes:
        raise CloudError(f"the points occupy {above(count(ranges * _POINT.itemsize, 'byte'), 'message_mib')}")


def _scan_of(cloud: Cloud) -> Scan:
    if not isinstance(cloud.extra, Scan):
        raise CloudError("only the points of a scan can be written as a scan")
    return cloud.extra
