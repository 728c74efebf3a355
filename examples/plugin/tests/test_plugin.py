"""The checks of seaclutter on each part of the package."""

import numpy as np
from seaclutter_example.cloud import ExampleCloud
from seaclutter_example.method import AboveWater
from seaclutter_example.sensor import PACKET, ExampleLidar

from seaclutter import simulate
from seaclutter.testing import (
    check_codec,
    check_filter,
    check_labels,
    check_output,
    check_packets,
    check_source,
    example_frames,
)


def test_method():
    check_filter(AboveWater)
    check_filter("above_water", height_m=2)


def test_source(tmp_path):
    log = tmp_path / "trial.points.txt"
    log.write_text("".join(f"{1.7e9 + k / 10:.1f} {k} {y} -2 {9 * y}\n" for k in range(5) for y in range(3)))
    check_source(log)


def test_sensor():
    packets = np.zeros(60, PACKET)
    packets["magic"], packets["number"] = np.frombuffer(b"EXLI", "<u4")[0], np.arange(60)
    packets["revolution"], packets["time_ns"] = np.arange(60) // 20, 1_700_000_000_000_000_000 + np.arange(60)
    check_packets(ExampleLidar(), packets.view(np.uint8).reshape(60, -1))


def test_cloud():
    [frame] = example_frames(1)
    check_codec(ExampleCloud(), ExampleCloud().encode(frame.cloud))


def test_labels(tmp_path):
    labels = tmp_path / "trial.boxes.txt"
    labels.write_text("".join(f"{number} hull 32 5 -1 4 2 3\n" for number in range(15)))
    check_labels(labels, example_frames())


def test_sink(tmp_path):
    simulate("buoy_speedboat", tmp_path / "log.mcap", frames=4)
    check_output(tmp_path / "log.mcap", "example_table", tmp_path / "out", _read)


def _read(folder):
    return np.concatenate([np.loadtxt(file, ndmin=2) for file in sorted(folder.glob("*.tab"))])
