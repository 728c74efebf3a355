"""Codec for ``sensor_msgs/PointCloud2`` in ROS 2 (CDR) and ROS 1 serialisation."""

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.messages.serialisation import Header, Reader, RosCodec, Writer


class PointCloud2(RosCodec):
    """Codec for PointCloud2; ``Cloud.extra`` contains the sequence number of a ROS 1 header."""

    def _read(self, read: Reader) -> Cloud:
        header = read.header()
        height, width = read.numbers("II")
        fields = read.fields()
        big_endian = bool(read.number("B"))
        point_step, row_step = read.numbers("II")
        data = read.blob()
        dense = bool(read.number("B"))
        shape, steps = (height, width), (point_step, row_step)
        return Cloud(header.stamp_ns, header.frame_id, *shape, fields, *steps, big_endian, dense, data, header.sequence)

    def _write(self, write: Writer, cloud: Cloud) -> None:
        sequence = cloud.extra if isinstance(cloud.extra, int) else None  # of another message
        write.header(Header(cloud.stamp_ns, cloud.frame_id, sequence))
        write.numbers("II", (cloud.height, cloud.width))
        write.fields(cloud.fields)
        write.number("B", cloud.big_endian)
        write.numbers("II", (cloud.point_step, cloud.row_step))
        write.blob(cloud.data)
        write.number("B", cloud.dense)
