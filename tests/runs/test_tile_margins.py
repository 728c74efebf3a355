"""Several tiles as one survey: margins from neighbours, tiles that fail, runs that go on."""

import csv
import json
import shutil
from functools import partial

import numpy as np
import pytest

from seaclutter_cli.sources import extents
from tests.airborne.tiles import raw_records, read, write
from tests.running import execute

pytest.importorskip("laspy")

SEAM = 100.0
OPENING = ("-s", "separation.land=ignore")  # otherwise the raft is known by its shape, however it is cut


separate = partial(execute, "classify", "separate")
separate_here = partial(separate, "-j", 1)  # workers import scipy and laspy, which takes most of their time


def scene():
    """Return calm water with a raft across a seam: it is wider than the window, but none of its halves is."""
    rng = np.random.default_rng(3)
    xyz = np.column_stack([rng.uniform(0, 2 * SEAM, (40_000, 2)), rng.normal(0, 0.03, 40_000)])
    xyz[(np.abs(xyz[:, 0] - SEAM) < 16) & (np.abs(xyz[:, 1] - SEAM) < 80), 2] += 1.2
    return xyz


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """Return a folder with a tile, and a folder with its quarters."""
    folder, xyz = tmp_path_factory.mktemp("survey"), scene()
    write(folder / "whole.laz", xyz)
    (folder / "tiles").mkdir()
    east, north = (xyz[:, :2] >= SEAM).T
    for name, own in {"sw": ~east & ~north, "se": east & ~north, "nw": ~east & north, "ne": east & north}.items():
        write(folder / "tiles" / f"{name}.laz", xyz[own])
    separate(folder / "whole.laz", "-o", folder / "separated.laz", *OPENING, code=0)
    return folder


def classes(paths):
    """Return the classes of points by their coordinates."""
    tiles = [read(path) for path in paths]
    columns = [np.concatenate([np.asarray(tile[name]) for tile in tiles]) for name in ("X", "Y", "Z", "classification")]
    return np.stack(columns)[:, np.lexsort(columns[2::-1])]


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_a_survey_has_the_classes_of_its_area(survey, tmp_path, monkeypatch):
    """At most 0.1 % of the points differ with a margin of 50 m; without, more than a twentieth."""
    monkeypatch.setattr(extents, "LEAST_M", 0)  # otherwise the region of each quarter is the whole area
    whole = classes([survey / "separated.laz"])
    differing = {}
    for margin in (0, 50):
        out = tmp_path / str(margin)
        separate(survey / "tiles", "-o", f"{out}/", "--margin", margin, "-q", "-j", 1, *OPENING, code=0)
        found = classes(sorted(out.iterdir()))
        np.testing.assert_array_equal(found[:3], whole[:3])
        differing[margin] = (found[3] != whole[3]).mean()
    assert differing[50] <= 0.001
    assert differing[0] > 0.05


def test_the_number_of_processes_does_not_matter(survey, tmp_path):
    found = []
    for jobs in (1, 2):
        separate(survey / "tiles", "-o", f"{tmp_path / str(jobs)}/", "-j", jobs, code=0)
        found.append(contents(tmp_path / str(jobs)))
    assert found[0] == found[1]
    backwards = sorted((survey / "tiles").iterdir(), reverse=True)
    separate_here(*backwards, "-o", f"{tmp_path / 'backwards'}/", code=0)
    assert contents(tmp_path / "backwards") == found[0]


def test_only_tiles_with_neighbours_change(survey, tmp_path):
    """Tiles far away, of another reference system, or of the same place, are separated as if they were alone."""
    tiles = tmp_path / "tiles"
    tiles.mkdir()
    xyz = scene()
    west = xyz[xyz[:, 0] < SEAM]
    write(tiles / "west.laz", west)
    write(tiles / "again.laz", west + np.array([0.3, 0.3, 0]))
    write(tiles / "far.laz", west + np.array([3000, 0, 0]))
    _with_feet(write(tiles / "feet.las", xyz[xyz[:, 0] >= SEAM]))
    result = separate_here(tiles, "-o", f"{tmp_path / 'out'}/", "-v", *OPENING, code=0)
    assert "4 tiles, 0 pairs of neighbours" in result.stderr
    assert "2 coordinate reference systems" in result.stderr
    separate(tiles / "west.laz", "-o", tmp_path / "alone.laz", code=0)
    np.testing.assert_array_equal(classes([tmp_path / "alone.laz"]), classes([tmp_path / "out" / "west.laz"]))


def _with_feet(path):
    """Change the unit in the GeoTIFF keys of a LAS file to the international foot."""
    data = path.read_bytes()
    key = np.array([1, 1, 0, 1, 1024, 0, 1, 1], "<u2").tobytes()
    assert key in data
    path.write_bytes(data.replace(key, np.array([1, 1, 0, 1, 3076, 0, 1, 9002], "<u2").tobytes()))


def test_margins_of_tiles_in_feet_are_metres(tmp_path, monkeypatch):
    """Feet of the same size in numbers are a third in metres, so that a margin reaches farther."""
    monkeypatch.setattr(extents, "LEAST_M", 0)
    xyz = scene() / [1, 1, 0.3048]
    parts = {"west": xyz[xyz[:, 0] < 80], "east": xyz[xyz[:, 0] >= 120]}  # 40 feet are 12.2 m apart
    heads = [extents.read_head(_feet(tmp_path / f"{name}.las", own)) for name, own in parts.items()]
    assert heads[0].extent.high[0] - heads[0].extent.low[0] == pytest.approx(80 * 0.3048, abs=0.1)
    assert [[len(own) for own in extents.neighbors_of(heads, margin)] for margin in (12.0, 12.5)] == [[0, 0], [1, 1]]


def _feet(path, xyz):
    write(path, xyz)
    _with_feet(path)
    return path


def test_points_of_other_formats_are_neighbours(survey, tmp_path):
    """Neighbours may have other dimensions, such as no time, and be LAS instead of LAZ."""
    tiles, xyz = tmp_path / "tiles", scene()
    tiles.mkdir()
    write(tiles / "west.laz", xyz[xyz[:, 0] < SEAM])
    write(tiles / "east.las", xyz[xyz[:, 0] >= SEAM], point_format=3, scale=0.01)
    result = separate_here(tiles, "-o", f"{tmp_path / 'out'}/", "-v", *OPENING)
    assert (result.exit_code, "1 pair of neighbours" in result.stderr) == (0, True), result.output
    found = classes([tmp_path / "out" / "west.laz"])
    whole = classes([survey / "separated.laz"])
    assert (found[3] != whole[3, whole[0] < SEAM * 1000]).mean() < 0.001


def test_an_error_of_one_tile_leaves_the_others(survey, tmp_path):
    tiles = tmp_path / "tiles"
    shutil.copytree(survey / "tiles", tiles)
    damaged = bytearray((tiles / "nw.laz").read_bytes())
    damaged[len(damaged) // 3 : len(damaged) // 2] = b"\xff" * (len(damaged) // 2 - len(damaged) // 3)
    (tiles / "nw.laz").write_bytes(damaged)
    result = separate(tiles, "-o", f"{tmp_path / 'out'}/", "-j", 2, "--json", "--manifest", tmp_path / "m.csv", code=1)
    assert f"Error: {tiles / 'nw.laz'}: " in result.stderr
    assert "no margin from nw.laz, which cannot be read" in result.stderr
    rows = json.loads(result.stdout)
    assert [(row["tile"], row["status"], row["output"] is None) for row in rows] == [
        ("ne", "done", False),
        ("nw", "failed", True),
        ("se", "done", False),
        ("sw", "done", False),
    ]
    assert sorted(contents(tmp_path / "out")) == ["ne.laz", "se.laz", "sw.laz"]
    with (tmp_path / "m.csv").open(newline="") as file:
        assert [row["status"] for row in csv.DictReader(file)] == [row["status"] for row in rows]


def test_a_run_goes_on_where_it_stopped(survey, tmp_path):
    line = (survey / "tiles", "-o", f"{tmp_path / 'out'}/", "--resume")
    separate(*line, code=0)
    complete = contents(tmp_path / "out")
    (tmp_path / "out" / "se.laz").unlink()
    result = separate_here(*line, "--json")
    assert [row["status"] for row in json.loads(result.stdout)] == ["skipped", "skipped", "done", "skipped"]
    assert contents(tmp_path / "out") == complete
    assert [row["points"] for row in json.loads(result.stdout)] == [
        len(read(tmp_path / "out" / name)) for name in sorted(complete)
    ]
    result = separate_here(*line, "--with-height")
    assert "ne: separated again; the earlier output is of other options" in result.stderr
    assert contents(tmp_path / "out") != complete


def test_a_changed_neighbour_changes_a_tile(survey, tmp_path):
    tiles = tmp_path / "tiles"
    shutil.copytree(survey / "tiles", tiles)
    line = (tiles, "-o", f"{tmp_path / 'out'}/", "--resume", "--margin", 20, "--json")
    separate(*line, code=0)
    xyz = scene()
    write(tiles / "ne.laz", xyz[(xyz[:, :2] >= SEAM).all(axis=1)][:-10])
    assert [row["status"] for row in json.loads(separate_here(*line).stdout)] == ["done"] * 4
    assert [row["status"] for row in json.loads(separate_here(*line).stdout)] == ["skipped"] * 4


def test_outputs_of_other_runs_are_kept(survey, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    shutil.copy(survey / "separated.laz", out / "se.laz")
    result = separate(survey / "tiles", "-o", f"{out}/", "--resume")
    assert (result.exit_code, "without a record of its run" in result.stderr) == (2, True)
    (out / "se.laz").write_bytes(b"important")
    result = separate(survey / "tiles", "-o", f"{out}/", "--resume")
    assert (result.exit_code, "not a separated tile" in result.stderr) == (2, True)
    assert contents(out) == {"se.laz": b"important"}
    separate_here(survey / "tiles", "-o", f"{out}/", "--resume", "--force", code=0)


def test_several_tiles_need_a_folder(survey, tmp_path):
    (tmp_path / "out.laz").write_bytes(b"important")
    result = separate(survey / "tiles", "-o", tmp_path / "out.laz", "--force")
    assert (result.exit_code, "is a file, but 4 tiles need a folder" in result.stderr) == (2, True)
    assert (tmp_path / "out.laz").read_bytes() == b"important"


def test_a_single_tile_has_no_record_of_its_run(survey):
    numbers = [number for user, number, *_ in raw_records(survey / "separated.laz")[1] if user == b"seaclutter"]
    assert numbers == [7, 1]


def test_small_tiles_have_wide_margins():
    """Waves of a tile that is smaller than they are long cannot be estimated."""
    head = extents.TileHead(None, None, extents.Extent((0, 0), (100, 1000)))
    assert extents.region_of(head, 50) == extents.Extent((-250, -50), (350, 1050))


def test_resume_needs_outputs_with_records(survey, tmp_path):
    result = separate(survey / "whole.laz", "-o", tmp_path / "out.pcd", "--resume")
    assert (result.exit_code, "--resume needs LAS or LAZ outputs" in result.stderr) == (2, True)


def test_two_tiles_of_one_name_are_named(survey, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    shutil.copy(survey / "tiles" / "sw.laz", other)
    result = separate(survey / "tiles", other, "-o", f"{tmp_path / 'out'}/", code=2)
    assert f"{survey / 'tiles' / 'sw.laz'} and {other / 'sw.laz'} would both become" in result.stderr
