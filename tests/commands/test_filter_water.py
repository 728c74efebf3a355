"""Tests of ``seaclutter filter -m confirmed``: water that is at another attitude, and no water at all."""

import csv
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

from seaclutter_cli.frame import WATER_COLUMNS
from seaclutter_cli.messages import diagnostics
from seaclutter_cli.messages.diagnostics import WATER, read_diagnostics
from seaclutter_cli.records import Channel, Message, Schema
from seaclutter_cli.water import Mounting
from tests.commands.test_filter import POINT, invoke, messages, write_log
from tests.filters.seas import Body, body_points, water
from tests.paths import SAMPLE
from tests.running import execute


def sea(mounting=None, *, size=400):
    """Return a function that makes a frame of water and a boat, as a lidar in an attitude sees it."""

    def make(number):
        rng = np.random.default_rng(number)
        rows = np.concatenate([water(rng, number, size), body_points(rng, Body(20, 5), number)])
        return cloud((mounting or Mounting()).unlevelled(rows[:, :3].T), rows[:, 3])

    return make


def cloud(xyz, intensity):
    points = np.zeros(len(intensity), POINT)
    for axis, values in zip(("x", "y", "z", "intensity"), (*xyz, intensity), strict=True):
        points[axis] = values
    return points


def above_the_horizon(number):
    """Return scattered points and a wall, which is kept."""
    rng = np.random.default_rng(number)
    y, z = (axis.ravel() for axis in np.meshgrid(np.arange(-3, 3, 0.2), np.arange(1, 4, 0.2)))
    xyz = np.hstack((rng.uniform((-50, -50, 1), (50, 50, 12), (500, 3)).T, (np.full_like(y, 20), y, z)))
    return cloud(xyz, rng.exponential(10, xyz.shape[1]))


def all_invalid(number):
    return cloud(np.full((3, 50), np.nan), np.ones(50))


def no_points(number):
    return np.zeros(0, POINT)


def run(tmp_path, make, *arguments):
    """Return the warnings, the JSON of the topic and the rows of the table of a run."""
    log, table = write_log(tmp_path / "log.mcap", make=make), tmp_path / "t.csv"
    output = ("-o", tmp_path / "out.mcap", "--csv", table, "--force")
    result = invoke(log, "-m", "confirmed", *arguments, *output, "--json")
    assert result.exit_code == 0, result.output
    warnings = [line.removeprefix("Warning: ") for line in result.stderr.splitlines() if "Warning" in line]
    with table.open(newline="") as stream:
        return warnings, json.loads(result.stdout)[0]["topics"]["/points"], list(csv.DictReader(stream))


@pytest.mark.parametrize(
    ("mounting", "arguments", "expected"),
    [
        ((180, 0), (), "upside down: the water is above it; set filter.mounting_roll_deg to 180"),
        ((0, -20), (), "tilted: the water slopes by 20°; set filter.mounting_pitch_deg to -20"),
        ((170, 15), (), "upside down: .*; set filter.mounting_roll_deg to 170 and filter.mounting_pitch_deg to 15"),
        ((0, 0), ("-s", "filter.mounting_roll_deg=180"), "upside down: .*; set filter.mounting_roll_deg to 0"),
    ],
)
def test_another_mounting_is_reported_once_with_the_keys_to_set(tmp_path, mounting, arguments, expected):
    warnings, *_ = run(tmp_path, sea(Mounting(*mounting)), *arguments)
    (warning,) = warnings
    assert re.fullmatch(f"/points: the lidar seems to be mounted {expected}", warning)


def test_the_correct_mounting_gives_no_warning_and_the_same_result(tmp_path):
    warnings, level, _ = run(tmp_path, sea())
    assert not warnings
    warnings, inverted, rows = run(tmp_path, sea(Mounting(180)), "-s", "filter.mounting_roll_deg=180")
    assert not warnings
    for key in ("points_out", "unconfirmed", "mirrored", "water", "water_frames"):
        assert inverted[key] == level[key]
    assert all(float(row["water_level_m"]) == pytest.approx(-2.5, abs=0.2) for row in rows)
    assert all(0 < float(row["water_level_deviation_m"]) < 0.2 for row in rows)


@pytest.mark.parametrize(("angles", "warned"), [((), True), (("-s", "filter.mounting_roll_deg=90"), False)])
def test_axes_that_are_not_upright_are_said(tmp_path, angles, warned):
    log = write_log(tmp_path / "log.mcap", make=sea(Mounting(90)))
    result = invoke(log, "-m", "confirmed", "-o", tmp_path / "out.mcap", *angles)
    assert ("z does not seem to point upwards" in result.stderr) == warned
    assert ("set filter.mounting_roll_deg to 90 or -90" in " ".join(result.stderr.split())) == warned


def test_other_methods_do_not_look_for_water(tmp_path):
    log = write_log(tmp_path / "log.mcap", make=sea(Mounting(180)))
    result = invoke(log, "-m", "joint", "-o", tmp_path / "out.mcap", "--json")
    assert "mounted" not in result.stderr
    assert "water_frames" not in json.loads(result.stdout)[0]["topics"]["/points"]


def test_a_log_without_water(tmp_path):
    warnings, topic, rows = run(tmp_path, above_the_horizon)
    assert warnings == [
        "/points: no water seen in 5 of 5 frames; heights are then unknown, and every object that stays is kept"
    ]
    assert topic["water_frames"] == 0
    assert "water" not in topic
    for row in rows:
        assert {row[name] for name in WATER_COLUMNS} == {""}
    for message in messages(tmp_path / "out.mcap", "/seaclutter/diagnostics"):
        found = diagnostics._typestore().deserialize_cdr(message.data, WATER.type)
        assert np.isnan([getattr(found, name) for name in WATER_COLUMNS]).all()
        channel = Channel(1, "", "cdr", Schema(WATER.name, "ros2msg", b""))
        assert read_diagnostics(Message(channel, 0, 0, 0, message.data)).water is None
    shown = invoke(tmp_path / "log.mcap", "-m", "confirmed", "-o", tmp_path / "out.mcap", "--force")
    assert "  no water seen" in shown.stdout


@pytest.mark.parametrize("make", [all_invalid, no_points])
def test_logs_without_valid_points(tmp_path, make):
    warnings, topic, rows = run(tmp_path, make)
    assert not any("water" in warning for warning in warnings), "that is not what is wrong"
    assert topic["water_frames"] == 0
    assert {row["water_level_m"] for row in rows} == {""}


def test_water_in_some_frames_is_no_reason_to_warn(tmp_path):
    warnings, topic, rows = run(tmp_path, lambda number: sea()(number) if number < 1 else above_the_horizon(number))
    assert not warnings
    assert 0 < topic["water_frames"] <= 5
    assert topic["water_frames"] == sum(row["water_level_m"] != "" for row in rows)


def test_evaluate_reports_another_mounting_as_well():
    log, labels = (SAMPLE.with_name(name) for name in ("sea.mcap", "sea.labels.csv"))
    arguments = ["evaluate", log, "--labels", labels, "-n", 20, "-m", "confirmed"]
    arguments += ["-s", "filter.mounting_roll_deg=180"]
    result = execute(*arguments, code=0)
    assert result.stderr.count("the lidar seems to be mounted upside down") == 1


def test_another_processor_gives_the_same_bytes(tmp_path):
    """The last digits of products of matrices depend on the processor."""
    outputs, sea_log = [], SAMPLE.with_name("sea.mcap")
    for processor in ("Nehalem", "Haswell"):
        outputs.append(tmp_path / f"{processor}.mcap")
        command = [sys.executable, "-m", "seaclutter_cli", "filter", sea_log, "-m", "confirmed", "-n", "20", "-q"]
        command += ["-o", outputs[-1]]
        subprocess.run(command, check=True, env=os.environ | {"OPENBLAS_CORETYPE": processor})
    assert outputs[0].read_bytes() == outputs[1].read_bytes()
