"""Maps of a run over tiles: pictures, and the shoreline as GeoJSON."""

import json
from functools import partial

import numpy as np
import pytest

from seaclutter_cli.airborne.separation import SeaState
from seaclutter_cli.runs.classify.maps import waves_line
from tests.airborne.tiles import read
from tests.running import execute

laspy = pytest.importorskip("laspy")
pyproj = pytest.importorskip("pyproj")
pytest.importorskip("matplotlib")
ORIGIN = (500_000.0, 5_760_000.0)


run = partial(execute, "classify")


def write(path, xyz, epsg=32631):
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, (*ORIGIN, 0)
    if epsg:
        header.add_crs(pyproj.CRS.from_epsg(epsg))
    tile = laspy.LasData(header)
    tile.x, tile.y, tile.z = xyz[0] + ORIGIN[0], xyz[1] + ORIGIN[1], xyz[2]
    tile.write(path)


def island():
    """Return a round island of 40 m in calm water, shape (3, N)."""
    x, y = (side.ravel() + 0.5 for side in np.mgrid[:240, :180].astype(float))
    return np.stack((x, y, np.where(np.hypot(x - 120, y - 90) < 40, 6.0, 0.5)))


@pytest.fixture(scope="module")
def tiles(tmp_path_factory):
    """Return a folder with the two halves of an island."""
    folder, xyz = tmp_path_factory.mktemp("tiles"), island()
    write(folder / "west.laz", xyz[:, xyz[0] < 120])
    write(folder / "east.laz", xyz[:, xyz[0] >= 120])
    return folder


@pytest.fixture(scope="module")
def mapped(tiles, tmp_path_factory):
    out = tmp_path_factory.mktemp("maps")
    maps = ("--plot", out / "map.png", "--geojson", out / "shore.geojson")
    run("separate", tiles, "-o", f"{out / 'tiles'}/", *maps, "-j", 1, code=0)
    return out


@pytest.fixture(scope="module")
def ships(tmp_path_factory):
    """Return a folder with two tiles of calm water beside each other, and a ship of 20 m by 6 m in each."""
    folder, xyz = tmp_path_factory.mktemp("ships"), island()
    xyz[2] = 0.5
    for x, y, height in ((60, 40, 4.0), (190, 130, 2.5)):
        xyz[2, (np.abs(xyz[0] - x) < 10) & (np.abs(xyz[1] - y) < 3)] = 0.5 + height
    write(folder / "west.laz", xyz[:, xyz[0] < 120])
    write(folder / "east.laz", xyz[:, xyz[0] >= 120])
    return folder


def metres(lines):
    """Return positions in WGS 84 as metres from the corner of the tiles."""
    to_utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32631", always_xy=True)
    return [np.stack(to_utm.transform(*np.array(line).T), axis=1) - ORIGIN for line in lines]


def test_the_shoreline_of_a_survey_is_in_wgs_84(mapped):
    features = json.loads((mapped / "shore.geojson").read_text())["features"]
    assert [one["properties"]["tile"] for one in features] == ["east", "west"]
    assert {one["properties"]["kind"] for one in features} == {"shoreline"}
    lines = metres([one["geometry"]["coordinates"] for one in features])
    for line, one in zip(lines, features, strict=True):
        np.testing.assert_allclose(np.hypot(*(line - (120, 90)).T), 40, atol=2)
        assert one["properties"]["length_m"] == pytest.approx(np.pi * 40, rel=0.08)
    assert lines[0][:, 0].min() == pytest.approx(120, abs=1)
    assert lines[1][:, 0].max() == pytest.approx(120, abs=1)


def test_objects_of_a_survey(ships, tmp_path):
    geojson, out = tmp_path / "ships.geojson", f"{tmp_path / 'out'}/"
    run("separate", ships, "-o", out, "--geojson", geojson, "-j", 1, code=0)
    features = json.loads(geojson.read_text())["features"]
    assert [one["geometry"]["type"] for one in features] == ["Polygon"] * 2
    boxes = metres([one["geometry"]["coordinates"][0] for one in features])
    for box, center in zip(boxes, [(190, 130), (60, 40)], strict=True):
        np.testing.assert_allclose(box[:4].mean(axis=0), center, atol=0.5)
        np.testing.assert_allclose(np.ptp(box, axis=0), (19, 5), atol=0.5)
    found = [one["properties"] for one in features]
    assert [(one["tile"], one["object"], one["points"]) for one in found] == [("east", 1, 120), ("west", 1, 120)]
    assert [one["height"] for one in found] == pytest.approx([2.5, 4.0], abs=0.01)
    before = geojson.read_bytes()
    again = run("separate", ships, "-o", out, "--geojson", geojson, "--resume", "-j", 1)
    assert "2 skipped" in again.stdout
    assert geojson.read_bytes() == before


def test_the_search_for_objects_has_settings(ships, tmp_path):
    geojson = tmp_path / "ships.geojson"
    settings = ("--set", "objects.min_points=121")
    run("separate", ships, "-o", f"{tmp_path / 'out'}/", "--geojson", geojson, *settings, "-j", 1, code=0)
    assert json.loads(geojson.read_text())["features"] == []


def test_the_picture_shows_water_land_and_shoreline(mapped):
    from matplotlib.image import imread

    picture = imread(mapped / "map.png")[..., :3]
    colors = np.array([[217, 203, 163], [59, 46, 31]]) / 255
    land, shore = ((np.abs(picture - color) < 0.02).all(axis=2).mean() for color in colors)
    assert 0.02 < land < 0.2
    assert 0.0003 < shore < 0.02


def test_the_number_of_processes_does_not_matter(tiles, mapped, tmp_path):
    maps = ("--plot", tmp_path / "map.png", "--geojson", tmp_path / "shore.geojson")
    run("separate", tiles, "-o", f"{tmp_path / 'tiles'}/", *maps, "-j", 2, code=0)
    for name in ("map.png", "shore.geojson"):
        assert (tmp_path / name).read_bytes() == (mapped / name).read_bytes()


def test_a_map_changes_no_tile(tiles, mapped, tmp_path):
    run("separate", tiles, "-o", f"{tmp_path / 'tiles'}/", "-j", 1, code=0)
    for name in ("east.laz", "west.laz"):
        np.testing.assert_array_equal(
            read(tmp_path / "tiles" / name).points.array, read(mapped / "tiles" / name).points.array
        )


def test_tiles_without_a_known_crs(tmp_path):
    write(tmp_path / "tile.laz", island(), epsg=None)
    maps = "--geojson", tmp_path / "shore.geojson"
    result = run("separate", tmp_path / "tile.laz", "-o", tmp_path / "out.laz", *maps, code=0)
    assert "GeoJSON is in the coordinates of the tile, not in WGS 84" in result.stderr
    (feature,) = json.loads((tmp_path / "shore.geojson").read_text())["features"]
    assert feature["properties"]["coordinates"] == "tile"
    center = np.array(feature["geometry"]["coordinates"]).mean(axis=0)
    np.testing.assert_allclose(center, np.add(ORIGIN, (120, 90)), atol=2)


def test_several_tiles_without_a_known_crs_have_one_warning(tmp_path):
    (tmp_path / "tiles").mkdir()
    for name in "abcd":
        write(tmp_path / "tiles" / f"{name}.laz", island(), epsg=None)
    maps = "--geojson", tmp_path / "shore.geojson"
    result = run("separate", tmp_path / "tiles", "-o", f"{tmp_path / 'out'}/", *maps, "-j", 1)
    warnings = [line for line in result.stderr.splitlines() if "its CRS is unknown" in line]
    assert [line.split(": ")[1] for line in warnings] == ["a, b, c and 1 more"]


def test_a_resumed_run_has_the_maps_of_all_tiles(tiles, mapped, tmp_path):
    """The complete tile is not separated again, but its part of the maps is the same."""
    maps = ("--plot", tmp_path / "map.png", "--geojson", tmp_path / "shore.geojson")
    out = tmp_path / "tiles"
    run("separate", tiles, "-o", f"{out}/", "-j", 1, code=0)
    (out / "east.laz").unlink()
    result = run("separate", tiles, "-o", f"{out}/", *maps, "--resume", "-j", 1)
    assert (result.exit_code, "1 done, 1 skipped" in result.stdout) == (0, True), result.output
    for name in ("map.png", "shore.geojson", "tiles/east.laz", "tiles/west.laz"):
        assert (tmp_path / name).read_bytes() == (mapped / name).read_bytes(), name


def test_a_tile_without_its_land_is_separated_again_for_a_map(tiles, tmp_path, monkeypatch):
    """The land of a tile may be too long for a record."""
    run_again = ("separate", tiles, "-o", f"{tmp_path / 'out'}/", "--plot", tmp_path / "map.png", "--resume", "-j", 1)
    monkeypatch.setattr("seaclutter_cli.runs.classify.separate._MAX_RECORD_BYTES", 50)
    run(*run_again, code=0)
    monkeypatch.undo()
    result = run(*run_again)
    assert result.stderr.count("separated again; the earlier output is of a run that recorded no land") == 2
    assert "2 skipped" in run(*run_again).stdout


def test_names_of_maps(tiles, tmp_path):
    result = run("separate", tiles, "-o", f"{tmp_path / 'out'}/", "--plot", tmp_path / "map.gif")
    assert (result.exit_code, "must end in .png or .svg" in result.stderr) == (2, True)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("waves", "text"),
    [
        ([], "No waves found"),
        ([(1.14, 25.6)], "Waves 1.1 m high, 26 m long"),
        ([(1.1, 25.0), (0.92, 41.0), (None, None)], "Waves 0.9 to 1.1 m high, 25 to 41 m long"),
    ],
)
def test_waves_in_words(waves, text):
    assert waves_line([SeaState("opened", 0.0, *one, 0.5) for one in waves]) == text
