"""Codec for ``CustomMsg`` of Livox's ROS drivers (``livox_ros_driver`` and ``livox_ros_driver2``)."""

from dataclasses import dataclass

import numpy as np

from seaclutter_cli.cloud import Cloud, PointField, point_dtype
from seaclutter_cli.errors import CloudError
from seaclutter_cli.messages.serialisation import Header, Reader, RosCodec, Writer

_FIELDS = (
    PointField("offset_time", 0, "u4"),
    *(PointField(axis, 4 + 4 * number, "f4") for number, axis in enumerate("xyz")),
    *(PointField(name, 16 + number, "u1") for number, name in enumerate(("reflectivity", "tag", "line"))),
)
_PACKED, _ALIGNED = 19, 20
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
        number, step = read.number("I"), self._step
        data = read.structures(number, _PACKED, step)
        shape, size = (1, number), number * step
        return Cloud(header.stamp_ns, header.frame_id, *shape, _FIELDS, step, size, read.big_endian, True, data, extra)

    def _write(self, write: Writer, cloud: Cloud) -> None:
        extra = cloud.extra
        names = [field.name for field in _FIELDS]
        if not isinstance(extra, _CustomHeader) or not set(names) <= {field.name for field in cloud.fields}:
            raise CloudError("only the points of a Livox message can be written as one")
        points = np.zeros(cloud.size, point_dtype(_FIELDS, self._step, big_endian=False))
        for name in names:
            points[name] = cloud.points[name]
        write.header(extra.header)
        write.numbers("QI", (extra.timebase_ns, cloud.size))
        write.numbers("B" + _RESERVED, (extra.lidar_id, *extra.reserved))
        write.number("I", cloud.size)
        write.raw(points.tobytes()[: max(cloud.size * self._step - (self._step - _PACKED), 0)])

    @property
    def _step(self) -> int:
        return _PACKED if self._ros == 1 else _ALIGNED
