"""Speed of packet topics on one core: revolutions per second, and the ratio to a capture of the same packets.

Run as ``python benchmarks/packet_topics.py FOLDER``. Times are CPU time of all threads from the open file to encoded
clouds, the least of five runs in a process of its own. Bags are not compressed.
"""

import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from pathlib import Path

from capture import packets as robosense_packets

from seaclutter_cli.records import Message
from seaclutter_cli.sensors.packets import DecoderOptions
from seaclutter_cli.sources.formats import open_source
from tests.sensors.hesai import test_decoder as hesai
from tests.sensors.velodyne.test_decoder import make_packets as velodyne_packets
from tests.sources.shared.driver_topics import DRIVERS, pairs, write_capture, write_topic
from tests.sources.shared.packet_bags import CONTAINERS

RUNS = 5
REVOLUTIONS = 100
RETURNS = 0.2
"""Share of shots with a return, as at sea."""


def _robosense() -> list[tuple[int, bytes]]:
    return [(time_ns, payload) for time_ns, _, payload in robosense_packets(REVOLUTIONS, RETURNS)]


def _hesai() -> list[tuple[int, bytes]]:
    return pairs(hesai.make_packets(hesai.XT32, REVOLUTIONS / 10)[0])


def _velodyne() -> list[tuple[int, bytes]]:
    return pairs(velodyne_packets(75 * REVOLUTIONS, step=40))


PACKETS = {"rslidar": _robosense, "rslidar_sdk": _robosense, "velodyne": _velodyne}
PACKETS |= dict.fromkeys(("nebula", "hesai_ros_driver", "pandar"), _hesai)


def decode(path: Path, options: DecoderOptions) -> tuple[int, float]:
    """Return the number of frames of a recording, and the least time of decoding it."""
    seconds = []
    with closing(open_source(path, decoding=options)) as source:
        clouds = [channel.id for channel in source.channels if channel.topic.endswith("points")]
        for _ in range(RUNS):
            started = time.process_time()
            frames = sum(isinstance(record, Message) and record.channel.id in clouds for record in source.records())
            seconds.append(time.process_time() - started)
    return frames, min(seconds)


def in_new_process(path: Path, options: DecoderOptions) -> tuple[int, float]:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(decode, path, options).result()


def main(folder: Path) -> None:
    print(f"{'driver':<20}{'container':<10}{'revolutions/s':>14}{'of a capture':>14}")
    for name, driver in DRIVERS.items():
        if "," in name:  # another sensor of the same driver
            continue
        packets = PACKETS.get(name, driver.packets)()
        of_driver = folder / name
        of_driver.mkdir(parents=True, exist_ok=False)
        capture = write_capture(driver, of_driver / "log.pcap", packets)
        frames, seconds = in_new_process(capture, DecoderOptions(**driver.files(of_driver)))
        print(f"{name:<20}{'pcap':<10}{frames / seconds:>14.0f}{'1.00':>14}", flush=True)
        for container in CONTAINERS:
            path = write_topic(driver, container, of_driver, packets)
            of_topic, topic_seconds = in_new_process(path, DecoderOptions())
            assert of_topic == frames
            ratio = seconds / topic_seconds
            print(f"{name:<20}{container:<10}{frames / topic_seconds:>14.0f}{ratio:>14.2f}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
