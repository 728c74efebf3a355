"""Speed and memory of the method ``confirmed`` beside ``joint``: the whole command, and one step of the method.

Run as ``python benchmarks/confirmed_speed.py FOLDER [PAIRS]`` on Linux or macOS. It simulates the logs, 110 MB, in
FOLDER. In the organised ones, all 57,600 firings of a frame have a point, and those without an echo are NaN.
"""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from logs import PERIOD_NS, POINTS, START_NS
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from whole_process import measure

import seaclutter
from seaclutter_cli.cloud import from_array
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import Frame
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema

SCENES = {"departure": 196, "rough": 150, "passing_speedboat": 150, "harbour": 100}
METHODS = ("joint", "confirmed")
SEED = 7


def simulated(folder: Path, scene: str) -> Path:
    """Return the simulated log of a scene."""
    log = folder / f"{scene}.mcap"
    if not log.exists():
        command = [sys.executable, "-m", "seaclutter_cli", "simulate", scene, "-o", str(log), "--seed", str(SEED), "-q"]
        subprocess.run([*command, "-n", str(SCENES[scene])], check=True)
    return log


def organised(log: Path) -> Path:
    """Return a copy of a log whose frames are padded to 57,600 points, as a driver publishes organised clouds."""
    path = log.with_name(f"{log.stem}-organised.mcap")
    if path.exists():
        return path
    codec, part = CODECS["sensor_msgs/msg/PointCloud2", "cdr"], path.with_suffix(".part")
    with part.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        schema = ros2_schema("sensor_msgs/msg/PointCloud2")
        number = writer.register_schema(schema.name, schema.encoding, schema.data)
        channel = writer.register_channel("/points", "cdr", number)
        for k, points in enumerate(padded(log)):
            stamp = START_NS + k * PERIOD_NS
            writer.add_message(channel, stamp, codec.encode(from_array(points, stamp_ns=stamp)), stamp, k)
        writer.finish()
    part.rename(path)
    return path


def padded(log: Path) -> Iterator[NDArray[np.void]]:
    """Yield the points of each frame among others that are NaN."""
    with seaclutter.open_log(log) as opened:
        for frame in opened.frames():
            echoes = frame.cloud.points
            points = np.zeros(max(POINTS, len(echoes)), echoes.dtype)
            for axis in "xyz":
                points[axis] = np.nan
            points[np.linspace(0, len(points) - 1, len(echoes)).astype(int)] = echoes
            yield points


def compare(name: str, log: Path, pairs: int) -> None:
    """Print the times of both methods, alternating, after one untimed run of each."""

    def run(method: str) -> tuple[float, float]:
        out = str(log.with_name("filtered.mcap"))
        command = [sys.executable, "-m", "seaclutter_cli", "filter", str(log), "-o", out, "--force", "-q", "-m", method]
        return measure(command)

    times = [[run(method) for method in METHODS] for _ in range(pairs + 1)][1:]
    joint, confirmed = (statistics.median(pair[side][0] for pair in times) for side in (0, 1))
    ratios = [pair[1][0] / pair[0][0] for pair in times]
    peak = max(pair[1][1] for pair in times)
    spread = f"({min(ratios):.2f} to {max(ratios):.2f})"
    print(f"{name:<30}{joint:>9.2f}{confirmed:>11.2f}{statistics.median(ratios):>8.2f}{spread:>17}{peak:>7.0f}")


def step_ms(log: Path) -> list[float]:
    """Return the time of each step of ``confirmed`` in milliseconds, with frames that are already decoded."""
    method = FILTERS["confirmed"](FILTERS["confirmed"].Params())
    times = []
    with seaclutter.open_log(log) as opened:
        for cloud in opened.frames():
            frame = Frame(cloud.cloud, cloud.topic, cloud.stamp_ns, cloud.index)
            started = time.perf_counter()
            method.process(frame)
            times.append(1e3 * (time.perf_counter() - started))
    return times


def main(folder: Path, pairs: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    print(f"{'log':<30}{'joint s':>9}{'confirmed s':>11}{'ratio':>8}{'':>17}{'MB':>7}")
    logs: dict[str, Path] = {}
    for scene in SCENES:
        log = simulated(folder, scene)
        logs |= {scene: log, f"{scene}, organised": organised(log)}
    for name, log in logs.items():
        compare(name, log, pairs)
    print(f"{'step of confirmed':<30}{'median ms':>12}{'99 % ms':>12}")
    for name, log in logs.items():
        times = step_ms(log)
        print(f"{name:<30}{statistics.median(times):>12.1f}{np.quantile(times, 0.99):>12.1f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 5)
