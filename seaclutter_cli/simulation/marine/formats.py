"""File formats of simulated recordings."""

import json
from collections.abc import Mapping
from typing import BinaryIO, Protocol

import numpy as np

from seaclutter_cli import __version__
from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import UsageError
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Channel, Metadata
from seaclutter_cli.sensors.robosense.device import Angles
from seaclutter_cli.sensors.robosense.models import BLOCKS, CHANNELS, MODELS
from seaclutter_cli.sensors.robosense.packets import DATA_PORT, INFO_PORT, Columns, write_data, write_info
from seaclutter_cli.simulation.lidar.models import LIDARS, Lidar
from seaclutter_cli.simulation.marine.render import SimulatedFrame
from seaclutter_cli.simulation.marine.scene import Scene
from seaclutter_cli.sinks.mcap_writer import McapWriter
from seaclutter_cli.sinks.pcap import Endpoints, ethernet_udp, pcap_header, pcap_record

START_NS = 1_700_000_000 * 10**9
"""Start of every simulated recording, in nanoseconds of Unix time."""

_TYPE = "sensor_msgs/msg/PointCloud2"


class LogWriter(Protocol):
    """Writer of a simulated recording."""

    def add(self, frame: SimulatedFrame) -> None:
        """Write a frame."""
        ...

    def finish(self) -> None:
        """Complete the file."""
        ...

    def abort(self) -> None:
        """Free resources and leave the file incomplete."""
        ...


class McapLog:
    """Writer of PointCloud2 messages to an MCAP file, with the scene as metadata.

    Parameters
    ----------
    scene : Scene
        The recorded scene.
    stream : BinaryIO
        Receives the file.
    """

    def __init__(self, scene: Scene, stream: BinaryIO) -> None:
        self._period_ns = round(10**9 / LIDARS[scene.recording.lidar].rate_hz)
        self._writer = McapWriter(stream, profile="ros2", library=f"seaclutter {__version__}", compression="zstd")
        entries = {"version": __version__, "scene": json.dumps(scene.as_dict())}
        self._writer.add_metadata(Metadata("scene", entries))
        self._writer.add_channel(Channel(1, "/points", "cdr", ros2_schema(_TYPE)))

    def add(self, frame: SimulatedFrame) -> None:
        """Write a frame, stamped with the time of its end, as drivers do."""
        stamp_ns = START_NS + (frame.index + 1) * self._period_ns
        points = frame.points.copy()
        points["timestamp"] += START_NS / 10**9
        message = CODECS[_TYPE, "cdr"].encode(from_array(points, stamp_ns=stamp_ns))
        self._writer.write(1, stamp_ns, stamp_ns, frame.index, message)

    def finish(self) -> None:
        """Write the summary."""
        self._writer.finish()

    def abort(self) -> None:
        """Stop the compression threads."""
        self._writer.abort()


class CaptureLog:
    """Writer of packets of a RoboSense lidar, with its angles, to a PCAP file, which has no labels.

    Parameters
    ----------
    scene : Scene
        The recorded scene.
    stream : BinaryIO
        Receives the file.

    Raises
    ------
    UsageError
        If the lidar is not from RoboSense.
    """

    def __init__(self, scene: Scene, stream: BinaryIO) -> None:
        name = scene.recording.lidar
        if name not in MODELS:
            known = ", ".join(name for name in LIDARS if name in MODELS)
            raise UsageError(f"pcap: cannot write packets of {name}; choose one of {known}, or write an .mcap file")
        self._lidar, self._model, self._stream = LIDARS[name], MODELS[name], stream
        self._info = write_info(self._model, _angles(self._lidar)).tobytes()
        self._stream.write(pcap_header())

    def add(self, frame: SimulatedFrame) -> None:
        """Write a frame: device information, then data."""
        columns = self._columns(frame)
        ends, info = (
            Endpoints(source_port=DATA_PORT, target_port=DATA_PORT),
            Endpoints(source_port=INFO_PORT, target_port=INFO_PORT),
        )
        self._stream.write(pcap_record(int(columns.times_ns[0]), ethernet_udp(info, self._info)))
        arrivals = (columns.times_ns + self._model.packet_ns).tolist()
        for time_ns, payload in zip(arrivals, write_data(self._model, columns), strict=True):
            self._stream.write(pcap_record(time_ns, ethernet_udp(ends, payload.tobytes())))

    def _columns(self, frame: SimulatedFrame) -> Columns:
        shots = self._lidar.columns * len(self._lidar.rings)
        distance, intensity = np.zeros(shots), np.zeros(shots, np.uint8)
        distance[frame.shots], intensity[frame.shots] = frame.distances_m, frame.points["intensity"]
        blocks = np.arange(shots // CHANNELS)
        packets = blocks[::BLOCKS] / len(blocks) + frame.index
        return Columns(
            np.round(36000 * blocks / len(blocks)).astype(np.int64),
            distance.reshape(-1, CHANNELS),
            intensity.reshape(-1, CHANNELS),
            START_NS + np.round(packets * 10**9 / self._lidar.rate_hz).astype(np.int64),
        )

    def finish(self) -> None:
        """Do nothing: all packets are already written."""

    def abort(self) -> None:
        """Do nothing: there are no resources to free."""


def _angles(lidar: Lidar) -> Angles:
    vertical, horizontal = (
        np.round(100 * np.array(degrees)).astype(np.int64)
        for degrees in (lidar.elevations_deg, lidar.azimuth_offsets_deg)
    )
    return Angles(vertical, horizontal)


FORMATS: Mapping[str, type[McapLog | CaptureLog]] = {"mcap": McapLog, "pcap": CaptureLog}
"""Writers of simulated recordings by file extension; to add a format, add a line here."""
