"""Digests of the outputs of every command, to verify that a change of the code does not change them.

Run as ``python benchmarks/outputs.py FOLDER TABLE.csv [RECORDINGS]`` before and after a change and compare the tables.
Logs in every format are written to FOLDER once and reused; RECORDINGS is a folder of real recordings. Set
``SEACLUTTER_PYTHON`` to the interpreter of another checkout to run that one. Times in JSON are ignored. An MCAP file
has a second digest of its messages only, which does not depend on the version or the text of the configuration.
"""

import csv
import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SAMPLES = ROOT / "samples"
PYTHON = os.environ.get("SEACLUTTER_PYTHON", sys.executable)
TIMES = ("seconds", "filter_ms")
METHODS = (
    *("joint", "ring_intensity", "ring_intensity_outlier", "global_intensity", "sor", "ror", "dror", "dsor", "lior"),
    *("lidsor", "naive", "adaptive_radius", "sea_surface", "confirmed", "none"),
)
SCENES = (
    *("departure", "passing_speedboat", "buoy_speedboat", "occlusion", "calm", "rough", "harbour", "lock"),
    *("moored_rows", "narrow_channel", "clutter_only", "apple", "poplar", "willow"),
    *("open_sea", "regatta", "pile_field", "moored_boats", "lock_chamber", "river", "willow_grove"),
)
LIDARS = ("RS-LiDAR-16", "VLP-16", "OS1-64", "OS1-128", "CE30-D")
LOG = "-o OUT/f.mcap --json"
TABLE = "-o OUT/f.mcap --csv OUT/f.csv --json"
LABELLED = "sea.mcap --labels sea.labels.csv"
RUNS = f"""
filter-removed: filter sea.mcap --keep-raw --with-removed --with-scene {LOG}
filter-scene: filter {LABELLED} --with-scene {LOG}
filter-part: filter sea.mcap --start 1.5 --end 3.2 {TABLE}
filter-frames: filter sea.mcap --start 1 -n 5 {TABLE}
filter-auto: filter sea.mcap -m adaptive_radius -s filter.scene=auto {LOG}
filter-lz4: filter sea.mcap --compression lz4 --no-diagnostics {LOG}
filter-organized: filter snow.mcap -c snow --keep-organized {LOG}
filter-snow: filter snow.mcap -c snow {LOG}
filter-capture: filter rs-lidar-32.pcap {TABLE}
filter-many: filter layouts/zstd.mcap layouts/lz4.mcap -o OUT/many --csv OUT/f.csv --json
calibrate: calibrate sea.mcap -o OUT/c.yaml --plot OUT/c.svg --json
calibrate-labels: calibrate {LABELLED} --filter-rate 0.9 -o OUT/c.yaml --json
calibrate-text: calibrate {LABELLED} -o OUT/c.yaml --keep-end
evaluate: evaluate {LABELLED} --compare all -o OUT/e.csv --summary OUT/e.json --json
evaluate-dbscan: evaluate {LABELLED} --clustering dbscan -o OUT/e.csv --json
evaluate-cloud: evaluate sea.mcap --labels sea.mcap -o OUT/e.csv --json
evaluate-capture: evaluate rs-lidar-32.pcap --labels rs-lidar-32.labels.csv -o OUT/e.csv --json
tune: tune {LABELLED} --sweep update_weight=0.2:0.8:0.2 -o OUT/t.yaml --csv OUT/t.csv --json
tune-methods: tune {LABELLED} -m joint -m ror --sweep ror.min_neighbors=3,5 --csv OUT/t.csv --json
labels-check: labels check {LABELLED} --json
tune-plot: tune {LABELLED} --sweep std_ratio=0.5,1 --plot OUT/t.svg --plot-thresholds OUT/h.svg --json
tune-two: tune {LABELLED} --sweep std_ratio=0.5,1 --sweep max_neighbors=10,30 -o OUT/t.yaml --json
report: report {LABELLED} --compare paper -o OUT/r.html --figures OUT/figures --json
report-plain: report sea.mcap -o OUT/r.html --pick 3 --json
scene-predict: scene predict sea.mcap --csv OUT/s.csv --json
simulate-pcap: simulate calm -n 2 -o OUT/l.pcap --json
simulate-tile: simulate small --seed 3 -o OUT/t.laz --scene-file OUT/s.yaml --json
separate: classify separate tile.laz --with-height -o OUT/t.laz --json
separate-pcd: classify separate tile.laz -o OUT/t.pcd --json
train: classify train tile.laz -s forest.trees=20 --plot OUT/m.svg -o OUT/m.skops --json
predict: classify predict tile.laz --model ../model.skops -o OUT/t.laz --csv OUT/o.csv --geojson OUT/o.json --json
predict-plot: classify predict tile.laz --model ../model.skops -o OUT/t.laz --plot OUT/o.svg
config-show: config show --json
config-sensors: config sensors --json
"""
"""Name and arguments of each run; OUT is replaced by its output folder."""


def make_inputs(folder: Path) -> None:
    """Write logs in every format and layout of the tests."""
    if folder.exists():
        return
    sys.path.insert(0, str(ROOT))
    from tests.logs import CLOUD_KINDS, LAYOUTS, cloud_log
    from tests.test_formats import FORMATS

    part = folder.with_suffix(".part")
    shutil.rmtree(part, ignore_errors=True)
    for name, write in FORMATS.items():
        (part / "formats" / name).mkdir(parents=True)
        write(part / "formats" / name)
    (part / "layouts").mkdir()
    for name, layout in LAYOUTS.items():
        cloud_log(part / "layouts" / f"{name.replace(', ', '-').replace(' ', '-')}.mcap", layout, frames=12)
    for kind in CLOUD_KINDS:
        cloud_log(part / "layouts" / f"{kind}-clouds.mcap", kind=kind, frames=12, topics=("/points", "/other"))
    (part / "damaged").mkdir()
    for name in ("zstd", "none", "unchunked"):
        data = (part / "layouts" / f"{name}.mcap").read_bytes()
        (part / "damaged" / f"{name}-cut.mcap").write_bytes(data[: len(data) * 2 // 3])
        broken = bytearray(data)
        broken[len(data) // 2] ^= 0x55
        (part / "damaged" / f"{name}-flipped.mcap").write_bytes(broken)
    bag = next((part / "formats" / "bag").glob("*.bag")).read_bytes()
    (part / "damaged" / "cut.bag").write_bytes(bag[: len(bag) * 2 // 3])
    for name in ("sea.mcap", "sea.labels.csv", "snow.mcap", "tile.laz", "rs-lidar-32.pcap", "rs-lidar-32.labels.csv"):
        shutil.copy(SAMPLES / name, part / name)
    part.rename(folder)


def cases(inputs: Path, recordings: Path | None) -> Iterator[tuple[str, list[str]]]:
    """Yield the name and the arguments of each run."""
    for line in RUNS.strip().splitlines():
        name, _, arguments = line.partition(": ")
        yield name, arguments.split()
    for method in METHODS:
        yield f"filter-{method}", f"filter sea.mcap -m {method} {TABLE}".split()
        yield f"config-{method}", ["config", "show", "-m", method]
    for scene in SCENES:
        yield (
            f"simulate-{scene}",
            f"simulate {scene} -n 2 --seed 7 -o OUT/l.mcap --scene-file OUT/s.yaml --json".split(),
        )
    for lidar in LIDARS:
        yield f"simulate-{lidar}", f"simulate buoy_speedboat --lidar {lidar} -n 2 -o OUT/l.mcap --json".split()
    yield from log_cases(inputs)
    yield from recording_cases(recordings) if recordings else ()


def log_cases(inputs: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the runs on complete and partial logs of every format and layout."""
    samples = [inputs / name for name in ("sea.mcap", "snow.mcap", "rs-lidar-32.pcap")]
    for path in (*sorted(inputs.glob("[fld][oa]*/*")), *samples):
        if path.parent.name == "formats":
            path = next(path.iterdir())  # noqa: PLW2901
        log = str(path.relative_to(inputs))
        topic = ["-t", "/other"] if log.endswith("-clouds.mcap") else []
        yield f"filter-{log}", ["filter", log, *topic, *TABLE.split()]
        yield f"part-{log}", ["filter", log, *topic, "--start", "0.15", "--end", "0.75", *TABLE.split()]
        yield f"info-{log}", ["info", log, "--json"]
        yield f"info-text-{log}", ["info", log]


def recording_cases(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the runs on real recordings."""
    for path in sorted((*folder.glob("ouster/*.pcap"), *folder.glob("nebula/*/"), *folder.glob("wads-36"))):
        metadata = path.with_name("windowed_frame1_0.json")
        given = ["--calibration", str(metadata)] if path.name.startswith("windowed") else []
        yield f"info-{path.name}", ["info", str(path), *given, "--json"]
        yield f"filter-{path.name}", ["filter", str(path), *given, *TABLE.split()]
    for path in sorted((*folder.glob("las/*.laz"), *folder.glob("airborne/*.laz"))):
        yield f"separate-{path.stem}", ["classify", "separate", str(path), "-o", "OUT/t.laz", "--json"]


def run(arguments: list[str], folder: Path) -> subprocess.CompletedProcess[bytes]:
    command = [PYTHON, "-m", "seaclutter_cli", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, check=False)


def timeless(value: Any) -> Any:
    """Return parsed JSON without times."""
    if isinstance(value, dict):
        return {key: timeless(item) for key, item in value.items() if key not in TIMES}
    return [timeless(item) for item in value] if isinstance(value, list) else value


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def messages_digest(path: Path) -> str:
    """Return a digest of the topics, times and data of the messages of an MCAP file."""
    from mcap.reader import NonSeekingReader

    found = hashlib.sha256()
    with path.open("rb") as stream:
        for _, channel, message in NonSeekingReader(stream).iter_messages():
            times = (message.log_time, message.publish_time, message.sequence)
            found.update(repr((channel.topic, channel.message_encoding, *times)).encode())
            found.update(message.data)
    return found.hexdigest()[:16]


def digests(name: str, arguments: list[str], inputs: Path, out: Path) -> Iterator[tuple[str, str]]:
    """Run a case; yield the name and digest of each output."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    done = run([argument.replace("OUT", str(out)) for argument in arguments], inputs)
    yield f"{name}: exit", str(done.returncode)
    text = done.stdout.replace(str(out).encode(), b"OUT")
    if "--json" in arguments and text:
        text = json.dumps(timeless(json.loads(text))).encode()
    yield f"{name}: stdout", digest(text)
    yield f"{name}: stderr", digest(done.stderr.replace(str(out).encode(), b"OUT"))
    for path in sorted(file for file in out.rglob("*") if file.is_file()):
        data = path.read_bytes().replace(str(out).encode(), b"OUT")
        if path.suffix == ".json":
            data = json.dumps(timeless(json.loads(data))).encode()
        yield f"{name}: {path.relative_to(out)}", digest(data)
        if path.suffix == ".mcap":
            yield f"{name}: {path.relative_to(out)}, messages", messages_digest(path)


def main(folder: Path, table: Path, recordings: Path | None) -> None:
    inputs = folder.resolve() / "inputs"
    folder.mkdir(parents=True, exist_ok=True)
    make_inputs(inputs)
    if not (folder / "model.skops").exists():
        run(["classify", "train", "tile.laz", "-o", "../model.skops", "-s", "forest.trees=20"], inputs)
    with table.open("w", newline="") as stream, TemporaryDirectory(dir=folder) as scratch:
        writer = csv.writer(stream, lineterminator="\n")
        for name, arguments in cases(inputs, recordings and recordings.resolve()):
            writer.writerows(digests(name, arguments, inputs, Path(scratch).resolve() / "out"))
            stream.flush()


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]), Path(sys.argv[3]) if len(sys.argv) > 3 else None)
