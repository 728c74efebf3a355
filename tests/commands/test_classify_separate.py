"""``classify separate``: everything in a tile is kept except the class."""

import json
import re
from functools import partial

import numpy as np
import pytest

from seaclutter_cli.sources.frame_files import FRAME_READERS
from tests.airborne.tiles import box, raw_records, read, sea, write
from tests.paths import ROOT
from tests.running import execute

run = partial(execute, "classify", "separate")


def points():
    rng = np.random.default_rng(2)
    return np.concatenate([sea(rng), box(rng, (20, 30), (10, 40), (2, 3))])


def headers(path, added):
    """Return header and records, without the header bytes that compression or an additional field changes."""
    head, before, after = raw_records(path)
    changing = {*range(96, 105), *range(235, 243), *([105, 106] if added else [])}
    return bytes(byte for at, byte in enumerate(head) if at not in changing), before, after


def assert_same_but_class(source, target, added=()):
    one, other = read(source), read(target)
    old, new = headers(source, added), headers(target, added)
    assert (old[0], old[2]) == (new[0], new[2])
    if not added:
        assert old[1] == [record for record in new[1] if record[:2] != (b"seaclutter", 1)]
    for record in old[1]:
        assert any(record[:3] == found[:3] and found[3].startswith(record[3]) for found in new[1])
    for name in one.point_format.dimension_names:
        if name != "classification":
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
    assert set(other.point_format.dimension_names) == {*one.point_format.dimension_names, *added}


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("point_format", [1, 3, 6, 8])
def test_las_keeps_everything(tmp_path, suffix, point_format):
    xyz = points()
    extra = [("echo_width", "f4", np.arange(len(xyz))), ("class_hint", "u1", np.full(len(xyz), 3))]
    tile = write(tmp_path / f"tile{suffix}", xyz, point_format=point_format, extra=extra)
    out = tmp_path / f"out{'.laz' if suffix == '.las' else '.las'}"
    result = run(tile, "-o", out, "--json", code=0)
    assert_same_but_class(tile, out)
    found = np.asarray(read(out).classification)
    assert (found[4000:] == 1).all()
    assert (found[:4000][np.abs(xyz[:4000, 0] - 25) > 6] == 9).all()
    assert json.loads(result.stdout)[0]["other"] == (found == 1).sum()


def rough(rng, height=1.2, length=25.0):
    """Return long-crested waves with a significant height, and a ship, shape (N, 3)."""
    xyz = sea(rng, 60_000, (200.0, 150.0), 0.03)
    xyz[:, 2] += height / 4 * np.sqrt(2) * np.sin(2 * np.pi * xyz[:, 0] / length)
    return np.concatenate([xyz, box(rng, (60, 75), (40, 110), (4, 6), 3000)])


def sea_state(path):
    (found,) = [record for record in raw_records(path)[1] if record[:2] == (b"seaclutter", 1)]
    return json.loads(found[3])


def test_waves_are_followed_and_described(tmp_path):
    tile = write(tmp_path / "tile.laz", rough(np.random.default_rng(3)))
    for source in (tile, tmp_path / "out.laz"):  # the record of an earlier run is replaced
        result = run(source, "-o", tmp_path / "out.laz" if source == tile else tmp_path / "again.laz", "--json", code=0)
        (row,) = json.loads(result.stdout)
    assert row["sea_state"] == sea_state(tmp_path / "again.laz") == sea_state(tmp_path / "out.laz")
    assert row["sea_state"]["surface"] == "followed"
    assert row["sea_state"]["wave_height_m"] == pytest.approx(1.2, abs=0.3)
    assert row["sea_state"]["wave_length_m"] == pytest.approx(25, abs=3)
    found = np.asarray(read(tmp_path / "again.laz").classification)
    assert (found[60_000:] == 1).all()
    assert (found[:60_000] == 1).mean() < 0.001
    assert re.search(r" 1\.\d m +2\d m ", run(tile, "-o", tmp_path / "text.laz").stdout)


def test_a_fixed_height_is_the_method_of_the_paper(tmp_path):
    tile = write(tmp_path / "tile.laz", rough(np.random.default_rng(3)))
    result = run(tile, "-o", tmp_path / "out.laz", "-s", "separation.height_m=0.5", "--json")
    assert json.loads(result.stdout)[0]["sea_state"]["wave_height_m"] is None
    assert raw_records(tile)[1] == raw_records(tmp_path / "out.laz")[1]
    assert (np.asarray(read(tmp_path / "out.laz").classification)[:60_000] == 1).mean() > 0.1


def _describe(path, name):
    """Add a no-data value and a value range to the description of a dimension, which laspy would not write again."""
    data = bytearray(path.read_bytes())
    at = data.index(name) - 4
    data[at + 3] |= 0b111
    data[at + 40 : at + 48] = np.float64(-1).tobytes()
    data[at + 64 : at + 72], data[at + 88 : at + 96] = np.float64(0).tobytes(), np.float64(5000).tobytes()
    path.write_bytes(data)


def test_internal_waveforms_are_refused(tmp_path):
    tile = write(tmp_path / "tile.las", points())
    data = bytearray(tile.read_bytes())
    data[6] |= 2
    tile.write_bytes(data)
    result = run(tile, "-o", tmp_path / "out.las")
    assert (result.exit_code, "waveform packets cannot be copied" in result.stderr) == (1, True)


@pytest.mark.parametrize(("channels", "suffix"), [(1, ".laz"), (2, ".las"), (2, ".laz")])
def test_waveform_packets_are_kept_or_refused(tmp_path, channels, suffix):
    """Lazrs compresses wrong packets if there are several scanner channels."""
    laspy = pytest.importorskip("laspy")
    tile = laspy.LasData(laspy.LasHeader(point_format=9, version="1.4"))
    tile.x, tile.y, tile.z = points().T
    numbers = np.arange(len(tile.points))
    tile["scanner_channel"] = numbers % channels
    tile["wavepacket_index"] = np.ones_like(numbers)
    tile["wavepacket_offset"], tile["wavepacket_size"] = 60 + 256 * numbers, 200 + numbers % 50
    tile.write(tmp_path / "tile.las")
    result = run(tmp_path / "tile.las", "-o", tmp_path / f"out{suffix}")
    if channels > 1 and suffix == ".laz":
        assert (result.exit_code, "several scanner channels" in result.stderr) == (1, True)
        assert [path.name for path in tmp_path.iterdir()] == ["tile.las"]
    else:
        assert result.exit_code == 0, result.output
        assert_same_but_class(tmp_path / "tile.las", tmp_path / f"out{suffix}")


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las_1_0_becomes_1_2(tmp_path, suffix):
    tile = write(tmp_path / "tile.las", points(), point_format=1)
    data = bytearray(tile.read_bytes())
    data[4:8] = b"\xaa\xbb\xcc\xdd"  # reserved
    data[25] = 0
    tile.write_bytes(data)
    out = tmp_path / f"out{suffix}"
    run(tile, "-o", out, code=0)
    run(tile, "-o", tmp_path / "out.pcd", code=0)
    found = read(out)
    assert (str(found.header.version), out.read_bytes()[4:8]) == ("1.2", bytes(4))
    data[4:8], data[25] = bytes(4), 2
    tile.write_bytes(data)
    assert_same_but_class(tile, out)


def test_versions_of_las_that_cannot_be_written(tmp_path, monkeypatch):
    laspy = pytest.importorskip("laspy")
    monkeypatch.setattr(laspy, "supported_versions", lambda: {"1.4"})
    result = run(write(tmp_path / "tile.las", points(), point_format=1), "-o", tmp_path / "out.las")
    assert (result.exit_code, "cannot be written; convert" in result.stderr) == (1, True)


@pytest.mark.usefixtures("full_disk")
@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_a_full_disk(tmp_path, suffix):
    result = run(write(tmp_path / "tile.las", points()), "-o", tmp_path / f"out{suffix}")
    assert (result.exit_code, "the disk is full; the incomplete file was removed" in result.stderr) == (1, True)
    assert [path.name for path in tmp_path.iterdir()] == ["tile.las"]


@pytest.mark.parametrize("described", [False, True])
def test_height_as_an_additional_dimension(tmp_path, described):
    extra = [("echo_width", "f8", np.arange(4400))] if described else []
    tile = write(tmp_path / "tile.laz", points(), extra=extra)
    if described:
        _describe(tile, b"echo_width")
    run(tile, "-o", tmp_path / "out.laz", "--with-height", code=0)
    assert_same_but_class(tile, tmp_path / "out.laz", added=("height_above_sea",))
    height = np.asarray(read(tmp_path / "out.laz")["height_above_sea"])
    assert 2 < height[4000:].min() < height[4000:].max() < 3.5


def test_large_tiles_are_read_in_parts(tmp_path, monkeypatch):
    from seaclutter_cli.sources import tiles

    tile = write(tmp_path / "tile.laz", points())
    run(tile, "-o", tmp_path / "whole.laz", code=0)
    monkeypatch.setattr(tiles, "CHUNK_POINTS", 700)
    monkeypatch.setattr(tiles, "_KEPT_BYTES", 0)
    run(tile, "-o", tmp_path / "parts.laz", code=0)
    np.testing.assert_array_equal(read(tmp_path / "whole.laz").points.array, read(tmp_path / "parts.laz").points.array)


@pytest.mark.parametrize("suffix", [".pcd", ".ply", ".mcap"])
def test_other_formats(tmp_path, suffix):
    tile = write(tmp_path / "tile.laz", points(), point_format=1)
    run(tile, "-o", tmp_path / "out.las", code=0)
    out = tmp_path / f"out{suffix}"
    run(tile, "-o", out, code=0)
    if suffix == ".mcap":
        result = execute("filter", out, "-o", tmp_path / "f.mcap", "-m", "none", "--json")
        assert json.loads(result.stdout)[0]["topics"]["/points"]["points_in"] == 4400
        return
    found = FRAME_READERS[suffix](out).points
    expected = read(tmp_path / "out.las")
    for name in ("x", "y", "z", "intensity", "classification", "gps_time"):
        np.testing.assert_array_equal(found[name], np.asarray(expected[name]), err_msg=name)
    again = tmp_path / f"again{suffix}"
    run(out, "-o", again, code=0)
    assert set(FRAME_READERS[suffix](again).points["classification"]) == {1, 9}


def test_bad_command_lines(tmp_path):
    tile = write(tmp_path / "tile.las", points())
    run(tmp_path / "none.las", "-o", tmp_path / "o.las", code=2)
    assert "is part of the input" in run(tile, "-o", tile, "--force").stderr
    run(tile, "-o", tmp_path / "o.xyz", code=2)
    (tmp_path / "o.las").write_text("mine")
    assert "--force" in run(tile, "-o", tmp_path / "o.las").stderr
    assert "unknown key" in run(tile, "-o", tmp_path / "p.las", "-s", "separation.window=3").stderr
    wrong = run(tile, "-o", tmp_path / "p.las", "-s", "separation.height_m=waves").stderr
    assert 'separation.height_m: must be a number greater than 0 or "auto"' in wrong
    assert "must not exceed" in run(tile, "-o", tmp_path / "p.las", "-s", "separation.window_m=3000").stderr
    np.save(tmp_path / "cloud.npy", np.zeros((5, 4), "f4"))
    assert "only LAS and LAZ tiles" in run(tmp_path / "cloud.npy", "-o", tmp_path / "p.las").stderr
    assert not (tmp_path / "p.las").exists()


def test_bad_tiles(tmp_path):
    empty = write(tmp_path / "empty.las", np.empty((0, 3)))
    assert "no points" in run(empty, "-o", tmp_path / "o.las").stderr
    good = write(tmp_path / "good.laz", points())
    (tmp_path / "cut.laz").write_bytes(good.read_bytes()[:9000])
    result = run(tmp_path / "cut.laz", "-o", tmp_path / "o.laz")
    assert (result.exit_code, "cut.laz" in result.stderr) == (1, True)
    far = np.arange(2000.0)[:, None] * np.array([900.0, 900, 0])
    result = run(write(tmp_path / "far.las", far, offset=(0, 0, 0)), "-o", tmp_path / "o.las")
    assert (result.exit_code, "larger cell_m" in result.stderr) == (1, True)
    assert not list(tmp_path.glob("o.*"))


@pytest.mark.parametrize("size", [1, 3])
def test_a_tile_of_a_few_points_is_sea(tmp_path, size):
    tile = write(tmp_path / "tile.las", points()[:size])
    run(tile, "-o", tmp_path / "out.las", code=0)
    assert_same_but_class(tile, tmp_path / "out.las")
    assert (np.asarray(read(tmp_path / "out.las").classification) == 9).all()


def test_evlrs_with_a_wrong_length_are_refused(tmp_path):
    good = write(tmp_path / "good.las", points())
    data = bytearray(good.read_bytes())
    at = int.from_bytes(data[235:243], "little")
    data[at + 20 : at + 28] = (2**60).to_bytes(8, "little")
    (tmp_path / "bad.las").write_bytes(data)
    assert "it is truncated" in run(tmp_path / "bad.las", "-o", tmp_path / "o.las").stderr


def test_the_sample_tile(tmp_path):
    from seaclutter_cli.evaluation.confusion import Confusion

    sample = ROOT / "samples" / "tile.laz"
    run(sample, "-o", tmp_path / "out.laz", code=0)
    truth, found = (np.asarray(read(path).classification) for path in (sample, tmp_path / "out.laz"))
    assert Confusion.of(truth, found, (1, 9)).kappa > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("name", ["calm_ships", "reefs", "farms", "high"])
def test_kappa_rises_to_20_m_and_falls(name):
    """Table 1 of [Shi2022] with the method of the paper; the default method keeps the best value."""
    from dataclasses import replace

    from seaclutter_cli.airborne.separation import separate
    from seaclutter_cli.airborne.surface import SeparationParams
    from seaclutter_cli.evaluation.confusion import Confusion
    from seaclutter_cli.grids.opening import SurfaceParams
    from seaclutter_cli.simulation.airborne.recording import simulate_strips
    from seaclutter_cli.simulation.airborne.scene import load_tile_scene

    points = np.concatenate(list(simulate_strips(load_tile_scene(name))))
    xyz = np.stack([points[axis] for axis in "xyz"])

    def kappa(window_m, params):
        found = separate([xyz], replace(params, window_m=window_m)).classification
        return Confusion.of(points["classification"], found, (1, 9)).kappa

    narrow, best, wide = (kappa(window_m, SurfaceParams()) for window_m in (4.0, 20.0, 80.0))
    assert narrow < 0.8 * best
    assert wide < 0.95 * best
    assert kappa(20.0, SeparationParams()) > 0.95


@pytest.mark.parametrize("how", [["--trust-classes", "2,9"], ["-s", "separation.trust_classes=[2, 9]"]])
def test_trusted_classes_are_kept(tmp_path, how):
    xyz = points()
    given = np.where(np.arange(len(xyz)) < 500, 9, 1)
    tile = write(tmp_path / "tile.las", xyz, classification=given)
    result = run(tile, "-o", tmp_path / "out.las", *how, code=0)
    assert (np.asarray(read(tmp_path / "out.las").classification)[:500] == 9).all()
    assert "no points of class 2 to trust" in result.stderr


@pytest.mark.parametrize("text", ["6", "2;9", "water", ""])
def test_other_classes_cannot_be_trusted(tmp_path, text):
    tile = write(tmp_path / "tile.las", points())
    result = run(tile, "-o", tmp_path / "out.las", "--trust-classes", text, code=2)
    assert "must be 2, 9, or 2,9" in result.stderr
