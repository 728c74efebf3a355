"""A message with points that only its makers know: a time, and x, y, z and intensity of each point."""

import numpy as np

from seaclutter.plugins import Cloud, CloudError, from_array

POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])
HEAD = np.dtype([("time_ns", "<i8"), ("points", "<u4")])


class ExampleCloud:
    """Decodes and encodes the message."""

    messages = (("example.Cloud", "example"),)

    def decode(self, data: bytes | memoryview) -> Cloud:
        """Return the points of a message."""
        if len(data) < HEAD.itemsize:
            raise CloudError(f"{len(data)} bytes are less than a head")
        head = np.frombuffer(data, HEAD, 1)[0]
        if len(data) != HEAD.itemsize + int(head["points"]) * POINT.itemsize:
            raise CloudError(f"{len(data)} bytes do not fit {head['points']} points")
        points = np.frombuffer(data, POINT, offset=HEAD.itemsize)
        return from_array(points, stamp_ns=int(head["time_ns"]), frame_id="lidar")

    def encode(self, cloud: Cloud) -> bytes:
        """Return a cloud as a message."""
        points = np.zeros(cloud.size, POINT)
        for name in POINT.names or ():
            points[name] = cloud.points[name]
        return np.array([(cloud.stamp_ns, cloud.size)], HEAD).tobytes() + points.tobytes()
