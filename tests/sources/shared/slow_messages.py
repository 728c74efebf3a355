"""Slow writer and reader of packet messages, field by field from their definitions, with struct alone."""

import struct

HEADER = [("seq", "seq"), ("stamp", "time"), ("frame_id", "string")]
COUNTED, FIXED = [("data", "bytes")], [("stamp", "time"), ("data", 1248)]
SDK = [*HEADER, ("is_difop", "byte"), ("is_frame_begin", "byte"), *COUNTED]
SINGLE = {
    "rslidar_msg/msg/RslidarPacket": SDK,
    "rslidar_msgs/msg/rslidarPacket": FIXED,
    "ouster_ros/msg/PacketMsg": COUNTED,
    "ouster_sensor_msgs/msg/PacketMsg": COUNTED,
}
"""Fields of messages with one packet; ``seq`` is only in ROS 1."""


class Form:
    """An encoding: ROS 1, or CDR in one of two byte orders."""

    def __init__(self, *, ros1, big_endian=False):
        self.ros1, self.order = ros1, ">" if big_endian else "<"
        self.head = b"" if ros1 else bytes((0, not big_endian, 0, 0))

    def aligned(self, at):
        return at if self.ros1 else at + -at % 4

    def write(self, fields, values):
        data = bytearray()

        def number(value):
            data.extend(bytes(self.aligned(len(data)) - len(data)) + struct.pack(self.order + "I", value))

        for name, kind in fields:
            value = values.get(name, 0)
            if kind == "seq":
                if self.ros1:
                    number(value)
            elif kind == "time":
                for part in divmod(value, 10**9):
                    number(part)
            elif kind == "byte":
                data.append(value)
            elif kind == "string":
                text = value.encode() + (b"" if self.ros1 else b"\0")
                number(len(text))
                data += text
            else:
                if kind == "bytes":
                    number(len(value))
                data += value
        return self.head + bytes(data)

    def read(self, fields, message):
        """Return the values of the fields; None if the message is truncated."""
        data, at, values = message[len(self.head) :], 0, {}
        try:
            for name, kind in fields:
                if kind == "byte":
                    values[name], at = data[at], at + 1
                    continue
                if kind in ("seq", "string", "time", "bytes") and not (kind == "seq" and not self.ros1):
                    at = self.aligned(at)
                    (size,) = struct.unpack_from(self.order + "I", data, at)
                    at += 4
                if kind == "time":
                    (nanosec,) = struct.unpack_from(self.order + "I", data, at)
                    values[name], at = size * 10**9 + nanosec, at + 4
                elif kind in ("string", "bytes") or isinstance(kind, int):
                    size = kind if isinstance(kind, int) else size
                    if len(data) < at + size:
                        return None
                    values[name], at = data[at : at + size], at + size
        except (struct.error, IndexError):
            return None
        return values
