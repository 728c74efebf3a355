"""Simulated recordings: frames rendered in several threads and written in order."""

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from seaclutter_cli import __version__
from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import UsageError
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Channel, Metadata
from seaclutter_cli.sensors.robosense.models import BLOCKS, CHANNELS, MODELS
from seaclutter_cli.sensors.robosense.packets import DATA_PORT, INFO_PORT, Angles, Columns, write_data, write_info
from seaclutter_cli.simulation.lidar.models import LIDARS
from seaclutter_cli.simulation.marine.render import Renderer, SimulatedFrame
from seaclutter_cli.simulation.marine.scene import Scene
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.mcap_writer import McapWriter
from seaclutter_cli.sinks.pcap import Endpoints, ethernet_udp, pcap_header, pcap_record
from seaclutter_cli.threads import in_order, threads

START_NS = 1_700_000_000 * 10**9
"""Start of every simulated recording, in nanoseconds of Unix time."""

_COLUMNS = ("frame", "track_id", "class", "x", "y", "z", "length", "width", "height", "yaw")
_TYPE = "sensor_msgs/msg/PointCloud2"


class _McapLog:
    """Writer of PointCloud2 messages to an MCAP file, with the scene as metadata."""

    def __init__(self, scene: Scene, stream: BinaryIO) -> None:
        self._period_ns = round(10**9 / scene.lidar.rate_hz)
        self._writer = McapWriter(stream, profile="ros2")
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


class _CaptureLog:
    """Writer of packets of a RoboSense lidar, with its angles, to a PCAP file, which has no labels."""

    def __init__(self, scene: Scene, stream: BinaryIO) -> None:
        name = scene.recording.lidar
        if name not in MODELS:
            known = ", ".join(name for name in LIDARS if name in MODELS)
            raise UsageError(f"pcap: cannot write packets of {name}; choose one of {known}, or write an .mcap file")
        self._lidar, self._model, self._stream = scene.lidar, MODELS[name], stream
        degrees = np.array((self._lidar.elevations_deg, self._lidar.azimuth_offsets_deg))
        angles = Angles(*np.round(100 * degrees).astype(np.int64))
        self._info = write_info(self._model, angles).tobytes()
        self._stream.write(pcap_header())

    def add(self, frame: SimulatedFrame) -> None:
        """Write a frame: device information, then data."""
        shots = self._lidar.columns * len(self._lidar.rings)
        distance, intensity = np.zeros(shots), np.zeros(shots, np.uint8)
        distance[frame.shots], intensity[frame.shots] = frame.distances_m, frame.points["intensity"]
        blocks = np.arange(shots // CHANNELS)
        packets = blocks[::BLOCKS] / len(blocks) + frame.index
        columns = Columns(
            np.round(36000 * blocks / len(blocks)).astype(np.int64),
            distance.reshape(-1, CHANNELS),
            intensity.reshape(-1, CHANNELS),
            START_NS + np.round(packets * 10**9 / self._lidar.rate_hz).astype(np.int64),
        )
        ends, info = (Endpoints(source_port=port, target_port=port) for port in (DATA_PORT, INFO_PORT))
        self._stream.write(pcap_record(int(columns.times_ns[0]), ethernet_udp(info, self._info)))
        arrivals = (columns.times_ns + self._model.packet_ns).tolist()
        for time_ns, payload in zip(arrivals, write_data(self._model, columns), strict=True):
            self._stream.write(pcap_record(time_ns, ethernet_udp(ends, payload.tobytes())))

    def finish(self) -> None:
        """Do nothing: all packets are already written."""

    def abort(self) -> None:
        """Do nothing: there are no resources to free."""


FORMATS: Mapping[str, type[_McapLog | _CaptureLog]] = {"mcap": _McapLog, "pcap": _CaptureLog}
"""Writers of simulated recordings by file extension; to add a format, add a line here."""


def simulate_frames(scene: Scene) -> Iterator[SimulatedFrame]:
    """Yield the frames of a scene in order, rendered on all cores; the number of cores does not change them."""
    workers = threads()
    return in_order(Renderer(scene).frame, scene.recording.frames, workers=workers, ahead=workers + 1)


def record(
    scene: Scene,
    log: Path,
    labels: Path,
    on_frame: Callable[[SimulatedFrame], None] = lambda _: None,
    group: OutputGroup | None = None,
) -> None:
    """Write a scene to a file in one of `FORMATS`, chosen by its extension, and its labels as native CSV.

    The files appear together, and with those of the group, when they are complete.

    Raises
    ------
    OutputError
        If a file cannot be written.
    UsageError
        If the format does not support the lidar.
    """
    with OutputGroup(group) as files, AtomicFile(log, files) as log_file, AtomicFile(labels, files) as label_file:
        writer = FORMATS[log.suffix[1:]](scene, log_file.stream)
        try:
            label_file.stream.write((",".join(_COLUMNS) + "\n").encode())
            for frame in simulate_frames(scene):
                writer.add(frame)
                label_file.stream.write(_rows(frame).encode())
                on_frame(frame)
            writer.finish()
        except BaseException:
            writer.abort()
            raise


def _rows(frame: SimulatedFrame) -> str:
    """Return the CSV lines of a frame's labels."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    boxes = frame.boxes
    for track, kind, center, size, yaw in zip(
        boxes.tracks, boxes.classes, boxes.centers, boxes.sizes, boxes.yaws, strict=True
    ):
        numbers = (f"{value:.3f}" for value in (*center, *size))
        writer.writerow((frame.index, track, kind, *numbers, f"{yaw:.4f}"))
    return text.getvalue()
