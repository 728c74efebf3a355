"""Codec for ``foxglove_msgs/PointCloud`` in ROS 1 and ROS 2 serialisation."""

from seaclutter_cli.cloud import Cloud, PointField
from seaclutter_cli.messages.foxglove import TYPES, field_type, unorganised
from seaclutter_cli.messages.serialisation import Reader, RosCodec, Writer

_MAX_FIELDS = 1024
_POSE = "ddddddd"


class RosFoxglovePointCloud(RosCodec):
    """Codec for Foxglove's cloud as a ROS message; ``Cloud.extra`` contains position and orientation of its pose."""

    def _read(self, read: Reader) -> Cloud:
        stamp_ns, frame_id, pose = read.time_ns(), read.text(), read.numbers(_POSE)
        stride = read.number("I")
        fields = tuple(_field(read) for _ in range(read.length(_MAX_FIELDS, "field")))
        return unorganised(stamp_ns, frame_id, stride, fields, read.blob(), pose)

    def _write(self, write: Writer, cloud: Cloud) -> None:
        write.time_ns(cloud.stamp_ns)
        write.text(cloud.frame_id)
        write.numbers(_POSE, cloud.extra or (0, 0, 0, 0, 0, 0, 1))
        write.number("I", cloud.point_step)
        write.number("I", len(cloud.fields))
        for field in cloud.fields:
            write.text(field.name)
            write.number("I", field.offset)
            write.number("B", TYPES.index(field.type) + 1)
        write.blob(cloud.data)


def _field(read: Reader) -> PointField:
    name, offset, kind = read.text(), read.number("I"), read.number("B")
    return PointField(name, offset, field_type(kind, name))
