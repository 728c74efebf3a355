"""Simulated recordings at sea or on land: frames rendered in several threads and written in order."""

import json
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from seaclutter_cli import __version__
from seaclutter_cli.arrays import Floats, Ints, Rows
from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import UsageError
from seaclutter_cli.records import Metadata
from seaclutter_cli.sensors.robosense.models import BLOCKS, CHANNELS, MODELS
from seaclutter_cli.sensors.robosense.packets import DATA_PORT, INFO_PORT, Angles, Columns, write_data, write_info
from seaclutter_cli.simulation.lidar import LIDARS, Echoes, Lidar, Receiver, Shots, extinction
from seaclutter_cli.simulation.marine.bodies import Bodies, PlacedBody, add_body_echoes
from seaclutter_cli.simulation.marine.motion import Pose, Ride
from seaclutter_cli.simulation.marine.scene import Scene
from seaclutter_cli.simulation.marine.shapes import SHAPES
from seaclutter_cli.simulation.marine.terrain import Ground, GroundParams, SeaTerrain, Terrain
from seaclutter_cli.simulation.marine.wide import WideSea, WideWater
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.sinks.point_files import write_mcap
from seaclutter_cli.threads import in_order, threads
from seaclutter_cli.truth import IGNORED, Boxes

_DARK_REFLECTIVITY = 0.3


@dataclass(frozen=True)
class SimulatedFrame:
    """One frame of a simulated recording.

    ``points``, shape (N,), are `POINT` in firing order, in the frame of the lidar, with times in seconds from the start
    of the recording. ``shots`` are the column times the number of beams, plus the beam of each, ``distances_m`` its
    measured distance from the lens. ``boxes`` are own ship and every object within range of the lidar; of class
    ``ignore`` if it is not a target.
    """

    index: int
    points: Rows
    shots: Ints
    distances_m: Floats
    boxes: Boxes


class Renderer:
    """Renderer of the frames of a scene, which are independent and can be rendered in any order."""

    def __init__(self, scene: Scene) -> None:
        recording, vessel = scene.recording, scene.vessel
        self.scene, self.lidar, self._seed = scene, scene.lidar, recording.seed
        self._bodies = Bodies(scene.objects)
        self._own = SHAPES["own_vessel"].scaled(vessel.length_m, vessel.width_m, vessel.lidar_height_m * 0.7)
        hulls = [(vessel.track, vessel.length_m, vessel.width_m)] if vessel.speed_ms else []
        moving = [item for item in scene.objects if item.speed_ms and item.shape != "bird"]
        hulls += [(item.track, item.size_m[0], item.size_m[1]) for item in moving]
        self._terrain = _terrain(scene, hulls)
        mast = np.array([vessel.lidar_forward_m, 0.0, vessel.lidar_height_m])
        places, rocking = vessel.track.at, None
        noise, near_m, response = scene.noise or self.lidar.noise, self.lidar.min_range_m, (0.0, 1.0)
        loss = extinction(scene.terrain.visibility_km)
        if isinstance(self._terrain, WideSea):
            physics, places, rocking = self._terrain.physics, vessel.track.smooth_at, self._terrain.rocking
            loss, near_m = self._terrain.weather.extinction, max(near_m, self._terrain.near_m)
            response = physics.intensity_offset, physics.intensity_exponent
        self._ride = Ride(places, self._terrain.motion, vessel.wave_response, mast, rocking)
        self._receiver = Receiver(self.lidar, noise, loss, recording.dropout, near_m, response)

    def frame(self, index: int) -> SimulatedFrame:
        """Return a frame by its number."""
        rng = np.random.default_rng([self._seed, 1, index])
        start_s = index / self.lidar.rate_hz
        moment = self._terrain.at(start_s + 0.5 / self.lidar.rate_hz)
        times_s = start_s + self.lidar.times_s
        shots = self._shots(*self._ride.interpolate(times_s[:, 0]))
        placed = self._bodies.locate(moment, self._ride, self.lidar, start_s)

        echoes = Echoes.empty(len(shots))
        moment.add_echoes(shots, echoes, rng)
        lidar = self._ride.lidar(start_s)
        hull = Pose(lidar.position - lidar.rotation @ self._ride.mast, lidar.rotation)
        own = PlacedBody(self._own, _DARK_REFLECTIVITY, IGNORED, hull, lidar, -np.inf)
        own.add_echoes(shots, echoes, np.arange(len(shots)))
        add_body_echoes(shots, echoes, placed)
        if isinstance(moment, WideWater):
            moment.add_effects(shots, echoes, placed, rng)
        return SimulatedFrame(index, *self._receiver.receive(echoes, times_s, rng), self._boxes(placed, own))

    def _shots(self, positions: Floats, rotation: Floats) -> Shots:
        beams = len(self.lidar.elevations_deg)
        directions = (self.lidar.directions @ rotation.transpose(0, 2, 1)).reshape(-1, 3)
        azimuths = np.arctan2(directions[:, 1], directions[:, 0])
        origins = (self.lidar.lenses @ rotation.transpose(0, 2, 1)).reshape(-1, 3) + np.repeat(positions, beams, axis=0)
        return Shots(origins, directions, azimuths)

    def _boxes(self, placed: list[PlacedBody], own: PlacedBody) -> Boxes:
        """Return the boxes of all objects within range; own ship and the ground are areas to ignore."""
        reach_m = self.lidar.max_range_m
        rows = [(IGNORED, "ignore", *own.box())]
        if isinstance(self._terrain, Ground):
            rows.append((IGNORED, "ignore", *self._terrain.box(own.lidar, reach_m)))
        for item, one in zip(self.scene.objects, placed, strict=True):
            center, size, yaw = one.box()
            if np.hypot(center[0], center[1]) - np.hypot(size[0], size[1]) / 2 <= reach_m:
                kind = "ignore" if item.ignore else item.class_name or item.shape
                rows.append((item.track_id, kind, center, size, yaw))
        tracks, kinds, centers, sizes, yaws = zip(*rows, strict=True)
        return Boxes(tuple(str(track) for track in tracks), kinds, np.array(centers), np.array(sizes), np.array(yaws))


def _terrain(scene: Scene, hulls: Sequence[Any]) -> Terrain:
    """Return the sea or the ground of a scene; hulls that leave a wake come with their path, length and width."""
    params, seed = scene.terrain, scene.recording.seed
    if isinstance(params, GroundParams):
        return Ground(params, seed)
    if scene.physics:
        return WideSea(scene, scene.physics, params, hulls)
    return SeaTerrain(params, hulls, scene.vessel.length_m, seed)


_MAGIC_NS = 0xA1B23C4D
_ETHERNET, _SNAP = 1, 262144
_DONT_FRAGMENT = 0x4000
_SOURCE, _TARGET = bytes((192, 168, 1, 200)), bytes((192, 168, 1, 102))


def pcap_header() -> bytes:
    """Return the file header of a capture with nanosecond timestamps."""
    return struct.pack("<IHHiIII", _MAGIC_NS, 2, 4, 0, 0, _SNAP, _ETHERNET)


def pcap_record(time_ns: int, packet: bytes) -> bytes:
    """Return the record of a packet with its Unix time in nanoseconds."""
    return struct.pack("<IIII", *divmod(time_ns, 10**9), len(packet), len(packet)) + packet


def ethernet_udp(port: int, payload: bytes) -> bytes:
    """Return an Ethernet frame with a payload in a UDP packet over IPv4, from a port of a lidar to the same one."""
    udp = struct.pack(">HHHH", port, port, 8 + len(payload), 0) + payload
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, _DONT_FRAGMENT, 64, 17, 0) + _SOURCE + _TARGET
    checksum: int = -sum(struct.unpack(">10H", head)) % 0xFFFF
    head = head[:10] + checksum.to_bytes(2, "big") + head[12:]
    return b"\x02\x00\x00\x00\x00\x01\x02\x00\x00\x00\x00\x02\x08\x00" + head + udp


START_NS = 1_700_000_000 * 10**9
"""Start of every simulated recording, in nanoseconds of Unix time."""

_COLUMNS = ("frame", "track_id", "class", "x", "y", "z", "length", "width", "height", "yaw")


def _write_log(scene: Scene, stream: BinaryIO, frames: Iterable[SimulatedFrame]) -> None:
    """Write PointCloud2 messages, stamped with the end of a frame, to an MCAP file with the scene."""
    period_ns = round(10**9 / scene.lidar.rate_hz)
    entries = {"version": __version__, "scene": json.dumps(scene.as_dict())}

    def cloud(frame: SimulatedFrame) -> Cloud:
        points = frame.points.copy()
        points["timestamp"] += START_NS / 10**9
        return from_array(points, stamp_ns=START_NS + (frame.index + 1) * period_ns)

    write_mcap(stream, map(cloud, frames), Metadata("scene", entries))


def _write_capture(scene: Scene, stream: BinaryIO, frames: Iterable[SimulatedFrame]) -> None:
    """Write packets of a RoboSense lidar, with its angles, to a PCAP file, which has no labels."""
    name, lidar = scene.recording.lidar, scene.lidar
    if name not in MODELS:
        known = ", ".join(name for name in LIDARS if name in MODELS)
        raise UsageError(f"pcap: cannot write packets of {name}; choose one of {known}, or write an .mcap file")
    degrees = np.array((lidar.elevations_deg, lidar.azimuth_offsets_deg))
    info = write_info(MODELS[name], Angles(*np.round(100 * degrees).astype(np.int64))).tobytes()
    stream.write(pcap_header())
    for frame in frames:
        columns = _columns(lidar, frame)
        stream.write(pcap_record(int(columns.times_ns[0]), ethernet_udp(INFO_PORT, info)))
        arrivals = (columns.times_ns + MODELS[name].packet_ns).tolist()
        payloads = (ethernet_udp(DATA_PORT, payload.tobytes()) for payload in write_data(MODELS[name], columns))
        stream.writelines(map(pcap_record, arrivals, payloads))


def _columns(lidar: Lidar, frame: SimulatedFrame) -> Columns:
    shots = lidar.columns * len(lidar.rings)
    distance, intensity = np.zeros(shots), np.zeros(shots, np.uint8)
    distance[frame.shots], intensity[frame.shots] = frame.distances_m, frame.points["intensity"]
    blocks = np.arange(shots // CHANNELS)
    packets = blocks[::BLOCKS] / len(blocks) + frame.index
    azimuth = np.round(36000 * blocks / len(blocks)).astype(np.int64)
    times_ns = START_NS + np.round(packets * 10**9 / lidar.rate_hz).astype(np.int64)
    return Columns(azimuth, distance.reshape(-1, CHANNELS), intensity.reshape(-1, CHANNELS), times_ns)


FORMATS: Mapping[str, Callable[[Scene, BinaryIO, Iterable[SimulatedFrame]], None]] = {
    "mcap": _write_log,
    "pcap": _write_capture,
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

    def frames() -> Iterator[SimulatedFrame]:
        for frame in simulate_frames(scene):
            yield frame
            boxes = frame.boxes
            rows = zip(boxes.tracks, boxes.classes, boxes.centers, boxes.sizes, boxes.yaws, strict=True)
            for track, kind, center, size, yaw in rows:
                numbers = (f"{value:.3f}" for value in (*center, *size))
                label_file.stream.write(csv_line((frame.index, track, kind, *numbers, f"{yaw:.4f}")))
            on_frame(frame)

    with OutputGroup(group) as files, AtomicFile(log, files) as log_file, AtomicFile(labels, files) as label_file:
        label_file.stream.write(csv_line(_COLUMNS))
        FORMATS[log.suffix[1:]](scene, log_file.stream, frames())
