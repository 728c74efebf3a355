"""Simulated recordings: frames rendered in several threads and written in order."""

import csv
import io
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from seaclutter_cli.simulation.marine.formats import FORMATS, LogWriter
from seaclutter_cli.simulation.marine.render import Renderer, SimulatedFrame
from seaclutter_cli.simulation.marine.scene import Scene
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.threads import executor, threads

if TYPE_CHECKING:
    from concurrent.futures import Future

_COLUMNS = ("frame", "track_id", "class", "x", "y", "z", "length", "width", "height", "yaw")


def simulate_frames(scene: Scene) -> Iterator[SimulatedFrame]:
    """Yield the frames of a scene in order, rendered on all cores; the number of cores does not change them."""
    workers = threads()
    renderer = Renderer(scene)
    pending: deque[Future[SimulatedFrame]] = deque()
    with executor(workers, "simulate") as pool:
        try:
            for index in range(scene.recording.frames):
                pending.append(pool.submit(renderer.frame, index))
                if len(pending) > workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)


def record(
    scene: Scene,
    log: Path,
    labels: Path,
    on_frame: Callable[[SimulatedFrame], None] = lambda _: None,
    group: OutputGroup | None = None,
) -> None:
    """Write a scene to a file in one of `FORMATS`, chosen by its extension, and its labels as native CSV.

    Parameters
    ----------
    scene : Scene
        The scene to record.
    log, labels : Path
        The files; they appear together when they are complete.
    on_frame : callable, optional
        Called with each frame.
    group : OutputGroup, optional
        Files that appear together with these.

    Raises
    ------
    OutputError
        If a file cannot be written.
    UsageError
        If the format does not support the lidar.
    """
    with (
        OutputGroup(group) as files,
        AtomicFile(log, files) as log_file,
        AtomicFile(labels, files) as label_file,
    ):
        writer: LogWriter = FORMATS[log.suffix[1:]](scene, log_file.stream)
        try:
            label_file.stream.write((",".join(_COLUMNS) + "\n").encode())
            for frame in simulate_frames(scene):
                writer.add(frame)
                label_file.stream.write(_rows(frame).encode())
                on_frame(frame)
            writer.finish()
        except BaseException:
            writer.abort()
            raise


def _rows(frame: SimulatedFrame) -> str:
    """Return the CSV lines of a frame's labels."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    boxes = frame.boxes
    for track, kind, center, size, yaw in zip(
        boxes.tracks, boxes.classes, boxes.centers, boxes.sizes, boxes.yaws, strict=True
    ):
        numbers = (f"{value:.3f}" for value in (*center, *size))
        writer.writerow((frame.index, track, kind, *numbers, f"{yaw:.4f}"))
    return text.getvalue()
