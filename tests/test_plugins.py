"""What installed packages add, methods of one's own, and that nothing else can name code."""

import importlib.util
import json
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

import seaclutter
from seaclutter.testing import check_filter
from seaclutter_cli import registry
from seaclutter_cli.errors import PluginWarning
from seaclutter_cli.filters import FILTERS, OPTIONAL
from seaclutter_cli.labels import LABELS
from seaclutter_cli.messages import CODECS
from seaclutter_cli.runs.methods import is_installed
from seaclutter_cli.sensors.families import PACKET_FAMILIES
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.sources.formats import SOURCES
from tests.paths import ROOT
from tests.plugin_package import EXAMPLE, install
from tests.running import execute
from tests.sources.pcap.captures import ETHERNET, ipv4, pcap, udp

SEA, LABELLED = ROOT / "samples" / "sea.mcap", ROOT / "samples" / "sea.labels.csv"
REGISTRIES = (FILTERS, SOURCES, PACKET_FAMILIES, CODECS, LABELS, OUTPUT_FORMATS)
MINE = '''
from dataclasses import dataclass
import numpy as np
from seaclutter import Filter, FilterResult, Reason

@dataclass(frozen=True)
class Params:
    least_m: float = -2.0

class Low(Filter):
    """Removes what is low."""
    Params = Params
    def step(self, frame):
        reason = np.where(frame.valid, Reason.KEPT, Reason.INVALID).astype(np.uint8)
        reason[frame.valid & (frame.xyz[:, 2] < self.params.least_m)] = Reason.OUTLIER
        return FilterResult(frame, reason)

def far(frame):
    return np.hypot(frame.xyz[:, 0], frame.xyz[:, 1]) > 20

class Half:
    def step(self, frame):
        return None
'''


def forget():
    registry.plugins.cache_clear()
    for one in REGISTRIES:
        vars(one).pop("added", None)
    for name in [name for name in sys.modules if name.startswith("seaclutter_example")]:
        del sys.modules[name]


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Return a function that installs a package in a folder outside, as `install`."""
    forget()

    def put(**given):
        folder = install(tmp_path / "site", **given)
        monkeypatch.syspath_prepend(folder)
        forget()
        return folder

    yield put
    forget()


@pytest.fixture
def mine(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(MINE)
    return file


@pytest.fixture
def trial(tmp_path):
    """Return a folder with two recordings and their labels."""
    folder = tmp_path / "trial"
    folder.mkdir()
    for name in ("a", "b"):
        (folder / f"{name}.mcap").write_bytes(SEA.read_bytes())
        (folder / f"{name}.labels.csv").write_bytes(LABELLED.read_bytes())
    return folder


def test_the_tests_of_the_example_pass(installed):
    folder = installed()
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", os.devnull, EXAMPLE / "tests"],
        env={**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_each_kind_is_used_by_the_commands(installed, tmp_path, trial):
    installed()
    log = tmp_path / "trial.points.txt"
    rows = [
        f"{1.7e9 + k / 10:.1f} {x} {y} {z} 50\n" for k in range(4) for x in (20, 21) for y in (1, 2) for z in (-2, 1)
    ]
    log.write_text("".join(rows))
    boxes = tmp_path / "trial.boxes.txt"
    boxes.write_text("".join(f"{k} hull 20.5 1.5 1 3 3 2\n" for k in range(4)))
    execute(
        "filter", log, "-m", "above_water", "-s", "height_m=1", "--to", "example_table", "-o", tmp_path / "out", code=0
    )
    kept = [np.loadtxt(file) for file in sorted((tmp_path / "out").glob("*.tab"))]
    assert [len(frame) for frame in kept] == [4] * 4
    assert all((frame[:, 2] == 1).all() for frame in kept)
    scores = json.loads(
        execute("evaluate", log, "--labels", boxes, "--compare", "peers", "-m", "none", "--json", code=0).stdout
    )
    assert "above_water" in scores["methods"]
    execute("report", trial / "a.mcap", "--labels", LABELLED, "-m", "above_water", "-o", tmp_path / "r.html", code=0)
    assert "above_water" in (tmp_path / "r.html").read_text()
    listed = execute("config", "list", "plugins", code=0).stdout
    assert "above_water (filters, seaclutter-example 1.0)" in " ".join(listed.split())
    assert "above_water" in execute("config", "list", "methods", code=0).stdout
    assert "seaclutter-example 1.0" in execute("--version", code=0).stdout
    assert "height_m: 0.8" in execute("config", "show", "-m", "above_water", code=0).stdout


def test_packets_and_messages(installed, tmp_path):
    installed()
    from seaclutter_example.cloud import ExampleCloud
    from seaclutter_example.sensor import PACKET

    from seaclutter.plugins import Channel, Message, Schema
    from seaclutter_cli.sinks.mcap_writer import McapWriter

    packets = np.zeros(60, PACKET)
    packets["magic"], packets["number"] = np.frombuffer(b"EXLI", "<u4")[0], np.arange(60)
    packets["revolution"], packets["time_ns"] = np.arange(60) // 20, 1_700_000_000 * 10**9 + np.arange(60) * 10**6
    packets["points"]["x"] = np.arange(480).reshape(60, 8)
    capture = tmp_path / "trial.pcap"
    capture.write_bytes(pcap([(int(row["time_ns"]), ETHERNET + ipv4(udp(row.tobytes()))) for row in packets]))
    with seaclutter.open_log(capture) as log:
        found = [frame.xyz[:, 0] for frame in log.frames()]
        assert log.sensors[log.topics[0]].model == "Example lidar"
    assert np.concatenate(found).tolist() == list(range(480))
    [frame] = seaclutter.testing.example_frames(1)
    log = tmp_path / "own.mcap"
    with log.open("wb") as stream:
        writer = McapWriter(stream, profile="")
        channel = Channel(1, "/own", "example", Schema("example.Cloud", "", b""))
        writer.add_channel(channel)
        writer.write(1, frame.stamp_ns, frame.stamp_ns, 0, ExampleCloud().encode(frame.cloud))
        writer.finish()
    seaclutter.filter_log(log, tmp_path / "kept.mcap", method="none")
    with seaclutter.open_log(tmp_path / "kept.mcap") as kept:
        [again] = kept.frames()
    assert np.array_equal(again.xyz, frame.xyz, equal_nan=True)
    assert isinstance(again.message, Message)


def test_resume_compares_packages_and_files(installed, tmp_path, mine, trial):
    def skipped(method):
        done = execute(
            "filter", trial / "a.mcap", "-n", "3", "-m", method, "-o", tmp_path / "x.mcap", "--resume", code=0
        )
        return "again" not in done.output

    assert skipped("none")
    assert skipped("none")
    installed()
    assert not skipped("none")  # what is installed may read and write differently
    assert skipped("none")
    file = f"{mine}:Low"
    assert not skipped(file)
    assert skipped(file)
    mine.write_text(MINE.replace("-2.0", "-1.0"))
    assert not skipped(file)
    with seaclutter.open_log(tmp_path / "x.mcap") as log:
        [record] = [one for one in log._source.metadata if one.name == "seaclutter.run"]
    assert record.entries["method"].startswith("sha256 ")
    assert record.entries["plugins"] == "seaclutter-example 1.0"


def test_removed_again_nothing_remains(installed, tmp_path):
    folder = installed()
    raw = ("--keep-raw", "--with-removed")
    execute("filter", SEA, "-n", "2", "-m", "above_water", *raw, "-o", tmp_path / "x.mcap", code=0)
    sys.path.remove(str(folder))
    forget()
    assert "above_water" not in FILTERS
    done = execute("filter", SEA, "-m", "above_water", "-o", tmp_path / "y.mcap", code=2)
    assert "unknown method 'above_water'" in done.output
    # The report shows what the log says.
    execute("report", tmp_path / "x.mcap", "-o", tmp_path / "r.html", code=0)
    assert "above_water" in (tmp_path / "r.html").read_text()


BROKEN = {
    "fails": ("raise RuntimeError('no licence')", "no licence"),
    "exits": ("import sys; sys.exit('bye')", "bye"),
    "lacks": ("class Lacks: pass", "it lacks"),
    "missing": ("import no_such_module", "No module named"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_plugin_is_one_warning(installed, tmp_path, trial, name):
    source, text = BROKEN[name]
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / f"broken_{name}.py").write_text(source)
    groups = {
        "seaclutter.filters": {"broken": f"broken_{name}:Lacks", "fine": "seaclutter_cli.filters.baselines:Nothing"}
    }
    installed(source=tmp_path / "src", groups=groups)
    with pytest.warns(PluginWarning, match=text) as caught:
        names = list(FILTERS)
    assert "broken" not in names
    assert "fine" in names
    assert len(caught) == 1
    forget()
    shown = execute("evaluate", trial, "--labels", trial, "-m", "none", "-j", "2", "-n", "2", code=0)
    assert shown.stderr.count("is not used") == 1


@pytest.mark.parametrize("kind", registry.KINDS)
def test_names_that_are_taken_are_refused(installed, kind):
    names = {
        "filters": ("joint", "seaclutter_cli.filters.baselines:Nothing"),
        "sources": ("mcap", "seaclutter_example.source:TextSource"),
        "sensors": ("hesai", "seaclutter_example.sensor:ExampleLidar"),
        "clouds": ("x", "seaclutter_cli.messages.pointcloud2:PointCloud2"),
        "labels": ("csv", "seaclutter_example.labels:FORM"),
        "sinks": ("pcd", "seaclutter_example.sink:FORM"),
    }
    name, value = names[kind]
    installed(groups={f"seaclutter.{kind}": {name: value}})
    one = REGISTRIES[registry.KINDS.index(kind)]
    with pytest.warns(PluginWarning, match="is not used"):
        assert not one.added
    assert name in one or kind == "clouds"


def test_runs_of_built_in_parts_import_no_package(installed, tmp_path):
    installed()
    execute("filter", SEA, "-n", "2", "-m", "joint", "-o", tmp_path / "x.mcap", code=0)
    assert not [name for name in sys.modules if name.startswith("seaclutter_example")]
    assert not any("added" in vars(one) for one in REGISTRIES)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_file_on_the_command_line(mine, trial, jobs):
    methods = [f"{mine}:Low", f"{mine}:far", "none"]
    options = [text for method in methods for text in ("-m", method)]
    done = execute("evaluate", trial, "--labels", trial, *options, "-j", str(jobs), "--json", code=0)
    assert list(json.loads(done.stdout)["methods"]) == [
        "mine.py:Low",
        "mine.py:far",
        "none",
        "ideal",
    ]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("mine.py:None", "has no class or function 'None'; it has: Params, Low, far, Half"),
        ("mine.py:Half", "it lacks Params, flush"),
        ("other.py:Low", "cannot be read (No such file or directory)"),
    ],
)
def test_files_that_have_no_method(mine, tmp_path, name, text):
    done = execute("filter", SEA, "-m", tmp_path / name, "-o", tmp_path / "x.mcap", code=2)
    assert text in done.output


def test_a_written_configuration_needs_the_file(mine, tmp_path):
    """A configuration that `tune` or `config show` wrote for such a method is used with ``-m``."""
    best = tmp_path / "best.yaml"
    best.write_text(execute("config", "show", "-m", f"{mine}:Low", "-s", "least_m=-1", code=0).stdout)
    for options in (("-c", best, "-m", f"{mine}:Low"), ("-m", f"{mine}:Low", "-s", "least_m=-1")):
        execute("filter", SEA, "-n", "3", *options, "-o", tmp_path / "x.mcap", "--force", code=0)
        content = (tmp_path / "x.mcap").read_bytes()
    execute("filter", SEA, "-n", "3", "-c", best, "-m", f"{mine}:Low", "-o", tmp_path / "y.mcap", code=0)
    assert (tmp_path / "y.mcap").read_bytes() == content


def test_a_file_with_a_mistake(mine, tmp_path):
    mine.write_text("import nothing_like_it")
    done = execute("filter", SEA, "-m", f"{mine}:Low", "-o", tmp_path / "x.mcap", code=2)
    assert f"{mine}: ModuleNotFoundError: No module named 'nothing_like_it'" in done.output


def ways_in(mine, tmp_path):
    """Yield command lines that name a file in another way than by ``-m``."""
    named = f"{mine}:Low"
    (tmp_path / "c.yaml").write_text(f"filter: {{method: '{named}'}}")
    yield ("filter", SEA, "-c", tmp_path / "c.yaml", "-o", tmp_path / "x.mcap"), {}
    yield ("filter", SEA, "-s", f"filter.method={named}", "-o", tmp_path / "x.mcap"), {}
    yield ("filter", SEA, "-o", tmp_path / "x.mcap"), {"SEACLUTTER_FILTER_METHOD": named}
    yield ("config", "check", tmp_path / "c.yaml"), {}


@pytest.mark.parametrize("number", range(4))
def test_nothing_else_can_name_a_file(mine, tmp_path, monkeypatch, number):
    mine.write_text(f"open({str(tmp_path / 'was here')!r}, 'w')\n" + MINE)
    arguments, environment = list(ways_in(mine, tmp_path))[number]
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert "own is named" in execute(*arguments, code=2).output
    assert not (tmp_path / "was here").exists()


def test_a_log_cannot_name_a_file(mine, tmp_path):
    """The record of a filtered log says which method it was; a report shows that, and runs nothing."""
    raw = ("--keep-raw", "--with-removed")
    execute("filter", SEA, "-n", "3", "-m", f"{mine}:Low", *raw, "-o", tmp_path / "x.mcap", code=0)
    mine.write_text(f"open({str(tmp_path / 'was here')!r}, 'w')\n")
    execute("report", tmp_path / "x.mcap", "-o", tmp_path / "r.html", code=0)
    assert "mine.py:Low" in (tmp_path / "r.html").read_text()
    assert not (tmp_path / "was here").exists()


class Low(seaclutter.Filter):
    """A method in a module."""

    def step(self, frame):
        reason = np.where(frame.valid, 0, 1).astype(np.uint8)
        reason[frame.valid & (frame.xyz[:, 2] < -2)] = seaclutter.Reason.OUTLIER
        return seaclutter.FilterResult(frame, reason)


def low(frame):
    return frame.xyz[:, 2] >= -2


@pytest.mark.parametrize("method", [Low, Low(), low], ids=["class", "object", "function"])
def test_python_takes_classes_objects_and_functions(tmp_path, method):
    done = seaclutter.filter_log(SEA, tmp_path / "x.mcap", method=method)
    with seaclutter.open_log(SEA) as log:
        wanted = [int(low(frame)[frame.valid].sum()) for frame in log.frames()]
    with seaclutter.open_log(tmp_path / "x.mcap") as log:
        assert [frame.size for frame in log.frames()] == wanted
    assert done.outcomes[0].frames == len(wanted)
    scores = seaclutter.evaluate(SEA, LABELLED, methods=[method, "none"], frames=5)
    assert list(scores.totals()) == [getattr(method, "__name__", "Low"), "none", "ideal"]
    tuned = seaclutter.tune(SEA, LABELLED, methods=[method, "none"], frames=5)
    assert tuned is not None
    found = seaclutter.find_suspects(SEA, tmp_path / "s.csv", method=method, frames=10)
    assert found.outcomes[0].method == getattr(method, "__name__", "Low")
    check_filter(method)


def test_mistakes_in_python():
    with pytest.raises(seaclutter.ConfigError, match="int is no method: it lacks"):
        seaclutter.make_filter(5)
    with pytest.raises(seaclutter.ConfigError, match="several methods are called low"):
        seaclutter.evaluate(SEA, LABELLED, methods=[low, type("low", (Low,), {})])
    with pytest.raises(seaclutter.ConfigError, match="is called none already"):
        seaclutter.make_filter(type("none", (Low,), {}))
    with pytest.raises(seaclutter.ArrayError, match="must return a mask"):
        seaclutter.filter_points(np.ones((3, 3)), method=lambda frame: frame.xyz)


def kept(frame):
    return seaclutter.FilterResult(frame, np.zeros(frame.size, np.uint8))


def marked(frame, reasons):
    return seaclutter.FilterResult(frame, reasons)


IN_ORDER = "must return one result for each frame, in their order"
MISTAKES = {
    "raises": (
        {"step": lambda self, frame: 1 / frame.index},
        "frame 0 of /points: ZeroDivisionError: division",
    ),
    "shape": ({"step": lambda self, frame: marked(frame, np.zeros(5, np.uint8))}, "reasons must be uint8"),
    "type": ({"step": lambda self, frame: marked(frame, np.zeros(frame.size, int))}, "got int64 of"),
    "value": ({"step": lambda self, frame: marked(frame, kept(frame).reason + 77)}, "77 is none of Reason"),
    "none": ({"step": lambda self, frame: None}, "no attribute 'frame'"),
    "few": ({"step": lambda self, frame: kept(frame), "process": lambda self, frame: []}, IN_ORDER),
    "many": ({"step": lambda self, frame: kept(frame), "process": lambda self, frame: [kept(frame)] * 2}, IN_ORDER),
    "made": ({"step": lambda self, frame: kept(frame), "__init__": lambda self: None}, "its parameters: TypeError"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_of_a_method_are_one_line(tmp_path, name):
    """Frames would be lost without a word, or a traceback show the pipeline."""
    members, text = MISTAKES[name]
    wrong = type("Wrong", (seaclutter.Filter,), members)
    with pytest.raises(seaclutter.MethodError, match=text) as raised:
        seaclutter.filter_log(SEA, tmp_path / "x.mcap", method=wrong, frames=3)
    assert str(raised.value).startswith("Wrong failed on ")
    assert not (tmp_path / "x.mcap").exists()


def test_methods_that_cannot_be_sent(trial):
    with pytest.raises(seaclutter.UsageError, match="cannot be sent to other processes"):
        seaclutter.evaluate(trial, trial, methods=[lambda frame: frame.valid], jobs=2)


@pytest.mark.parametrize("name", [name for name in FILTERS.built_in if name not in OPTIONAL or is_installed(name)])
def test_built_in_methods_hold_what_is_required(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        check_filter(name)


def test_filter_frames_gives_the_results_of_the_command(tmp_path):
    for name in ("confirmed", "global_intensity", "joint"):
        done = seaclutter.filter_log(SEA, tmp_path / f"{name}.mcap", method=name)
        with seaclutter.open_log(SEA) as log:
            results = list(seaclutter.filter_frames(list(log.frames()), name))
        assert sum(int(result.keep.sum()) for result in results) == done.outcomes[0].topics["/points"].counts[0]


def test_the_example_is_no_part_of_the_program():
    assert importlib.util.find_spec("seaclutter_example") is None
