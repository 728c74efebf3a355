"""Every command: no two outputs are one file, no output is an input, and all outputs appear together."""

import os
import pickle
import re
import shlex
from importlib.util import find_spec
from pathlib import Path

import pytest

from seaclutter_cli.errors import OutputError
from seaclutter_cli.runs.outputs import PackedRows
from seaclutter_cli.sinks.atomic import AtomicFile
from seaclutter_cli.sources.recordings import Recording
from tests.airborne.tiles import write_labelled
from tests.pairs import covering
from tests.paths import ROOT
from tests.running import execute
from tests.scenes.onnx_files import model_bytes

SAMPLES = ROOT / "samples"


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Return a model of objects, trained on few trees."""
    pytest.importorskip("skops")
    path = tmp_path_factory.mktemp("model") / "model.skops"
    run(f"classify train {write_labelled(path.with_name('tile.laz'))} -s forest.trees=3 -o {path}")
    return path.read_bytes()


@pytest.fixture
def folder(tmp_path, monkeypatch, request):
    """Return a folder with a file of every kind of input."""
    for name in ("sea.mcap", "sea.labels.csv"):
        (tmp_path / name).write_bytes((SAMPLES / name).read_bytes())
    if find_spec("laspy") is None:
        (tmp_path / "tile.laz").write_bytes(b"")
    else:
        write_labelled(tmp_path / "tile.laz")
    (tmp_path / "config.yaml").write_text("filter: {method: joint}\n")
    (tmp_path / "settings.yaml").write_text("forest: {trees: 3}\n")
    (tmp_path / "angles.csv").write_text("")
    (tmp_path / "model.onnx").write_bytes(model_bytes(threshold=0.008))
    (tmp_path / "scene.yaml").write_text("recording: {frames: 1}\n")
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "sea.labels.csv").write_bytes((SAMPLES / "sea.labels.csv").read_bytes())
    if "model.skops" in str(request.node.callspec.params if hasattr(request.node, "callspec") else ""):
        (tmp_path / "model.skops").write_bytes(request.getfixturevalue("model"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(line):
    return execute(*shlex.split(line))


def content(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def needs(line):
    if "scene " in line:
        pytest.importorskip("onnxruntime")
    if "scene train" in line:
        pytest.importorskip("torch")
    if "classify" in line or ".laz" in line:
        pytest.importorskip("laspy")
        pytest.importorskip("skops")


EVALUATE = "evaluate sea.mcap --labels sea.labels.csv -n 2"
TUNE = "tune sea.mcap --labels sea.labels.csv -n 2 --sweep update_weight=0.2,1"
PREDICT = "classify predict tile.laz --model model.skops"

TWO = [
    ("filter sea.mcap -n 2 -o {0} --csv {1}", "x.mcap"),
    ("calibrate sea.mcap -n 2 -o {0} --plot {1}", "x.svg"),
    (f"{EVALUATE} -o {{0}} --summary {{1}}", "x.csv"),
    (f"{TUNE} -o {{0}} --csv {{1}}", "x.yaml"),
    (f"{TUNE} --plot {{0}} --plot-thresholds {{1}}", "x.svg"),
    ("simulate scene.yaml -o {0} --scene-file {1}", "x.mcap"),
    ("simulate fig3 -o {0} --scene-file {1}", "x.laz"),
    ("classify train tile.laz -o {0} --plot {1}", "x.svg"),
    (f"{PREDICT} -o x.laz --csv {{0}} --geojson {{1}}", "x.csv"),
    (f"{PREDICT} -o {{0}} --csv {{1}}", "x.laz"),
    ("scene train --scene open=sea.mcap --scene confined=sea.mcap -o {0} --plot {1}", "x.onnx"),
]


ALIASES = ("same", "./x", "sub/../x", "absolute", "link", "link of folder", "hard link")


@pytest.mark.parametrize(("output", "other"), covering(TWO, ALIASES))
def test_two_outputs_under_one_name(folder, output, other):
    line, name = output
    needs(line)
    if "link" in other and os.name != "posix":
        pytest.skip("links need rights on Windows")
    (folder / "sub").mkdir()
    second = {"./x": f"./{name}", "sub/../x": f"sub/../{name}", "absolute": folder / name}.get(other, name)
    if other == "link":
        second = f"link{Path(name).suffix}"
        (folder / second).symlink_to(name)
    elif other == "link of folder":
        (folder / "here").symlink_to(".")
        second = f"here/{name}"
    elif other == "hard link":
        second = f"link{Path(name).suffix}"
        (folder / name).write_bytes(b"precious")
        os.link(folder / name, folder / second)
    before = content(folder)
    result = run(f"{line.format(name, second)} --force")
    assert result.exit_code == 2, result.output
    assert re.search(r"^Error: \S+: is given for two outputs, -\S+ and -\S+\n$", result.stderr), result.stderr
    assert content(folder) == before


@pytest.mark.parametrize(
    ("line", "options"),
    [
        ("simulate scene.yaml -o z.mcap --scene-file z.labels.csv", "the labels of -o and --scene-file"),
        ("report sea.mcap -n 2 -o figures/reasons.svg --figures figures", "-o and --figures"),
        ("filter sea.mcap labels/../sea.mcap -n 2 -o out/ --csv out/sea.mcap", "-o and --csv"),
    ],
)
def test_an_output_that_another_option_implies(folder, line, options):
    before = content(folder)
    result = run(line)
    assert result.exit_code == 2, result.output
    assert f"is given for two outputs, {options}" in result.stderr
    assert content(folder) == before


def test_an_output_that_is_the_folder_of_another(folder):
    result = run("filter sea.mcap -n 2 -o out/sea.mcap --csv out")
    assert result.exit_code == 2
    assert result.stderr == "Error: out: is given for a file, --csv, and a folder, -o\n"


READ = [
    ("filter {0} -n 2 -o {1}", "sea.mcap", "LOGS"),
    ("filter {0} -n 2 -o x.mcap --csv {1}", "sea.mcap", "LOGS"),
    ("filter sea.mcap -c {0} -o {1}", "config.yaml", "-c"),
    ("filter sea.mcap --calibration {0} -o {1}", "angles.csv", "--calibration"),
    ("filter sea.mcap --with-scene --labels {0} -o {1}", "sea.labels.csv", "--labels"),
    ("filter sea.mcap -m adaptive_radius -s filter.scene_model={0} -o {1}", "model.onnx", "filter.scene_model"),
    ("calibrate sea.mcap --labels {0} -o {1}", "sea.labels.csv", "--labels"),
    ("calibrate sea.mcap --labels labels -o {1}", "labels/sea.labels.csv", "--labels"),
    ("calibrate sea.mcap -c {0} -o {1}", "config.yaml", "-c"),
    ("evaluate sea.mcap --labels {0} -o {1}", "sea.labels.csv", "--labels"),
    ("evaluate sea.mcap --labels sea.labels.csv --summary {1}", "sea.mcap", "LOGS"),
    ("evaluate sea.mcap --labels labels --summary {1}", "labels/sea.labels.csv", "--labels"),
    ("evaluate sea.mcap --labels sea.labels.csv -c {0} -o {1}", "config.yaml", "-c"),
    ("tune sea.mcap --labels {0} --sweep update_weight=0.2,1 --csv {1}", "sea.labels.csv", "--labels"),
    ("tune sea.mcap --labels sea.labels.csv -c {0} --sweep update_weight=0.2,1 -o {1}", "config.yaml", "-c"),
    ("report {0} -o {1}", "sea.mcap", "LOGS"),
    ("report sea.mcap --labels {0} -o {1}", "sea.labels.csv", "--labels"),
    ("report sea.mcap -c {0} -o {1}", "config.yaml", "-c"),
    ("simulate {0} -o x.mcap --scene-file {1}", "scene.yaml", "SCENE"),
    ("classify separate {0} -o {1}", "tile.laz", "TILE"),
    ("classify separate tile.laz -c {0} -o {1}", "settings.yaml", "-c"),
    ("classify train {0} -o {1}", "tile.laz", "TILE"),
    ("classify train tile.laz -c {0} -o {1}", "settings.yaml", "-c"),
    ("classify predict tile.laz --model {0} -o {1}", "model.skops", "--model"),
    ("classify predict tile.laz --model model.skops -o x.laz --csv {1}", "model.skops", "--model"),
    ("scene predict {0} --csv {1}", "sea.mcap", "LOGS"),
    ("scene predict sea.mcap --model {0} --csv {1}", "model.onnx", "--model"),
    ("scene evaluate --scene open={0} --csv {1}", "sea.mcap", "LOGS"),
]


@pytest.mark.parametrize(("read", "other"), covering(READ, ("same", "odd", "link", "hard link")))
def test_an_output_that_is_an_input(folder, read, other):
    line, name, option = read
    needs(line)
    if "link" in other and os.name != "posix":
        pytest.skip("links need rights on Windows")
    second = f"labels/../{name}" if other == "odd" else name
    if "link" in other:
        second = f"alias{Path(name).suffix}"
        (os.link if other == "hard link" else os.symlink)(folder / name, folder / second)
    before = content(folder)
    result = run(f"{line.format(name, second)} --force")
    assert result.exit_code == 2, result.output
    expected = rf"Error: \S+: is part of the input, {re.escape(option)}; choose another output for -\S+\n"
    assert re.fullmatch(expected, result.stderr), result.stderr
    assert content(folder) == before


@pytest.mark.parametrize(
    ("frames", "times"),
    [
        ("velodyne", "times.txt"),
        ("velodyne_points/data", "velodyne_points/timestamps.txt"),
        ("point_clouds", "timestamp/000000.txt"),
    ],
)
def test_times_beside_a_folder_of_frames_are_an_input(folder, frames, times):
    (folder / frames).mkdir(parents=True)
    (folder / frames / "000000.csv").write_text("x,y,z,intensity\n1,2,3,4\n")
    (folder / times).parent.mkdir(exist_ok=True)
    (folder / times).write_text("0\n")
    for log in (frames, f"{frames}/000000.csv"):
        result = run(f"filter {log} -o x.mcap --csv {times} --force")
        assert result.exit_code == 2
        assert f"{times}: is part of the input, LOGS" in result.stderr
    assert (folder / times).read_text() == "0\n"


def test_metadata_beside_a_capture_is_an_input(folder):
    (folder / "trial.pcap").write_bytes((SAMPLES / "rs-lidar-32.pcap").read_bytes())
    for name in ("trial.json", "trial_os.json"):
        (folder / name).write_text("{}")
        result = run(f"filter trial.pcap -o x.mcap --csv {name} --force")
        assert result.exit_code == 2
        assert f"Error: {name}: is part of the input, LOGS" in result.stderr
    assert run("filter trial.pcap -n 1 -o x.mcap --csv other.json").exit_code == 0


@pytest.mark.skipif(os.name != "posix", reason="special files")
@pytest.mark.parametrize(
    "line",
    [
        f"{EVALUATE} -o x",
        f"{EVALUATE} --summary x",
        "scene predict sea.mcap --model model.onnx --csv x",
        "scene evaluate --scene open=sea.mcap --model model.onnx --csv x",
    ],
)
def test_an_output_that_cannot_be_written_shows_before_the_work(folder, line, monkeypatch):
    needs(line)
    os.mkfifo(folder / "x")
    monkeypatch.setattr(Recording, "open", lambda *_, **__: pytest.fail("opened"))
    result = run(f"{line} --force")
    assert result.exit_code == 2, result.output
    assert "x: not a regular file, cannot be replaced" in result.stderr


TOGETHER = [
    ("filter sea.mcap -n 2", {"-o": "x.mcap", "--csv": "x.csv"}),
    ("calibrate sea.mcap -n 2", {"-o": "x.yaml", "--plot": "x.svg"}),
    (EVALUATE, {"-o": "x.csv", "--summary": "x.json"}),
    (TUNE, {"-o": "x.yaml", "--csv": "x.csv", "--plot": "x.svg", "--plot-thresholds": "y.svg"}),
    ("report sea.mcap -n 2", {"-o": "x.html"}),
    ("report sea.mcap -n 2 --figures .", {"-o": "x.html", None: "reasons.svg thresholds.svg"}),
    ("simulate scene.yaml", {"-o": "x.mcap", None: "x.labels.csv", "--scene-file": "x.yaml"}),
    ("simulate tile.yaml", {"-o": "x.laz", "--scene-file": "x.yaml"}),
    ("classify separate tile.laz", {"-o": "x.laz"}),
    ("classify train tile.laz -s forest.trees=3 -s forest.test_share=0.4", {"-o": "x.skops", "--plot": "x.svg"}),
    (PREDICT, {"-o": "x.laz", "--csv": "x.csv", "--geojson": "x.json", "--plot": "x.svg"}),
    ("scene predict sea.mcap -n 2 --model model.onnx", {"--csv": "x.csv"}),
    ("scene evaluate -n 2 --scene open=sea.mcap --model model.onnx", {"--csv": "x.csv"}),
]
TILE = "tile: {size_m: [60, 60], gap_m: 8}\nlidar: {pulses_m2: 0.5}\nrandom: {ship: 1}\n"


def together(folder, line, outputs):
    """Prepare a run over existing outputs; return its command line and the names of the outputs, the main one first."""
    needs(line)
    (folder / "tile.yaml").write_text(TILE)
    options = " ".join(f"{option} {name}" for option, name in outputs.items() if option)
    return f"{line} {options} --force", [name for names in outputs.values() for name in names.split()]


@pytest.mark.parametrize(("line", "outputs"), TOGETHER)
def test_outputs_appear_together_and_the_main_one_last(folder, line, outputs, monkeypatch):
    line, names = together(folder, line, outputs)
    waiting, appeared = [], []
    publish = AtomicFile.publish

    def record(file, *, replace=True):
        if file.path.parent.suffix != ".part":  # else it is staged for later
            parts = [part for path in folder.glob(".*.part") for part in (path.iterdir() if path.is_dir() else [path])]
            waiting.append({re.sub(r"^\.(.*)\.[^.]+\.part$", r"\1", path.name) for path in parts})
            appeared.append(file.path.name)
        publish(file, replace=replace)

    monkeypatch.setattr(AtomicFile, "publish", record)
    result = run(line)
    assert result.exit_code == 0, result.output
    assert set(appeared) == waiting[0]
    assert set(names) <= set(appeared)
    assert appeared[-1] == names[0]


@pytest.mark.parametrize(("given", "error"), covering(TOGETHER, (OutputError("no space"), KeyboardInterrupt())))
def test_a_failure_at_the_very_end_changes_nothing(folder, given, error, monkeypatch):
    line, names = together(folder, *given)
    for name in names:
        (folder / name).write_text("precious")
    before = content(folder)

    def fail(file, *, replace=True):
        if file.path.name == names[0]:
            raise error

    monkeypatch.setattr(AtomicFile, "prepare", fail)
    assert run(line).exit_code == (130 if isinstance(error, KeyboardInterrupt) else 1)
    assert content(folder) == before


BROKEN = [
    ("evaluate sea.mcap --labels broken.csv -o {0} --summary {1}", 2),
    ("tune sea.mcap --labels broken.csv --sweep update_weight=0.2,1 -o {0} --csv {1}", 2),
    ("filter broken.mcap -o {0} --to mcap --csv {1}", 2),
    ("filter broken.mcap sea.mcap -n 2 -o new/ --csv {0}", 1),
    ("evaluate sea.mcap broken.mcap --labels sea.labels.csv --labels sea.labels.csv -n 2 -o {0} --summary {1}", 2),
    ("report broken.mcap -o {0}", 1),
    ("report sea.mcap broken.mcap -n 2 -o {0}", 1),
    ("calibrate sea.mcap broken.mcap -n 2 -o {0} --plot {1}", 2),
    ("scene predict sea.mcap broken.mcap -n 2 --model model.onnx --csv {0}", 1),
]


@pytest.mark.parametrize(("line", "outputs"), BROKEN)
def test_results_of_failed_runs_do_not_replace_good_ones(folder, line, outputs):
    needs(line)
    (folder / "broken.mcap").write_bytes((SAMPLES / "sea.mcap").read_bytes()[:40])
    labels = (SAMPLES / "sea.labels.csv").read_text()
    (folder / "broken.csv").write_text(f"{labels}99999,1,ship,0,0,0,1,1,1,0\n")
    for name in ("a.png", "b.png"):
        (folder / name).write_text("precious")
    before = content(folder)
    result = run(f"{line.format('a.png', 'b.png')} --force")
    assert result.exit_code == 1, result.output
    after = content(folder)
    assert {name: after.get(name) for name in before} == before
    new = {name for name in after if name not in before}
    assert new == ({"new/sea.mcap"} if "new/" in line else set())
    partly = "sea.mcap" in line and "broken.mcap" in line and line.split()[0] not in ("calibrate", "report")
    assert ("not replaced, because of the error in broken" in result.stderr) == partly


def test_a_slash_at_the_end_means_a_folder(folder):
    for output, made in (("out/", "out/sea.mcap"), ("out2/.", "out2")):
        assert run(f"filter sea.mcap -n 1 -o {output}").exit_code == 0
        assert (folder / made).is_file()
    pytest.importorskip("laspy")
    assert run("classify separate tile.laz -o tiles/").exit_code == 0
    assert (folder / "tiles" / "tile.laz").is_file()


@pytest.mark.parametrize(
    "line",
    [
        "calibrate sea.mcap -o new/",
        "evaluate sea.mcap --labels sea.labels.csv -o new/",
        "evaluate sea.mcap --labels sea.labels.csv --summary new/",
        "simulate scene.yaml -o new.mcap/",
        "filter sea.mcap -o x.mcap --csv new/",
        "report sea.mcap -o new.html/",
    ],
)
def test_files_that_are_given_as_folders(folder, line):
    before = content(folder)
    result = run(line)
    assert result.exit_code == 2
    assert "names a folder by the slash at its end" in result.stderr
    assert content(folder) == before


@pytest.mark.parametrize(
    "line",
    [
        "filter sea.mcap -n 1 -o a/b/x.mcap",
        "filter sea.mcap -n 1 -o a/b/",
        "filter sea.mcap -n 1 -o x.mcap --csv a/b/x.csv",
        "calibrate sea.mcap -n 1 -o a/b/x.yaml",
        "report sea.mcap -n 1 -o x.html --figures a/b",
        "simulate scene.yaml -o a/b/x.mcap",
    ],
)
def test_at_most_one_folder_is_created(folder, line):
    result = run(line)
    assert result.exit_code == 2
    assert "there is no folder a; create it first" in result.stderr
    (folder / "a").mkdir()
    assert run(line).exit_code == 0


def test_many_rows_of_a_table_leave_memory(monkeypatch):
    monkeypatch.setattr("seaclutter_cli.runs.outputs._PACKED_BYTES", 1000)
    rows, lines = PackedRows(), [f"{number},{number**9 % 7919}\n".encode() for number in range(20_000)]
    for line in lines:
        rows.write(line)
    assert rows.packed._rolled, "into a file"
    assert list(rows) == list(pickle.loads(pickle.dumps(rows))) == lines
