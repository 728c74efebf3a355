"""Inputs whose cost could be out of proportion to their size: seconds and peak memory of each command.

Run as ``python benchmarks/out_of_proportion.py FOLDER [WORD]`` on Linux or macOS. With ``WORD``, only cases run that
have it in their names.
"""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.filters import FILTERS
from seaclutter_cli.records import Attachment, Channel, Message, Metadata
from seaclutter_cli.sinks.mcap_writer import McapWriter
from seaclutter_cli.sources.formats import open_source

SAMPLES = Path(__file__).resolve().parent.parent / "samples"
SEA, TILE = SAMPLES / "sea.mcap", SAMPLES / "tile.laz"
MANY, LABELS, POINTS = 20_000, 200_000, 300_000
TIMEOUT_S = 120
HEADER = "frame,track_id,class,x,y,z,length,width,height,yaw"

Case = tuple[Path, list[list[object]]]
"""Input, and the arguments of each command."""


def noisy_tiles(folder: Path) -> Iterator[Case]:
    """Insert 12 kB of noise into a LAS tile: in front of, within and after its points."""
    import laspy

    tile = folder / "tile.las"
    laspy.read(TILE).write(tile)
    data = tile.read_bytes()
    for percent in (20, 50, 95):
        at = len(data) * percent // 100
        path = folder / f"noise_at_{percent}.las"
        path.write_bytes(data[:at] + random.Random(percent).randbytes(12_000) + data[at:])
    whole = laspy.read(tile)
    for points, outliers in ((161_374, 400), (30_000, 180)):
        some = laspy.LasData(whole.header, whole.points[:points].copy())
        some.x[:outliers] += np.arange(outliers) * 1000
        some.write(folder / f"outliers_{outliers}.las")
    for path in sorted(folder.glob("[no]*_*.las")):
        separate = ["classify", "separate", path, "-o", folder / "out.las", "--force"]
        yield path, [separate, ["info", path], [*filtering(path), "-m", "sea_surface"]]


def dense_frames(folder: Path) -> Iterator[Case]:
    """Put all points of a frame within a millimetre: at distinct places, and on a fine lattice."""
    rng = np.random.default_rng(0)
    spread = rng.uniform(0, 0.001, (POINTS, 3))
    diagonal = rng.normal(size=(POINTS, 3))
    diagonal *= 0.0005 / np.linalg.norm(diagonal, axis=1, keepdims=True)
    diagonal[::2] += 1.5011 / np.sqrt(3)  # just beyond the tolerance of clusters
    for name, places in (("distinct", spread), ("lattice", np.round(spread, 4)), ("two_balls", diagonal)):
        path = folder / f"{name}.npy"
        np.save(path, cloud(places + np.array([30, 0, 0]), rng))
        labels = folder / "box.csv"
        labels.write_text(f"{HEADER}\n0,1,ship,30,0,0,4,4,4,0\n")
        for method in FILTERS:
            yield path, [[*filtering(path), "-m", method]]
        scored = evaluation(folder, path, labels)
        dense = [*scored, "--clustering", "dbscan"]
        report = ["report", path, "-m", "none", "-o", folder / "out.html", "--force"]
        yield path, [scored, dense, report, ["info", path]]


def cloud(places: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.void]:
    points = np.empty(len(places), [(name, "<f8") for name in ("x", "y", "z", "intensity")])
    for axis, values in zip("xyz", places.T, strict=True):
        points[axis] = values
    points["intensity"] = rng.integers(20, 255, len(places))
    return points


def wide_tables(folder: Path) -> Iterator[Case]:
    """Write tables of points and of labels with a line of 200 MB, and with a million columns."""
    line = [b"1," * 500_000] * 200
    rows = {"points": (b"x,y,z,intensity", b"30,1,2,9"), "labels": (HEADER.encode(), b"0,1,ship,30,0,0,4,4,4,0")}
    for kind, (head, row) in rows.items():
        for name, content in (
            ("long_line", [head, b"\n", row, b"\n", *line, b"\n"]),
            ("long_head", [*line, b"\n", row, b"\n"]),
            ("columns", chain([head], column_names(), [b"\n", row], [b",1"] * 1_000_000, [b"\n"])),
            ("one_cell", [head, b"\n", row, *[b"1" * 1_000_000] * 200, b"\n"]),
        ):
            path = folder / f"{kind}_{name}.csv"
            with path.open("wb") as file:  # in pieces: a command begins with the peak memory of this process
                file.writelines(content)
            yield path, [["info", path], filtering(path)] if kind == "points" else [evaluation(folder, SEA, path)]
            path.unlink()


def column_names() -> Iterator[bytes]:
    return (b",c%d" % number for number in range(1_000_000))


def many_labels(folder: Path) -> Iterator[Case]:
    """Label one frame with 200,000 boxes, in each form, and with as many tracks of points."""
    box = "{},{},ship,{:.2f},0,0,4,4,4,0\n"
    for name, place in (("row", lambda k: 0.01 * k - 1000), ("pile", lambda _: 30.0), ("far", lambda _: 1e6)):
        path = folder / f"{name}.csv"
        path.write_text(HEADER + "\n" + "".join(box.format(0, k, place(k)) for k in range(LABELS)))
        yield path, [evaluation(folder, SEA, path)]
        few = folder / f"{name}_1_MB.csv"
        few.write_text(HEADER + "\n" + "".join(box.format(0, k, place(k)) for k in range(30_000)))
        yield few, [evaluation(folder, SEA, few), calibration(folder, SEA, few)]
    same = folder / "same_tracks.csv"
    same.write_text(HEADER + "\n" + box.format(0, "", 30) * LABELS)
    yield same, [evaluation(folder, SEA, same)]
    for form, item in JSON_FORMS.items():
        sequence = folder / form
        frames, labels = sequence / FRAMES[form], sequence / LABEL_FOLDERS[form]
        frames.mkdir(parents=True, exist_ok=True)
        labels.mkdir(exist_ok=True)
        rng = np.random.default_rng(0)
        write_pcd(frames / "000000.pcd", rng.uniform(-50, 50, (60_000, 3)))
        text = ",".join([item] * 6000)
        (labels / "000000.json").write_text(f"[{text}]" if form == "sustechpoints" else f'{{"labels":[{text}]}}')
        yield labels / "000000.json", [evaluation(folder, frames if form == "sustechpoints" else sequence, sequence)]
    tracks = folder / "tracks" / "velodyne" / "000000.bin"
    file = folder / "tracks" / "labels" / "000000.label"
    for path in (tracks, file):
        path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    points = np.column_stack((rng.uniform(-50, 50, (LABELS, 3)), rng.uniform(0, 255, LABELS)))
    points.astype("<f4").tofile(tracks)
    (np.arange(LABELS, dtype="<u4") + (1 << 16)).tofile(file)
    yield file, [evaluation(folder, folder / "tracks" / "velodyne", folder / "tracks")]


SIZE = '{"x":4,"y":4,"z":4}'
JSON_FORMS = {
    "sustechpoints": '{"obj_id":"","obj_type":"Ship","psr":{"position":{"x":30,"y":0,"z":0},'
    f'"rotation":{{"x":0,"y":0,"z":0}},"scale":{SIZE}}}}}',
    "seepersea": '{"category":"ship","box3d":{"dimension":{"width":4,"length":4,"height":4},'
    '"location":{"x":30,"y":0,"z":0},"orientation":{"rotationYaw":0}}}',
}
FRAMES = {"sustechpoints": "lidar", "seepersea": "point_clouds"}
LABEL_FOLDERS = {"sustechpoints": "label", "seepersea": "annotations"}


def write_pcd(path: Path, places: NDArray[np.float64]) -> None:
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(places)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(places)}\nDATA binary\n"
    )
    rows = np.column_stack((places, np.full(len(places), 50.0))).astype("<f4")
    path.write_bytes(head.encode() + rows.tobytes())


def many_records(folder: Path) -> Iterator[Case]:
    """Add 20,000 metadata records, topics, or attachments to a log of three frames."""
    clouds = [record for record in open_source(SEA).records() if isinstance(record, Message)][:3]
    channel = clouds[0].channel
    others = [Channel(number, f"/topic_{number}", "json", channel.schema) for number in range(100, 100 + MANY)]
    adding: dict[str, Callable[[McapWriter], object]] = {
        "metadata": lambda log: [log.add_metadata(Metadata(f"m{number}", {"key": "x"})) for number in range(MANY)],
        "attachments": lambda log: [log.attach(Attachment(0, 0, f"a{number}", "", b"x")) for number in range(MANY)],
        "topics": lambda log: [log.add_channel(other) for other in others],
        "cloud_topics": lambda log: [
            (log.add_channel(other), log.write(other.id, 0, 0, 0, b"x"))
            for other in (Channel(c.id, c.topic, "cdr", c.schema) for c in others)
        ],
        "used_topics": lambda log: [(log.add_channel(other), log.write(other.id, 0, 0, 0, b"{}")) for other in others],
    }
    for name, add in adding.items():
        path = folder / f"{name}.mcap"
        with path.open("wb") as stream:
            log = McapWriter(stream, profile="ros2", compression="zstd")
            log.add_channel(channel)
            for cloud in clouds:
                log.write(channel.id, cloud.log_time_ns, cloud.publish_time_ns, cloud.sequence, cloud.data)
            add(log)
            log.finish()
        topic = ["-t", channel.topic] if name == "cloud_topics" else []
        whole = [["info", path], filtering(path)] if topic else []
        yield path, [["info", path, *topic], [*filtering(path), *topic], *whole]
    many = folder / "pairs.mcap"
    with many.open("wb") as stream:
        log = McapWriter(stream, profile="ros2", compression="zstd")
        log.add_channel(channel)
        for cloud in clouds:
            log.write(channel.id, cloud.log_time_ns, cloud.publish_time_ns, cloud.sequence, cloud.data)
        log.add_metadata(Metadata("many", {f"key{number}": "x" for number in range(50_000)}))
        log.finish()
    yield many, [["info", many], filtering(many)]


def filtering(path: Path) -> list[object]:
    return ["filter", path, "-o", path.with_name("out.mcap"), "--force"]


def evaluation(folder: Path, log: Path, labels: Path) -> list[object]:
    return ["evaluate", log, "--labels", labels, "-m", "none", "-n", 1, "-o", folder / "out.csv", "--force"]


def calibration(folder: Path, log: Path, labels: Path) -> list[object]:
    return ["calibrate", log, "--labels", labels, "-n", 1, "-o", folder / "out.yaml", "--force"]


CASES: dict[str, Callable[[Path], Iterator[Case]]] = {
    "noise in a tile": noisy_tiles,
    "points within 1 mm": dense_frames,
    "wide tables": wide_tables,
    "labels of a frame": many_labels,
    "records of a log": many_records,
}


def measure(arguments: list[object]) -> tuple[float, float, int, str]:
    """Return elapsed seconds, peak memory in MB, exit status and last line of a command."""
    command = [sys.executable, "-m", "seaclutter_cli", *map(str, arguments)]
    started = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        old = signal.signal(signal.SIGALRM, lambda *_: process.kill())
        signal.alarm(TIMEOUT_S)
        assert process.stderr
        lines = process.stderr.read().splitlines()
        _, status, usage = os.wait4(process.pid, 0)
        signal.alarm(0)
        signal.signal(signal.SIGALRM, old)
        process.returncode = os.waitstatus_to_exitcode(status)
    unit = 2**20 if sys.platform == "darwin" else 2**10
    seconds = time.perf_counter() - started
    return seconds, usage.ru_maxrss / unit, process.returncode, lines[-1][:100] if lines else ""


def main(folder: Path, word: str = "") -> None:
    folder.mkdir(parents=True, exist_ok=True)
    print(f"{'input':<28}{'kB':>9}  {'command':<28}{'s':>7}{'MB':>7}{'exit':>6}  last line")
    for name, cases in CASES.items():
        if word in name:
            for path, commands in cases(folder):
                for arguments in commands:
                    seconds, peak, status, line = measure(arguments)
                    method = arguments[arguments.index("-m") + 1] if "-m" in arguments else ""
                    shown = " ".join(str(part) for part in (*arguments[: 1 + (arguments[0] == "classify")], method))
                    size = path.stat().st_size / 1000
                    print(
                        f"{path.name:<28}{size:>9,.0f}  {shown:<28}{seconds:>7.1f}{peak:>7.0f}{status:>6}  {line}",
                        flush=True,
                    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
