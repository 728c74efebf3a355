"""The public API is documented, typed and silent, and gives the same results as the commands."""

import inspect
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import seaclutter
import seaclutter_cli
from seaclutter_cli.filters import FILTERS
from tests.pairs import covering
from tests.paths import ROOT
from tests.running import execute

SEA, LABELS = ROOT / "samples" / "sea.mcap", ROOT / "samples" / "sea.labels.csv"
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
NAMES = sorted(set(seaclutter.__all__) - {"__version__"})


def command(*arguments):
    return execute(*arguments, code=0).stdout


def timeless(value):
    """Return parsed JSON without times, paths and the version of its schema."""
    if isinstance(value, dict):
        return {
            k: timeless(v) for k, v in value.items() if k not in ("seconds", "filter_ms", "output", "schema_version")
        }
    return [timeless(item) for item in value] if isinstance(value, list) else value


def test_both_packages_have_the_same_names():
    assert seaclutter.__all__ == seaclutter_cli.__all__
    assert set(dir(seaclutter)) == set(NAMES)
    assert seaclutter.__version__ == seaclutter_cli.__version__
    with pytest.raises(AttributeError):
        _ = seaclutter.no_such_name


@pytest.mark.parametrize("name", NAMES)
def test_every_name_has_an_example(name):
    doc = inspect.getdoc(getattr(seaclutter, name))
    assert ">>> import seaclutter" in doc


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_documented(name):
    assert re.search(rf"`[^`\n]*\b{name}\b|^.*\.{name}\(", PAGE, re.MULTILINE)


def test_the_page_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("trial", "harbour"):
        shutil.copy(SEA, f"{name}.mcap")
    shutil.copy(LABELS, "trial.labels.csv")
    Path("my.yaml").write_text("filter: {near: keep}")
    names = {"xyz": np.ones((4, 3)) * 20, "intensity": np.arange(4) * 20}
    for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(block, names)
    assert "R_FP %" in capsys.readouterr().out
    assert names["result"].keep.dtype == bool
    assert {path.name for path in tmp_path.iterdir()} >= {"filtered.mcap"}


def test_import_loads_no_heavy_library():
    code = "import sys, seaclutter; print(*({'numpy', 'scipy', 'mcap', 'pydantic', 'click'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_the_separation_of_tiles_loads_nothing_for_logs_only():
    """Half of its time on a small tile would be imports of filters, decoders and writers of logs."""
    parts = ("filters", "sensors.families", "sinks.log", "jobs.cluster", "sources.mcap")
    code = f"""
import sys, seaclutter
seaclutter.separate_tiles
print(*({{f"seaclutter_cli.{{part}}" for part in {parts}}} | {{"rosbags", "asyncio", "sqlite3"}}) & set(sys.modules))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_frames_are_arrays():
    with seaclutter.open_log(SEA) as log:
        assert (log.name, log.format, log.topics, log.damage) == ("sea", "MCAP", ("/points",), [])
        frames = list(log.frames(limit=3))
        again = list(log.frames("/points", start_s=0.1, end_s=0.3))
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert [frame.index for frame in again] == [1, 2]
    for frame in frames:
        assert frame.xyz.shape == (frame.size, 3)
        assert frame.intensity.shape == (frame.size,)
    np.testing.assert_array_equal(frames[1].xyz, again[0].xyz)


def test_a_log_is_one_recording(tmp_path):
    with pytest.raises(seaclutter.UsageError, match="contains 3 recordings"):
        seaclutter.open_log(ROOT / "samples")
    with pytest.raises(seaclutter.UsageError, match="no such file"):
        seaclutter.open_log(tmp_path / "none.mcap")


@pytest.mark.parametrize(("method", "dtype"), covering(FILTERS, (np.float32, np.float64)))
def test_points_are_filtered_like_frames_of_a_log(method, dtype):
    with seaclutter.open_log(SEA) as log:
        frame = next(log.frames())
    other = seaclutter.make_filter(method)
    if other.needs_first_pass:
        other.observe(frame)
    xyz, intensity = frame.xyz.astype(dtype), frame.intensity.astype(np.uint16)
    given = xyz.copy(), intensity.copy()
    result = seaclutter.filter_points(xyz, intensity, method=method)
    np.testing.assert_array_equal(result.reason, other.step(frame).reason)
    np.testing.assert_array_equal(result.keep, result.reason == seaclutter.Reason.KEPT)
    np.testing.assert_array_equal(xyz, given[0])
    np.testing.assert_array_equal(intensity, given[1])


def test_every_kind_of_configuration(tmp_path):
    xyz, intensity = np.array([[8.0, 0, 0], [9.0, 0, 0]]), np.array([200, 200])
    (tmp_path / "c.yaml").write_text("filter: {start_m: 5, end_m: 65}")
    calibrated = seaclutter.calibrate(SEA, labels=LABELS).config
    for config in (tmp_path / "c.yaml", str(tmp_path / "c.yaml"), {"filter": {"start_m": 5, "end_m": 65}}):
        assert seaclutter.filter_points(xyz, intensity, config=config).keep.all()
    for config in (None, "rs-lidar-32", calibrated, {"filter": {"method": "joint"}}):
        assert not seaclutter.filter_points(xyz, intensity, config=config).keep.any()
    assert seaclutter.filter_points(xyz, None, method="ror", config="rs-lidar-32").reason.tolist() == [4, 4]
    with pytest.raises(seaclutter.ConfigError, match="unknown method"):
        seaclutter.filter_points(xyz, intensity, method="jiont")
    with pytest.raises(seaclutter.ConfigError, match="start_m"):
        seaclutter.make_filter("joint", start_m="near")


@pytest.mark.parametrize(
    ("xyz", "intensity"),
    [
        (np.zeros((3, 5)), None),
        (np.zeros(3), None),
        (np.zeros((4, 3)), np.zeros(3)),
        (np.zeros((4, 3)), np.zeros((4, 1))),
        (np.zeros((4, 3)), np.array(["a"] * 4)),
        (np.zeros((4, 3), complex), None),
        (np.zeros((4, 3), bool), None),
        ([[1, 2, 3], [1, 2]], None),
        ("points", None),
    ],
)
def test_arrays_of_wrong_shape_or_type(xyz, intensity):
    with pytest.raises(
        seaclutter.ArrayError, match=r"must have the shape|must contain numbers|must be arrays"
    ) as caught:
        seaclutter.filter_points(xyz, intensity, method="none")
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    "call",
    [
        lambda _: seaclutter.make_filter(config=5),
        lambda _: seaclutter.open_log(5),
        lambda _: seaclutter.open_log(""),
        lambda log: next(log.frames(topics=5)),
        lambda log: next(log.frames(topics=[5])),
        lambda log: next(log.frames(end_s=float("inf"))),
        lambda log: next(log.frames(start_s=float("nan"))),
        lambda log: next(log.frames(start_s="yesterday")),
        lambda log: next(log.frames(limit="many")),
        *(lambda _, name=name: seaclutter.filter_log(SEA, name) for name in ("a\0b", "", "x/" * 2000, 5, "\ud800")),
        *(lambda _, name=name: seaclutter.filter_log(name, "out.mcap") for name in ("", ["a", 5], 5)),
        lambda _: seaclutter.calibrate(SEA, filter_rate=1e-320),
    ],
)
def test_arguments_of_wrong_kinds_are_usage_errors(tmp_path, monkeypatch, call):
    monkeypatch.chdir(tmp_path)
    with seaclutter.open_log(SEA) as log, pytest.raises(seaclutter.UsageError):
        call(log)
    assert not list(tmp_path.iterdir())


def test_a_name_that_is_too_long(tmp_path):
    with pytest.raises(seaclutter.OutputError, match="File name too long"):
        seaclutter.filter_log(SEA, tmp_path / ("x" * 4000))


def test_state_is_kept_from_frame_to_frame():
    joint = seaclutter.make_filter()
    with seaclutter.open_log(SEA) as log:
        results = [joint.step(frame) for frame in log.frames(limit=5)]
    done = [seaclutter.filter_points(r.frame.xyz, r.frame.intensity) for r in results]
    assert (results[0].reason == done[0].reason).all()
    assert any((a.reason != b.reason).any() for a, b in zip(results, done, strict=True))


def test_filter_log_is_the_command(tmp_path, capsys):
    table = tmp_path / "api.csv"
    done = seaclutter.filter_log(SEA, tmp_path / "api" / "f.mcap", method="ror", csv_file=table)
    assert capsys.readouterr() == ("", "")
    printed = command("filter", SEA, "-o", tmp_path / "f.mcap", "-m", "ror", "--csv", tmp_path / "f.csv", "--json")
    assert (tmp_path / "api" / "f.mcap").read_bytes() == (tmp_path / "f.mcap").read_bytes()
    assert table.read_bytes() == (tmp_path / "f.csv").read_bytes()
    assert timeless(done.as_dict()) == timeless(json.loads(printed))
    with pytest.raises(seaclutter.UsageError, match="already exists"):
        seaclutter.filter_log(SEA, tmp_path / "f.mcap")


def test_evaluate_is_the_command(tmp_path, capsys):
    result = seaclutter.evaluate(SEA, LABELS, methods=["joint", "none"], frames_file=tmp_path / "a.csv")
    assert capsys.readouterr() == ("", "")
    arguments = ("--labels", LABELS, "-m", "joint", "-m", "none", "-o", tmp_path / "b.csv", "--json")
    assert timeless(result.as_dict()) == timeless(json.loads(command("evaluate", SEA, *arguments)))
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_calibrate_is_the_command(tmp_path, capsys):
    result = seaclutter.calibrate(SEA, labels=LABELS, filter_rate=0.9)
    assert capsys.readouterr() == ("", "")
    command("calibrate", SEA, "--labels", LABELS, "--filter-rate", "0.9", "-o", tmp_path / "c.yaml")
    assert result.config_text() == (tmp_path / "c.yaml").read_text(encoding="utf-8")


def test_errors_are_raised_unless_keep_going(tmp_path):
    (tmp_path / "bad.mcap").write_bytes(b"no log")
    logs = [tmp_path / "bad.mcap", SEA]
    with pytest.raises(seaclutter.InputError, match=r"bad\.mcap"):
        seaclutter.filter_log(logs, tmp_path / "out")
    done = seaclutter.filter_log(logs, tmp_path / "out", keep_going=True, force=True)
    assert [outcome.error is None for outcome in done.outcomes] == [False, True]
    assert done.failed
    assert not done.damaged


def test_an_observer_receives_what_the_command_would_print(tmp_path, caplog):
    data = SEA.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    with caplog.at_level("INFO", logger="seaclutter"):
        done = seaclutter.filter_log(
            tmp_path / "cut.mcap", tmp_path / "f.mcap", observer=seaclutter.LoggingObserver(), force=True
        )
    assert done.damaged
    assert any(record.getMessage().startswith("damaged: ") for record in caplog.records)
    assert any("frames" in record.getMessage() for record in caplog.records)
