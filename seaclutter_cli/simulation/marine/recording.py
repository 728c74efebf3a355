"""Simulated recordings: frames rendered in several threads and written in order."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from seaclutter_cli import __version__
from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import UsageError
from seaclutter_cli.records import Metadata
from seaclutter_cli.sensors.robosense.models import BLOCKS, CHANNELS, MODELS
from seaclutter_cli.sensors.robosense.packets import DATA_PORT, INFO_PORT, Angles, Columns, write_data, write_info
from seaclutter_cli.simulation.lidar.models import LIDARS, Lidar
from seaclutter_cli.simulation.marine.render import Renderer, SimulatedFrame
from seaclutter_cli.simulation.marine.scene import Scene
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.sinks.pcap import Endpoints, ethernet_udp, pcap_header, pcap_record
from seaclutter_cli.sinks.point_files import cloud_log
from seaclutter_cli.threads import in_order, threads

START_NS = 1_700_000_000 * 10**9
"""Start of every simulated recording, in nanoseconds of Unix time."""

_COLUMNS = ("frame", "track_id", "class", "x", "y", "z", "length", "width", "height", "yaw")
_Write = Callable[[SimulatedFrame], None]


@contextmanager
def _mcap_log(scene: Scene, stream: BinaryIO) -> Iterator[_Write]:
    """Yield a writer of PointCloud2 messages to an MCAP file, with the scene as metadata.

    Frames are stamped with the time of their end, as drivers do.
    """
    period_ns = round(10**9 / scene.lidar.rate_hz)
    entries = {"version": __version__, "scene": json.dumps(scene.as_dict())}
    with cloud_log(stream, Metadata("scene", entries)) as write:

        def add(frame: SimulatedFrame) -> None:
            points = frame.points.copy()
            points["timestamp"] += START_NS / 10**9
            write(frame.index, from_array(points, stamp_ns=START_NS + (frame.index + 1) * period_ns))

        yield add


@contextmanager
def _capture(scene: Scene, stream: BinaryIO) -> Iterator[_Write]:
    """Yield a writer of packets of a RoboSense lidar, with its angles, to a PCAP file, which has no labels."""
    name, lidar = scene.recording.lidar, scene.lidar
    if name not in MODELS:
        known = ", ".join(name for name in LIDARS if name in MODELS)
        raise UsageError(f"pcap: cannot write packets of {name}; choose one of {known}, or write an .mcap file")
    degrees = np.array((lidar.elevations_deg, lidar.azimuth_offsets_deg))
    info = write_info(MODELS[name], Angles(*np.round(100 * degrees).astype(np.int64))).tobytes()
    stream.write(pcap_header())
    ends, info_ends = (Endpoints(source_port=port, target_port=port) for port in (DATA_PORT, INFO_PORT))

    def add(frame: SimulatedFrame) -> None:
        columns = _columns(lidar, frame)
        stream.write(pcap_record(int(columns.times_ns[0]), ethernet_udp(info_ends, info)))
        arrivals = (columns.times_ns + MODELS[name].packet_ns).tolist()
        payloads = (ethernet_udp(ends, payload.tobytes()) for payload in write_data(MODELS[name], columns))
        stream.writelines(map(pcap_record, arrivals, payloads))

    yield add


def _columns(lidar: Lidar, frame: SimulatedFrame) -> Columns:
    """Return the content of the data packets of a frame."""
    shots = lidar.columns * len(lidar.rings)
    distance, intensity = np.zeros(shots), np.zeros(shots, np.uint8)
    distance[frame.shots], intensity[frame.shots] = frame.distances_m, frame.points["intensity"]
    blocks = np.arange(shots // CHANNELS)
    packets = blocks[::BLOCKS] / len(blocks) + frame.index
    return Columns(
        np.round(36000 * blocks / len(blocks)).astype(np.int64),
        distance.reshape(-1, CHANNELS),
        intensity.reshape(-1, CHANNELS),
        START_NS + np.round(packets * 10**9 / lidar.rate_hz).astype(np.int64),
    )


FORMATS: Mapping[str, Callable[[Scene, BinaryIO], AbstractContextManager[_Write]]] = {
    "mcap": _mcap_log,
    "pcap": _capture,
}
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

    The files appear together, and with those of the group, when they are complete. Raise `OutputError` if a file cannot
    be written, `UsageError` if the format does not support the lidar.
    """
    with (
        OutputGroup(group) as files,
        AtomicFile(log, files) as log_file,
        AtomicFile(labels, files) as label_file,
        FORMATS[log.suffix[1:]](scene, log_file.stream) as write,
    ):
        label_file.stream.write(csv_line(_COLUMNS))
        for frame in simulate_frames(scene):
            write(frame)
            label_file.stream.writelines(_rows(frame))
            on_frame(frame)


def _rows(frame: SimulatedFrame) -> Iterator[bytes]:
    """Yield the CSV lines of a frame's labels."""
    boxes = frame.boxes
    for track, kind, center, size, yaw in zip(
        boxes.tracks, boxes.classes, boxes.centers, boxes.sizes, boxes.yaws, strict=True
    ):
        numbers = (f"{value:.3f}" for value in (*center, *size))
        yield csv_line((frame.index, track, kind, *numbers, f"{yaw:.4f}"))
