"""Every input format to every output format and back: points, fields, times and counts."""

import numpy as np
import pytest

from seaclutter_cli.runs.convert import convert_log
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.sources.formats import SOURCES
from seaclutter_cli.sources.frame_files import FRAME_READERS
from tests.fuzz.formats import FORMATS
from tests.sinks.outputs.reading import READERS, Read, by_this_program

INPUTS = {
    "mcap zstd": "log.mcap",
    "mcap unchunked": "log.mcap",
    "mcap ros1": "log.mcap",
    "mcap protobuf": "log.mcap",
    "mcap json": "log.mcap",
    "mcap packets": "log.mcap",
    "mcap compressed zstd": "log.mcap",
    "mcap compressed draco": "log.mcap",
    "mcap foxglove ros": "log.mcap",
    "mcap scan": "log.mcap",
    "canoe": "log",
    "bag": "log.bag",
    "bag lz4": "log.bag",
    "rosbag2 db3": "log",
    "rosbag2 message zstd": "log",
    "rosbag2 file zstd": "log",
    "rosbag2 mcap": "log",
    "pcap robosense": "log.pcap",
    "pcap hesai": "log.pcap",
    "pcap velodyne": "log.pcap",
    "pcap ouster": "log.pcap",
    "pcd binary": "log",
    "ply": "log",
    "las frames": "log",
    "laz frames": "log",
    "kitti bin": "log",
    "npy": "log",
    "npz": "log",
    "csv frames": "log",
}
WRAPPED = ("mcap compressed zstd", "mcap compressed draco", "mcap foxglove ros", "mcap scan")
"""Clouds in other messages, which formats with topics keep; the other readers know PointCloud2 only."""
RESOLUTION_M = {"las": 0.5e-4, "laz": 0.5e-4}


def test_every_format_is_in_the_matrix():
    assert READERS.keys() == OUTPUT_FORMATS.keys()
    assert {name.split()[0] for name in INPUTS} >= {"mcap", "bag", "rosbag2", "pcap"}
    assert set(SOURCES) == {"mcap", "bag", "db3", "capture", "detections"}
    frames = {"kitti bin": ".bin", "csv frames": ".csv"}
    assert {frames.get(name, "." + name.split()[0]) for name in INPUTS} >= set(FRAME_READERS)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Return a function that gives the path and the frames of an input, which is written once."""
    known = {}

    def find(name):
        if name not in known:
            folder = tmp_path_factory.mktemp("input")
            FORMATS[name].write(folder)
            known[name] = folder / INPUTS[name], by_this_program(folder / INPUTS[name])
        return known[name]

    return find


def convert(path, target, form):
    result = convert_log(path, target, to=form, keep_going=True)
    (outcome,) = result.outcomes
    assert outcome.error is None
    assert all("/imu" in item.problem for item in outcome.damage)  # of random bytes, which have no translation
    return outcome


@pytest.mark.parametrize("form", OUTPUT_FORMATS)
@pytest.mark.parametrize("name", INPUTS)
def test_there_and_back(name, form, inputs, tmp_path):
    path, expected = inputs(name)
    target = tmp_path / f"out_{form}{'' if OUTPUT_FORMATS[form].is_folder else OUTPUT_FORMATS[form].suffix}"
    outcome = convert(path, target, form)
    is_posed = name == "mcap foxglove ros" and not OUTPUT_FORMATS[form].has_topics
    expected, rtol = ([posed(frame) for frame in expected], 1e-5) if is_posed else (expected, 0)
    assert outcome.frames == len(expected)
    assert outcome.points_in == sum(len(frame.columns["x"]) for frame in expected)
    check(form, by_this_program(target), expected, rtol)
    wrapped = name in WRAPPED and OUTPUT_FORMATS[form].has_topics
    if not wrapped and not (form == "mcap" and name in ("mcap protobuf", "mcap json")):  # kept as they are
        check(form, READERS[form](target), expected, rtol)
    convert(target, tmp_path / "back.mcap", "mcap")
    check(form, by_this_program(tmp_path / "back.mcap"), expected, rtol)


def check(form, found, expected, rtol=0):
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        check_frame(form, one, other, rtol)


def posed(frame: Read) -> Read:
    """Return a frame with the pose of the cloud applied, as in formats without a place for it."""
    x, y, z = (frame.columns[axis].astype(np.float64) for axis in "xyz")
    moved = {"x": 0.28 * x - 0.96 * y + 1, "y": 0.96 * x + 0.28 * y + 2, "z": z + 3}
    return frame._replace(columns=frame.columns | {name: values.astype("f4") for name, values in moved.items()})


def check_frame(form: str, found: Read, expected: Read, rtol: float = 0) -> None:
    assert found.stamp_ns == expected.stamp_ns
    if OUTPUT_FORMATS[form].has_topics:
        assert found.time_ns == expected.time_ns
        assert list(found.columns) == list(expected.columns)
    kept = np.ones(len(expected.columns["x"]), bool)
    if form in RESOLUTION_M:
        kept = np.all([np.isfinite(expected.columns[axis]) for axis in "xyz"], axis=0)
    for name, values in expected.columns.items():
        stored = column(found.columns, name, values)
        if form in RESOLUTION_M and name in "xyz":
            resolution = max(RESOLUTION_M[form], 5 * np.ptp(values[kept]) / 4e9)
            np.testing.assert_allclose(stored, values[kept], rtol=1e-9, atol=1.01 * resolution)
            continue
        assert stored.dtype.newbyteorder("=") == values.dtype.newbyteorder("=")
        if rtol and name in "xyz":
            np.testing.assert_allclose(stored, values[kept], rtol=rtol)
        else:
            np.testing.assert_array_equal(stored, values[kept])


def column(columns, name, values):
    """Return a field; LAS stores some under other names, and LAS and pypcd4 each of several values by itself."""
    name = f"original_{name}" if f"original_{name}" in columns else name
    if name in columns:
        return columns[name]
    parts = [[f"{name}_{number}", f"{name}__{number:04d}"] for number in range(values.shape[1])]
    return np.stack([next(columns[one] for one in names if one in columns) for names in parts], axis=1)
