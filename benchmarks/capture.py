"""Speed on RS-LiDAR-32 captures: decoding on one core, and ``seaclutter filter`` as a whole process.

Run as ``python benchmarks/capture.py FOLDER`` on Linux or macOS. Decoding is timed from the file to structured frames:
it searches the whole capture for the sensor and its calibration, then decodes every packet.
"""

import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from seaclutter_cli.messages import find_codec
from seaclutter_cli.sensors.robosense.models import MODELS
from seaclutter_cli.sensors.robosense.packets import Columns, make_angles, write_data, write_info
from seaclutter_cli.simulation.marine.recording import ethernet_udp, pcap_header, pcap_record
from seaclutter_cli.sources.formats import open_source

PACKETS_PER_REVOLUTION = 150
COLUMNS = 12 * PACKETS_PER_REVOLUTION
START_NS = 1_700_000_000_000_000_000
MODEL = MODELS["RS-LiDAR-32"]
DATA_PORT, INFO_PORT = 6699, 7788
RUNS = 5
SCENES = ("calm", "buoy_speedboat", "departure", "rough", "harbour")
REVOLUTIONS = 200


def packets(revolutions: int, returns: float) -> Iterator[tuple[int, int, bytes]]:
    random = np.random.default_rng(0)
    angles = make_angles(np.arange(32) * 125 - 2500, np.arange(32) % 4 * 300 - 450)
    for revolution in range(revolutions):
        distance = random.uniform(1, 200, (COLUMNS, 32)) * (random.random((COLUMNS, 32)) < returns)
        times = START_NS + (revolution * PACKETS_PER_REVOLUTION + np.arange(PACKETS_PER_REVOLUTION)) * MODEL.packet_ns
        columns = Columns(np.arange(COLUMNS) * 20, distance, random.integers(0, 256, distance.shape), times)
        for time_ns, payload in zip(times.tolist(), write_data(MODEL, columns), strict=True):
            yield time_ns + MODEL.packet_ns, DATA_PORT, payload.tobytes()
        if revolution % 10 == revolutions % 10:
            yield int(times[-1]) + MODEL.packet_ns, INFO_PORT, write_info(MODEL, angles).tobytes()


def decode(path: Path) -> tuple[int, int]:
    """Return the number of frames and points of a capture."""
    frames = points = 0
    with closing(open_source(path)) as source:
        for message in source.records():
            codec = find_codec(message.channel)
            points += len(codec.decode(message.data).points) if codec else 0
            frames += 1
    return frames, points


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def filter_scenes(folder: Path) -> None:
    """Print times of the whole process on captures of simulated scenes; the sensor makes ten revolutions per second."""
    print(f"\n{'scene':<16}{'revolutions':>13}{'seconds':>9}{'revolutions/s':>15}")
    for scene in SCENES:
        path = folder / f"{scene}.pcap"
        tool = [sys.executable, "-m", "seaclutter_cli"]
        if not path.exists():
            subprocess.run([*tool, "simulate", scene, "-n", str(REVOLUTIONS), "-o", str(path), "-q"], check=True)
        seconds = []
        for _ in range(RUNS):
            started = time.perf_counter()
            subprocess.run([*tool, "filter", str(path), "-o", str(folder / "out.mcap"), "--force", "-q"], check=True)
            seconds.append(time.perf_counter() - started)
        middle = statistics.median(seconds)
        print(f"{scene:<16}{REVOLUTIONS:>13}{middle:>9.2f}{REVOLUTIONS / middle:>15.0f}", flush=True)


def decode_captures(folder: Path) -> None:
    print(f"{'returns':<10}{'revolutions':>13}{'frames/s':>10}{'packets/s':>11}{'points/s':>12}{'peak MB':>9}")
    for revolutions, returns in ((300, 1.0), (300, 0.5), (1200, 0.5)):
        path = folder / f"rs-lidar-32-{revolutions}-{returns}.pcap"
        with path.open("wb") as file:
            file.write(pcap_header())
            for time_ns, port, payload in packets(revolutions, returns):
                file.write(pcap_record(time_ns, ethernet_udp(port, payload)))
        seconds = []
        for _ in range(RUNS):
            started = time.perf_counter()
            frames, points = decode(path)
            seconds.append(time.perf_counter() - started)
        middle = statistics.median(seconds)
        rates = frames / middle, frames * PACKETS_PER_REVOLUTION / middle
        print(f"{returns:<10.0%}{revolutions:>13}{rates[0]:>10.0f}{rates[1]:>11.0f}", end="")
        print(f"{points / middle:>12.3g}{peak_mb():>9.0f}", flush=True)


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    decode_captures(folder)
    filter_scenes(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
