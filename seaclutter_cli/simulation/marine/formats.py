"""Files that simulated recordings go to."""

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
from seaclutter_cli.sensors.robosense.angles import Angles, make_angles
from seaclutter_cli.sensors.robosense.models import BLOCKS, CHANNELS, MODELS
from seaclutter_cli.sensors.robosense.packets import DATA_PORT, INFO_PORT, Columns, write_data, write_info
from seaclutter_cli.simulation.lidar.models import LIDARS, Lidar
from seaclutter_cli.simulation.marine.render import SimulatedFrame
from seaclutter_cli.simulation.marine.scene import Scene
from seaclutter_cli.sinks.mcap_writer import McapWriter
from seaclutter_cli.sinks.pcap import Endpoints, ethernet_udp, pcap_header, pcap_record

START_NS = 1_700_000_000 * 10**9
"""When every simulated recording begins, in nanoseconds of Unix time."""

_TYPE = "sensor_msgs/msg/PointCloud2"


class Log(Protocol):
    """A file that turns are written to."""

    def add(self, turn: SimulatedFrame) -> None:
        """Write a turn."""
        ...

    def finish(self) -> None:
        """Write what is left."""
        ...

    def abort(self) -> None:
        """Free what is held; the file stays incomplete."""
        ...


class McapLog:
    """PointCloud2 messages in an MCAP file, with the scene as metadata.

    Parameters
    ----------
    scene : Scene
        What is recorded.
    stream : BinaryIO
        Where it goes.
    """

    def __init__(self, scene: Scene, stream: BinaryIO) -> None:
        self._period_ns = round(10**9 / LIDARS[scene.recording.lidar].rate_hz)
        self._writer = McapWriter(stream, profile="ros2", library=f"seaclutter {__version__}", compression="zstd")
        entries = {"version": __version__, "scene": json.dumps(scene.as_dict())}
        self._writer.add_metadata(Metadata("scene", entries))
        self._writer.add_channel(Channel(1, "/points", "cdr", ros2_schema(_TYPE)))

    def add(self, turn: SimulatedFrame) -> None:
        """Write a turn; its stamp is that of its end, as drivers have it."""
        stamp_ns = START_NS + (turn.index + 1) * self._period_ns
        points = turn.points.copy()
        points["timestamp"] += START_NS / 10**9
        message = CODECS[_TYPE, "cdr"].encode(from_array(points, stamp_ns=stamp_ns))
        self._writer.write(1, stamp_ns, stamp_ns, turn.index, message)

    def finish(self) -> None:
        """Write the summary."""
        self._writer.finish()

    def abort(self) -> None:
        """Stop the threads that compress."""
        self._writer.abort()


class CaptureLog:
    """Packets of a RoboSense lidar in a PCAP file, with its angles; they hold no labels.

    Parameters
    ----------
    scene : Scene
        What is recorded.
    stream : BinaryIO
        Where it goes.

    Raises
    ------
    UsageError
        If the lidar is none of RoboSense.
    """

    def __init__(self, scene: Scene, stream: BinaryIO) -> None:
        name = scene.recording.lidar
        if name not in MODELS:
            known = ", ".join(name for name in LIDARS if name in MODELS)
            raise UsageError(f"packets of {name} cannot be written; those of {known} can")
        self._lidar, self._model, self._stream = LIDARS[name], MODELS[name], stream
        self._info = write_info(self._model, _angles(self._lidar)).tobytes()
        self._stream.write(pcap_header())

    def add(self, turn: SimulatedFrame) -> None:
        """Write a turn: its device information, then its data."""
        columns = self._columns(turn)
        ends, info = (
            Endpoints(source_port=DATA_PORT, target_port=DATA_PORT),
            Endpoints(source_port=INFO_PORT, target_port=INFO_PORT),
        )
        self._stream.write(pcap_record(int(columns.times_ns[0]), ethernet_udp(info, self._info)))
        arrivals = (columns.times_ns + self._model.packet_ns).tolist()
        for time_ns, payload in zip(arrivals, write_data(self._model, columns), strict=True):
            self._stream.write(pcap_record(time_ns, ethernet_udp(ends, payload.tobytes())))

    def _columns(self, turn: SimulatedFrame) -> Columns:
        shots = self._lidar.columns * len(self._lidar.rings)
        distance, intensity = np.zeros(shots), np.zeros(shots, np.uint8)
        distance[turn.shots], intensity[turn.shots] = turn.distances_m, turn.points["intensity"]
        blocks = np.arange(shots // CHANNELS)
        packets = blocks[::BLOCKS] / len(blocks) + turn.index
        return Columns(
            np.round(36000 * blocks / len(blocks)).astype(np.int64),
            distance.reshape(-1, CHANNELS),
            intensity.reshape(-1, CHANNELS),
            START_NS + np.round(packets * 10**9 / self._lidar.rate_hz).astype(np.int64),
        )

    def finish(self) -> None:
        """Have nothing left to write."""

    def abort(self) -> None:
        """Hold nothing."""


def _angles(lidar: Lidar) -> Angles | None:
    vertical, horizontal = (
        np.round(100 * np.array(degrees)).astype(np.int64)
        for degrees in (lidar.elevations_deg, lidar.azimuth_offsets_deg)
    )
    return make_angles(vertical, horizontal)


FORMATS: Mapping[str, type[McapLog | CaptureLog]] = {"mcap": McapLog, "pcap": CaptureLog}
"""Forms of simulated recordings by the ending of their files; a new one is a line here."""
