"""A simulated recording: turns made in several threads, written in their order."""

import csv
import io
import json
import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from seaclutter_cli import __version__
from seaclutter_cli.cloud import from_array
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Channel, Metadata
from seaclutter_cli.simulation.lidar import LIDARS
from seaclutter_cli.simulation.render import Renderer, Turn
from seaclutter_cli.simulation.scene import Scene
from seaclutter_cli.sinks.atomic import AtomicFile
from seaclutter_cli.sinks.mcap_writer import McapWriter

START_NS = 1_700_000_000 * 10**9
"""When every simulated recording begins, in nanoseconds of Unix time."""

_TYPE = "sensor_msgs/msg/PointCloud2"
_COLUMNS = ("frame", "track_id", "class", "x", "y", "z", "length", "width", "height", "yaw")


def turns(scene: Scene) -> Iterator[Turn]:
    """Yield the turns of a scene in order, made by all cores; the same whatever their number."""
    threads = os.cpu_count() or 1
    renderer = Renderer(scene)
    pending: deque[Future[Turn]] = deque()
    with ThreadPoolExecutor(threads, thread_name_prefix="simulate") as pool:
        try:
            for index in range(scene.recording.frames):
                pending.append(pool.submit(renderer.turn, index))
                if len(pending) > threads:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)


def record(scene: Scene, log: Path, labels: Path, on_turn: Callable[[Turn], None] = lambda _: None) -> None:
    """Write a scene as an MCAP file of PointCloud2 messages, and its labels as native CSV.

    Parameters
    ----------
    scene : Scene
        What is recorded.
    log, labels : Path
        The files; they appear when they are complete.
    on_turn : callable, optional
        Is told of each turn.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    with AtomicFile(log) as log_file, AtomicFile(labels) as label_file:
        writer = McapWriter(log_file.stream, profile="ros2", library=f"seaclutter {__version__}", compression="zstd")
        try:
            writer.add_metadata(Metadata("scene", {"version": __version__, "scene": json.dumps(scene.as_dict())}))
            writer.add_channel(Channel(1, "/points", "cdr", ros2_schema(_TYPE)))
            label_file.stream.write((",".join(_COLUMNS) + "\n").encode())
            period_ns = round(10**9 / LIDARS[scene.recording.lidar].rate_hz)
            for turn in turns(scene):
                stamp_ns, message = _message(turn, period_ns)
                writer.write(1, stamp_ns, stamp_ns, turn.index, message)
                label_file.stream.write(_rows(turn).encode())
                on_turn(turn)
            writer.finish()
        except BaseException:
            writer.abort()
            raise


def _message(turn: Turn, period_ns: int) -> tuple[int, bytes]:
    """Return stamp and message of a turn; the stamp is that of the turn's end, as drivers have it."""
    stamp_ns = START_NS + (turn.index + 1) * period_ns
    points = turn.points.copy()
    points["timestamp"] += START_NS / 10**9
    return stamp_ns, CODECS[_TYPE, "cdr"].encode(from_array(points, stamp_ns=stamp_ns))


def _rows(turn: Turn) -> str:
    """Return the lines of a turn's labels."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    boxes = turn.boxes
    for track, kind, center, size, yaw in zip(
        boxes.tracks, boxes.classes, boxes.centers, boxes.sizes, boxes.yaws, strict=True
    ):
        numbers = (f"{value:.3f}" for value in (*center, *size))
        writer.writerow((turn.index, track, kind, *numbers, f"{yaw:.4f}"))
    return text.getvalue()
