"""The formats of a campaign: an honest input of each, the commands that read it, and the mutations of its files."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tests.fuzz import layers, seeds
from tests.fuzz.mutate import BYTES, DOCUMENT, TEXT, cut, drop, flip, insert, overwrite

Commands = tuple[str, ...]


@dataclass(frozen=True)
class Format:
    """A format of input.

    Parameters
    ----------
    write : callable
        Writes an honest input into a folder.
    commands : tuple of str
        Command lines; ``IN`` and ``OUT`` are folders.
    files : str
        Glob of the files that are mutated; others are read as they are.
    mutations : tuple of callable
        Mutations of a file as it is.
    layers : tuple of callable
        Containers whose content is mutated too.
    settings : bool
        Whether the input is a configuration or scene, which may be refused with exit status 2.
    guarded : tuple of callable
        Mutations of the file as it is, after which a loss of frames or points must be reported.
    """

    write: Callable[[Path], object]
    commands: Commands
    files: str = "log*"
    mutations: tuple[Callable[..., bytes], ...] = BYTES
    layers: tuple[Callable[..., bytes], ...] = ()
    settings: bool = False
    guarded: tuple[Callable[..., bytes], ...] = ()


def _log(name: str, *more: str) -> Commands:
    write = f"filter IN/{name} -o OUT/out.mcap --csv OUT/frames.csv"
    return (
        f"{write} -m none",
        f"{write} -m joint --with-removed --keep-raw --json",
        f"{write} -m none",
        f"info IN/{name} --json",
        f"{write} -m confirmed --keep-organized --with-scene --json",
        f"calibrate IN/{name} -o OUT/config.yaml",
        f"convert IN/{name} -o OUT/out.bag --exclude imu --json",
        f"convert IN/{name} -o OUT/out --to rosbag2-db3 --exclude imu",
        *more,
    )


def _labels(*words: str) -> Commands:
    log, path = words
    write = f"evaluate IN/{log} --labels IN/{path} -o OUT/frames.csv --summary OUT/summary.json"
    return (
        f"{write} -m none",
        f"{write} -m joint --json",
        f"filter IN/{log} --labels IN/{path} -o OUT/out.mcap -m none --with-scene",
    )


def _packets(options: str) -> Commands:
    return (
        f"filter IN/log.pcap -o OUT/out.mcap --csv OUT/frames.csv -m none {options}",
        f"info IN/log.pcap --json {options}",
    )


_CORRECTIONS = _packets("--calibration IN/angles.dat")
_MODEL = "-s filter.scene=auto -s filter.scene_model=IN/model.onnx"
_TILE = (
    "classify separate IN/tile{} -o OUT/out.las",
    "classify separate IN/tile{} -o OUT/out.mcap --with-height --json",
    "info IN/tile{} --json",
)
_CHECKED = (flip, cut, drop, insert, overwrite)
_MESSAGES = (layers.mcap_chunk, layers.mcap_message)
_MCAP = {"commands": _log("log.mcap"), "layers": _MESSAGES, "guarded": _CHECKED}
_BAG = {"commands": _log("log.bag"), "layers": (layers.bag_chunk, layers.bag_message), "guarded": (cut, drop)}
_FOLDER = {"commands": _log("log"), "files": "log/*"}
_PACKETS = {"commands": _log("log.pcap"), "files": "log.pcap", "layers": (layers.packet,)}
_SCENARIO = (
    "filter IN/scenario2_detections.json -t /radar/detections -o OUT/out.mcap --csv OUT/frames.csv -m none",
    "evaluate IN/scenario2_detections.json -t /radar/detections --labels IN/ -m none -o OUT/frames.csv --json",
    "info IN/scenario2_detections.json --json",
)
_TEXT_HEAD = {**_FOLDER, "mutations": (*BYTES, *TEXT)}

FORMATS: dict[str, Format] = {
    "mcap zstd": Format(seeds.mcap, **_MCAP),
    "mcap lz4": Format(partial(seeds.mcap, layout="lz4"), **_MCAP),
    "mcap none": Format(partial(seeds.mcap, layout="none"), **_MCAP),
    "mcap unchunked": Format(partial(seeds.mcap, layout="unchunked"), commands=_log("log.mcap")),
    "mcap bare": Format(partial(seeds.mcap, layout="bare"), commands=_log("log.mcap")),
    "mcap ros1": Format(partial(seeds.mcap, kind="ros1"), **_MCAP),
    "mcap protobuf": Format(partial(seeds.mcap, kind="protobuf"), **_MCAP),
    "mcap json": Format(partial(seeds.mcap, kind="json"), **_MCAP),
    "mcap packets": Format(seeds.mcap_packets, **_MCAP),
    "bag packets": Format(partial(seeds.packet_topic, driver="rslidar_sdk", container="bag"), **_BAG),
    "db3 packets": Format(
        partial(seeds.packet_topic, driver="rslidar", container="db3"), _log("log.db3"), layers=(layers.sqlite_cell,)
    ),
    "mcap ouster packets": Format(
        partial(seeds.packet_topic, driver="ouster_sensor_msgs"), _log("log.mcap"), "log.mcap", layers=_MESSAGES
    ),
    "mcap hesai packets": Format(
        partial(seeds.packet_topic, driver="hesai_ros_driver"), _log("log.mcap"), "log.mcap", layers=_MESSAGES
    ),
    "mcap compressed zstd": Format(partial(seeds.wrapped_clouds, form="zstd"), **_MCAP),
    "mcap compressed zlib": Format(partial(seeds.wrapped_clouds, form="zlib"), **_MCAP),
    "mcap compressed draco": Format(partial(seeds.wrapped_clouds, form="draco"), **_MCAP),
    "mcap foxglove ros": Format(partial(seeds.wrapped_clouds, form="foxglove"), **_MCAP),
    "mcap livox": Format(partial(seeds.wrapped_clouds, form="livox"), **_MCAP),
    "mcap scan": Format(partial(seeds.wrapped_clouds, form="scan"), **_MCAP),
    "mcap scan echoes": Format(partial(seeds.wrapped_clouds, form="echoes"), **_MCAP),
    "bag": Format(seeds.bag, **_BAG),
    "bag bz2": Format(partial(seeds.bag, compression="BZ2"), **_BAG),
    "bag lz4": Format(partial(seeds.bag, compression="LZ4"), **_BAG),
    "rosbag2 db3": Format(seeds.rosbag2, _log("log"), "log/*.db3", layers=(layers.sqlite_cell,)),
    "rosbag2 message zstd": Format(
        partial(seeds.rosbag2, mode="MESSAGE"), _log("log"), "log/*.db3", layers=(layers.sqlite_cell,)
    ),
    "rosbag2 file zstd": Format(
        partial(seeds.rosbag2, mode="FILE"), _log("log"), "log/*.zstd", layers=(layers.zstd, layers.zstd)
    ),
    "rosbag2 mcap": Format(partial(seeds.rosbag2, plugin="MCAP"), _log("log"), "log/*.mcap"),
    "rosbag2 metadata": Format(seeds.rosbag2, _log("log"), "log/metadata.yaml", DOCUMENT),
    "pcap robosense": Format(seeds.robosense, **_PACKETS),
    "pcap fragments": Format(partial(seeds.robosense, fragments=True), _log("log.pcap"), "log.pcap"),
    "pcapng": Format(seeds.pcapng, _log("log.pcapng")),
    "pcap hesai": Format(seeds.hesai_capture, **_PACKETS),
    "pcap hesai mirrors": Format(seeds.mirror_capture, _CORRECTIONS, "log.pcap", layers=(layers.packet,)),
    "pcap ruby 48": Format(seeds.ruby_48_capture, _packets("--sensor RS-Ruby-48"), layers=(layers.packet,)),
    "pcap hesai 128": Format(partial(seeds.hesai_capture, kind="P128"), **_PACKETS),
    "pcap velodyne": Format(seeds.velodyne_capture, **_PACKETS),
    "pcap ouster": Format(seeds.ouster_capture, **_PACKETS),
    "pcap ouster legacy": Format(partial(seeds.ouster_capture, profile="LEGACY"), **_PACKETS),
    "ouster metadata": Format(seeds.ouster_capture, _log("log.pcap"), "log.json", DOCUMENT),
    "angles csv": Format(
        seeds.with_angles,
        _packets("--calibration IN/angles.csv --sensor RS-LiDAR-32"),
        "angles.csv",
        TEXT,
    ),
    "angles dat": Format(seeds.mirror_capture, _CORRECTIONS, "angles.dat", layers=(layers.hashed, layers.hashed)),
    "pcd ascii": Format(seeds.pcd_ascii, **_TEXT_HEAD),
    "pcd binary": Format(partial(seeds.frame_files, suffix=".pcd"), **_TEXT_HEAD),
    "pcd compressed": Format(seeds.pcd_compressed, **_TEXT_HEAD),
    "ply": Format(partial(seeds.frame_files, suffix=".ply"), **_TEXT_HEAD),
    "ply ascii": Format(partial(seeds.frame_files, suffix=".ply", encoding="ascii"), **_TEXT_HEAD),
    "las frames": Format(partial(seeds.frame_files, suffix=".las"), **_FOLDER),
    "laz frames": Format(partial(seeds.frame_files, suffix=".laz"), **_FOLDER),
    "kitti bin": Format(partial(seeds.frame_files, suffix=".bin"), **_FOLDER),
    "autoferry": Format(seeds.scenario, _SCENARIO, "scenario2_*", DOCUMENT),
    "canoe": Format(seeds.canoe, _log("log"), "log/*/*", (*BYTES, *TEXT)),
    "pohang": Format(seeds.pohang, _log("log/lidar/lidar_port"), "log/lidar/lidar_port/points/*"),
    "npy": Format(partial(seeds.frame_files, suffix=".npy"), **_TEXT_HEAD),
    "npz": Format(partial(seeds.frame_files, suffix=".npz"), **_FOLDER),
    "csv frames": Format(partial(seeds.frame_files, suffix=".csv"), **_TEXT_HEAD),
    "labels csv": Format(
        partial(seeds.labelled, form="csv"), _labels("log.mcap", "labels/log.labels.csv"), "labels/*.csv", TEXT
    ),
    "labels in cloud": Format(
        partial(seeds.labelled, form="cloud"),
        _labels("log.mcap", "log.mcap"),
        layers=(layers.mcap_message, layers.mcap_message),
    ),
    "seepersea": Format(
        partial(seeds.labelled, form="seepersea"), _labels("labels", "labels"), "labels/*/*.json", DOCUMENT
    ),
    "sustechpoints": Format(
        partial(seeds.labelled, form="sustechpoints"), _labels("labels", "labels"), "labels/*/*.json", DOCUMENT
    ),
    "semantickitti": Format(
        partial(seeds.labelled, form="semantickitti"), _labels("labels", "labels"), "labels/*/*.label"
    ),
    "config": Format(
        seeds.config,
        ("filter IN/log.mcap -c IN/config.yaml -o OUT/out.mcap", "config check IN/config.yaml"),
        "config.yaml",
        DOCUMENT,
        settings=True,
    ),
    "config confirmed": Format(
        seeds.confirmed_config,
        (
            "filter IN/log.mcap -c IN/config.yaml -o OUT/out.mcap",
            "config check IN/config.yaml",
            "calibrate IN/log.mcap -c IN/config.yaml -o OUT/config.yaml",
        ),
        "config.yaml",
        DOCUMENT,
        settings=True,
    ),
    "scene": Format(
        seeds.scene,
        ("simulate IN/scene.yaml -n 1 -o OUT/out.mcap", "simulate IN/scene.yaml -n 1 -o OUT/out.pcap --json"),
        "scene.yaml",
        DOCUMENT,
        settings=True,
    ),
    "tile scene": Format(
        partial(seeds.scene, text=seeds.TILE_SCENE),
        ("simulate IN/scene.yaml -o OUT/out.las", "simulate IN/scene.yaml -o OUT/out.laz --json"),
        "scene.yaml",
        DOCUMENT,
        settings=True,
    ),
    "settings": Format(
        seeds.settings,
        ("classify separate IN/tile.las -c IN/settings.yaml -o OUT/out.las",),
        "settings.yaml",
        DOCUMENT,
        settings=True,
    ),
    "tile las": Format(seeds.tile, tuple(line.format(".las") for line in _TILE), "tile*"),
    "tile laz": Format(partial(seeds.tile, suffix=".laz"), tuple(line.format(".laz") for line in _TILE), "tile*"),
    "training tile": Format(
        seeds.labelled_tiles,
        ("classify train IN/tile.las -o OUT/model.skops -s forest.trees=3 -s forest.test_share=0.4",),
        "tile.las",
    ),
    "model skops": Format(
        seeds.forest,
        (
            "classify predict IN/tile.las --model IN/model.skops -o OUT/out.las --csv OUT/o.csv",
            "classify predict IN/tile.las --model IN/model.skops -o OUT/out.las --geojson OUT/o.geojson --json",
        ),
        "model.skops",
        layers=(layers.member, layers.member, layers.member),
    ),
    "model onnx": Format(
        seeds.classifier,
        (
            "scene predict IN/log.mcap --model IN/model.onnx --csv OUT/scenes.csv",
            "scene predict IN/log.mcap --model IN/model.onnx --json",
            f"filter IN/log.mcap -o OUT/o.mcap -m adaptive_radius {_MODEL}",
        ),
        "model.onnx",
    ),
}
