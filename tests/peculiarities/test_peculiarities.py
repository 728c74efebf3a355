"""Every reported peculiarity runs through the commands, and keeps its points and values."""

import csv
import json
import re
from contextlib import closing

import numpy as np
import pytest

import seaclutter
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from tests.peculiarities import clouds, outputs, packets, recordings
from tests.running import execute

CASES = [*clouds.CASES, *packets.CASES, *recordings.CASES, *outputs.CASES]
READ = [case for case in CASES if case.frames]
REFUSED = [case for case in CASES if case.refused]


def run(case, command, *words, code):
    result = execute(command, *words, *case.words, code=code)
    assert re.search(case.says.get(command, ""), " ".join(result.output.split())), result.output
    return result


def points_of(frame):
    has_none = frame.intensity_name is None and frame.size
    columns = frame.xyz if has_none else np.column_stack((frame.xyz, frame.intensity))
    return columns[frame.valid]


def assert_right(case, path):
    topic = case.topic if len(topics := topics_of(path)) > 1 else topics[0]
    with seaclutter.open_log(path) as log:
        frames = list(log.frames(topic))
    assert len(frames) == len(case.frames)
    for found, right in zip(frames, case.frames, strict=True):
        np.testing.assert_allclose(points_of(found), np.asarray(right, np.float64), rtol=0, atol=case.atol)
    if case.stamps_ns is not None:
        assert [frame.stamp_ns for frame in frames] == list(case.stamps_ns)


def topics_of(path):
    with seaclutter.open_log(path) as log:
        return log.topics


def target(case, folder, form):
    return folder / ("out" if OUTPUT_FORMATS[form].is_folder else f"out{OUTPUT_FORMATS[form].suffix}")


def test_names_are_distinct_and_sources_given():
    assert len({case.name for case in CASES}) == len(CASES)
    for case in CASES:
        assert len(case.source) > 20
        assert bool(case.frames) != bool(case.refused)


@pytest.mark.parametrize("case", READ, ids=str)
def test_info(tmp_path, case):
    (content,) = json.loads(run(case, "info", case.build(tmp_path), "--json", code=case.code).stdout)
    clouds = content["clouds"]
    cloud = clouds[case.topic] if case.topic else next(iter(clouds.values()))
    assert cloud["frames"] == len(case.content)
    sizes = [len(points) for points in case.content]
    assert cloud["points"]["max"] == max(sizes) + case.invalid
    assert cloud["points"]["min"] == min(sizes) + case.invalid
    if len(case.content[0]) and np.shape(case.content[0])[1] > 3:
        values = np.concatenate(case.content)[:, 3]
        np.testing.assert_allclose(cloud["intensity"], [values.min(), values.max()], rtol=1e-6)


@pytest.mark.parametrize("command", ["filter", "convert"])
@pytest.mark.parametrize(("case", "form"), [(case, form) for case in READ for form in case.to], ids=str)
def test_outputs(tmp_path, case, form, command):
    """An output, of `filter` with no filter, has the right points."""
    (tmp_path / "in").mkdir()
    out = target(case, tmp_path, form)
    method = ("-m", "none") if command == "filter" else ()
    run(case, command, case.build(tmp_path / "in"), "-o", out, "--to", form, *method, code=case.code)
    assert_right(case, out)
    if case.also:
        case.also(out)


@pytest.mark.parametrize("case", READ, ids=str)
def test_evaluate(tmp_path, case):
    """An evaluation sees the points."""
    (tmp_path / "in").mkdir()
    labels, table = tmp_path / "a.labels.csv", tmp_path / "frames.csv"
    rows = [f"{number},,none,,,,,,,\n" for number in range(len(case.frames))]
    labels.write_text("frame,track_id,class,x,y,z,length,width,height,yaw\n" + "".join(rows))
    run(case, "evaluate", case.build(tmp_path / "in"), "--labels", labels, "-m", "none", "-o", table, code=case.code)
    with closing(table.open()) as file:
        found = [int(row["points_out"]) for row in csv.DictReader(file) if row["method"] == "none"]
    assert found == [len(points) + case.invalid for points in case.content]


@pytest.mark.parametrize(
    ("case", "command"), [(case, command) for case in REFUSED for command in case.refused_by], ids=str
)
def test_refused(tmp_path, case, command):
    """What cannot be read is refused with a reason, and nothing is written."""
    (tmp_path / "in").mkdir()
    out = target(case, tmp_path, case.to[0])
    written = ("-o", out, "--to", case.to[0])
    words = {"info": (), "filter": (*written, "-m", "none"), "convert": written}[command]
    result = run(case, command, case.build(tmp_path / "in"), *words, code=None)
    assert result.exit_code == 1 or (result.exit_code, command) == (3, "info"), "of other parts"
    assert re.search(case.refused, " ".join(result.output.split())), result.output
    assert not out.exists()
