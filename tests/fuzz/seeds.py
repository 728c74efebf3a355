"""Small honest inputs of every format, written by helpers of the other tests; each function writes into a folder."""

import json
import shutil
from functools import partial
from pathlib import Path

import numpy as np
from pypcd4.pypcd4 import Encoding
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_typestore

from tests import logs
from tests.airborne import tiles
from tests.labels import frames as labels
from tests.messages import wrapped
from tests.running import execute
from tests.scenes.onnx_files import model_bytes
from tests.sensors.hesai import mirrors
from tests.sensors.hesai import test_decoder as hesai
from tests.sensors.ouster import test_decoder as ouster
from tests.sources import scenarios
from tests.sources.frame_files import data_sets, writers
from tests.sources.pcap import captures
from tests.sources.shared import test_packet_topics as packet_topics

FRAMES, POINTS = 3, 60
CLOUD = "sensor_msgs/msg/PointCloud2"


def mcap(folder, layout="zstd", kind="ros2"):
    """Write a log with a cloud, IMU messages, an attachment and a metadata record."""
    logs.cloud_log(folder / "log.mcap", logs.LAYOUTS[layout], kind=kind, frames=FRAMES, points=POINTS)


def mcap_packets(folder):
    """Write a log with a topic of Velodyne packets."""
    topic = logs.Topic("/velodyne_packets", "cdr", _schema(packet_topics.VELODYNE_SCAN))
    entries = [logs.Entry(topic.name, times[0][0], packet_topics.scan(times)) for times in _velodyne_scans()]
    logs.write_log(folder / "log.mcap", [topic], entries)


def packet_topic(folder, driver, container="mcap"):
    """Write a recording with the packet topic of a driver."""
    from tests.sources.shared.driver_topics import DRIVERS, pairs, robosense_packets, write_topic

    few = robosense_packets(24, step=300) if driver.startswith("rslidar") else None
    if driver == "hesai_ros_driver":
        few = pairs(hesai.make_packets(hesai.XT32, 0.12, start=340.0)[0])
    path = write_topic(DRIVERS[driver], container, folder, few)
    if path.is_dir():
        (file,) = (file for file in path.iterdir() if file.suffix != ".yaml")
        file.rename(folder / f"log.{container}")
        shutil.rmtree(path)
    else:
        path.rename(folder / f"log.{container}")


def wrapped_clouds(folder, form):
    """Write a log with clouds in a form of `wrapped.sea_messages`."""
    wrapped.sea_log(folder / "log.mcap", form)


def _schema(kind):
    schema = packet_topics.ros2_schema(kind)
    return schema.name, schema.encoding, schema.data


def _velodyne_packets():
    from tests.sensors.velodyne.test_decoder import make_packets

    packets = make_packets(24, first=35000, step=800)
    return [(int(time), payload.tobytes()) for time, payload in zip(packets.times_ns, packets.payloads, strict=True)]


def _velodyne_scans():
    packets = _velodyne_packets()
    return [packets[at : at + 6] for at in range(0, len(packets), 6)]


def bag(folder, compression=None):
    """Write a ROS 1 bag."""
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = BagWriter(folder / "log.bag")
    writer.chunk_threshold = 3000
    if compression:
        writer.set_compression(BagWriter.CompressionFormat[compression])
    with writer:
        cloud = writer.add_connection("/points", CLOUD, typestore=store)
        imu = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for number, message in enumerate(logs.cloud_messages("ros1", FRAMES, POINTS)):
            writer.write(cloud, logs.START_NS + number * logs.PERIOD_NS, message)
            writer.write(imu, logs.START_NS + number * logs.PERIOD_NS + 1, bytes(30))


def rosbag2(folder, plugin="SQLITE3", mode="NONE"):
    """Write a rosbag2 folder."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Bag2Writer(folder / "log", version=9, storage_plugin=StoragePlugin[plugin])
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        cloud = writer.add_connection("/points", CLOUD, typestore=store)
        for number, message in enumerate(logs.cloud_messages("ros2", FRAMES, POINTS)):
            writer.write(cloud, logs.START_NS + number * logs.PERIOD_NS, message)


def _capture(folder, packets, port):
    rows = [(time, payload, port) for time, payload in packets]
    (folder / "log.pcap").write_bytes(captures.pcap(captures.frames(rows)))


def robosense(folder, *, fragments=False):
    """Write a capture of a RoboSense lidar; with ``fragments``, in IP fragments."""
    rows = captures.sensor_packets(24, step=300)
    if not fragments:
        (folder / "log.pcap").write_bytes(captures.pcap(captures.frames(rows)))
        return
    parts = [
        (time, captures.ETHERNET + part)
        for number, (time, payload, port) in enumerate(rows)
        for part in captures.fragments(captures.udp(payload, port, port), number)
    ]
    (folder / "log.pcap").write_bytes(captures.pcap(parts))


def pcapng(folder):
    """Write a capture of a RoboSense lidar as PCAPNG."""
    blocks = [captures.section(), captures.interface(resolution=9)]
    for time, packet in captures.frames(captures.sensor_packets(24, step=300)):
        blocks.append(captures.enhanced(time, packet))
    (folder / "log.pcapng").write_bytes(b"".join(blocks))


def hesai_capture(folder, kind=hesai.XT32):
    """Write a capture of a Hesai lidar."""
    packets, _ = hesai.make_packets(kind, 0.12, start=340.0)
    _capture(folder, [(int(t), p.tobytes()) for t, p in zip(packets.times_ns, packets.payloads, strict=True)], 2368)


def mirror_capture(folder):
    """Write a capture of a Hesai lidar with mirrors, and its angle correction file."""
    packets = mirrors.make_packets(16, first=74.5)
    _capture(folder, [(int(t), p.tobytes()) for t, p in zip(packets.times_ns, packets.payloads, strict=True)], 2368)
    (folder / "angles.dat").write_bytes(mirrors.correction_file())


def ruby_48_capture(folder):
    """Write a capture of a RoboSense lidar whose device information has another length than data."""
    from tests.sources.shared.driver_topics import ruby_48_packets

    _capture(folder, ruby_48_packets()[60:140], 6699)


def velodyne_capture(folder):
    """Write a capture of a Velodyne lidar."""
    _capture(folder, _velodyne_packets(), 2368)


def ouster_capture(folder, profile="RNG19_RFL8_SIG16_NIR16"):
    """Write a capture of an Ouster lidar, with its metadata beside it."""
    packets = ouster.make_packets(profile, frames=(0, 1))
    _capture(folder, [(int(t), p.tobytes()) for t, p in zip(packets.times_ns, packets.payloads, strict=True)], 7502)
    write_ouster_metadata(folder, profile)


def write_ouster_metadata(folder, profile):
    """Write the metadata of an Ouster lidar, and return the path."""
    beams = {"beam_altitude_angles": ouster.ALTITUDES, "beam_azimuth_angles": ouster.AZIMUTHS}
    beams["lidar_origin_to_beam_origin_mm"] = 15.806
    layout = {"columns_per_frame": ouster.COLUMNS, "columns_per_packet": ouster.PER_PACKET}
    layout |= {"pixels_per_column": ouster.ROWS, "column_window": [0, ouster.COLUMNS - 1], "udp_profile_lidar": profile}
    lidar = {"lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1]}
    info = {"prod_line": "OS-1-16", "prod_sn": "122201000998", "build_rev": "v3.0.1"}
    data = {"beam_intrinsics": beams, "lidar_intrinsics": lidar, "sensor_info": info, "lidar_data_format": layout}
    path = folder / "log.json"
    path.write_text(json.dumps(data))
    return path


def with_angles(folder):
    """Write a capture of a RoboSense lidar without its angles, and a file of angles."""
    rows = [row for row in captures.sensor_packets(24, step=300) if row[2] == 6699]
    (folder / "log.pcap").write_bytes(captures.pcap(captures.frames(rows)))
    pairs = zip(captures.ANGLES.vertical / 100, captures.ANGLES.horizontal / 100, strict=True)
    (folder / "angles.csv").write_text("\n".join(f"{vertical},{horizontal}" for vertical, horizontal in pairs))


def frame_files(folder, suffix, **options):
    """Write a folder of frames."""
    (folder / "log").mkdir()
    for number in range(FRAMES):
        points = logs.sea_points(POINTS, (number,))[["x", "y", "z", "intensity"]].astype(writers.XYZI)
        data = writers.WRITERS[suffix](points, **options)
        (folder / "log" / f"{logs.START_NS + number * logs.PERIOD_NS}{suffix}").write_bytes(data)


def scenario(folder):
    """Write a scenario of Autoferry."""
    scenarios.write(folder)


def canoe(folder):
    """Write a sequence of CANOE."""
    data_sets.canoe(folder / "log", FRAMES)


def pohang(folder):
    """Write a sequence of Pohang Canal."""
    data_sets.pohang(folder / "log", FRAMES)


def labelled(folder, form):
    """Write labels of a form, and a log of their frames."""
    target, objects = folder / "labels", (labels.SCENE * 2)[:FRAMES]
    target.mkdir()
    points = [labels.points_of(scene, number) for number, scene in enumerate(objects)]
    if form == "cloud":
        clouds = [cloud for cloud, _ in points]
    else:
        labels.WRITERS[form](target, objects, [owner for _, owner in points])
        clouds = [cloud[["x", "y", "z"]].astype(labels.XYZ) for cloud, _ in points]
    clouds = [_with_intensity(cloud) for cloud in clouds]
    if form in ("csv", "cloud"):
        messages = [logs.cloud_message("ros2", cloud, labels.START_NS) for cloud in clouds]
        entries = [
            logs.Entry("/points", logs.START_NS + number * logs.PERIOD_NS, message)
            for number, message in enumerate(messages)
        ]
        logs.write_log(folder / "log.mcap", [logs.cloud_topic("/points")], entries)
    else:
        suffix = ".bin" if form == "semantickitti" else ".pcd"
        for number, cloud in enumerate(clouds):
            path = next(target.glob(f"*/{number:06d}{suffix}"))
            path.write_bytes(writers.WRITERS[suffix](cloud[["x", "y", "z", "intensity"]].astype(writers.XYZI)))


def _with_intensity(cloud):
    found = np.zeros(len(cloud), [*cloud.dtype.descr, ("intensity", "<f4")])
    for name in cloud.dtype.names:
        found[name] = cloud[name]
    return found


def config(folder):
    """Write a log and a configuration of every section."""
    mcap(folder)
    _run("config", "show", "-m", "joint", output=folder / "config.yaml")


def confirmed_config(folder):
    """Write a log and a configuration of another method."""
    mcap(folder)
    _run("config", "show", "-m", "confirmed", output=folder / "config.yaml")


def _run(*arguments, output=None):
    result = execute(*arguments, code=0)
    if output:
        output.write_text(result.stdout)


SCENE = """
recording: {frames: 1, seed: 3, lidar: RS-LiDAR-16}
sea: {sea_state: 1}
vessel: {heading_deg: 0}
objects:
  - {track_id: 1, shape: buoy, size_m: [1.2, 1.2, 1.8], path: [[24, 12]], reflectivity: 0.4}
"""
TILE_SCENE = """
tile: {size_m: [60, 50], seed: 4, gap_m: 8}
lidar: {height_m: 400, scan_angle_deg: 40, pulses_m2: 0.5}
objects:
  - {kind: ship, size_m: [16, 4.5, 6], position_m: [30, 20], heading_deg: 65}
"""


def scene(folder, text=SCENE):
    """Write a scene to simulate."""
    (folder / "scene.yaml").write_text(text)


def tile(folder, suffix=".las", point_format=6):
    """Write a tile of sea with an object."""
    rng = np.random.default_rng(3)
    xyz = np.concatenate([tiles.sea(rng, 500, (30.0, 25.0)), tiles.box(rng, (8, 14), (8, 12), (0, 4), 150)])
    tiles.write(folder / f"tile{suffix}", xyz, point_format=point_format)


def labelled_tiles(folder):
    """Write a tile with classes and objects."""
    tiles.write_labelled(folder / "tile.las")


def forest(folder):
    """Write a model of objects and a tile."""
    labelled_tiles(folder)
    options = ("-o", folder / "model.skops", "-s", "forest.trees=3", "-s", "forest.test_share=0.4")
    _run("classify", "train", folder / "tile.las", *options)


def classifier(folder):
    """Write a scene classifier and a log."""
    (folder / "model.onnx").write_bytes(model_bytes())
    mcap(folder)


def settings(folder):
    """Write settings of tiles, and a tile."""
    tile(folder)
    (folder / "settings.yaml").write_text("separation: {window_m: 20, cell_m: 1.0}\nforest: {trees: 3}\n")


def tree(write):
    """Return the files that a function writes, by their relative paths."""
    from tempfile import mkdtemp

    folder = Path(mkdtemp())
    try:
        write(folder)
        return {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }
    finally:
        shutil.rmtree(folder)


pcd_ascii = partial(frame_files, suffix=".pcd", encoding=Encoding.ASCII)
pcd_compressed = partial(frame_files, suffix=".pcd", encoding=Encoding.BINARY_COMPRESSED)
