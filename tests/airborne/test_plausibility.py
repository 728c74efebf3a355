"""Doubts about tiles over land, and about objects of impossible size."""

import json
from dataclasses import replace

import numpy as np
import pytest

from seaclutter_cli.airborne.objects import FoundObject, doubts_about_objects, doubts_about_sea
from seaclutter_cli.airborne.separation import SeaState, Separation
from seaclutter_cli.airborne.surface import OTHER, WATER
from seaclutter_cli.runs.classify.maps import MappedTile, geojson_of
from seaclutter_cli.runs.classify.predict import ClassifiedTile
from seaclutter_cli.runs.observer import SILENT
from seaclutter_cli.sources.tiles import Crs
from tests.paths import ROOT, shared
from tests.running import execute

SHIP = FoundObject(1, 1, 0.9, 500, (1000.0, 2000.0), (120.0, 20.0), 0.0, 25.0, 2000.0)


def separation(elevation, other=0):
    classes = np.append(np.full(len(elevation), WATER, np.uint8), np.full(other, OTHER, np.uint8))
    points = np.append(np.zeros((2, len(classes))), [np.append(elevation, np.full(other, 50.0))], axis=0)
    return [points], Separation(classes, np.zeros(len(classes), np.float32), 1)


@pytest.mark.parametrize(
    ("elevation", "other", "doubts"),
    [
        (np.linspace(-1.5, 1.5, 1000), 500, []),
        (np.append(np.linspace(-0.1, 0.1, 995), [30] * 5), 0, []),  # a few cliffs
        (
            np.append(np.zeros(600), np.linspace(0, 0.1, 400)),
            0,
            ["60.1 % of what was taken for the sea has exactly one"],
        ),
        (np.linspace(120, 140, 1000), 0, ["not level: it lies between 120.2 and 139.8 m"]),
        (np.zeros(40), 960, ["only 4.0 % of the points are sea"]),
        (np.zeros(0), 10, ["no point is sea"]),
    ],
)
def test_tiles_over_land(elevation, other, doubts):
    found = doubts_about_sea(*separation(elevation, other))
    assert len(found) == len(doubts)
    assert all(text in line for text, line in zip(doubts, found, strict=True))


@pytest.mark.parametrize(("height_m", "doubts"), [(0.9, 0), (1.4, 1)])
def test_objects_as_low_as_waves(height_m, doubts):
    parts, found = separation(np.linspace(-0.1, 0.1, 100))
    rough = replace(found, sea=SeaState("followed", 0.0, 1.5, 45.0, height_m))
    texts = doubts_about_sea(parts, rough)
    assert len(texts) == doubts
    assert all("waves of 1.5 m: what rises less than 1.4 m" in text for text in texts)


def test_a_tile_in_which_nothing_tells():
    parts, found = separation(np.linspace(-0.1, 0.1, 1000))
    (text,) = doubts_about_sea(parts, replace(found, is_doubtful=True))
    assert "the tile may be of land; classes of its points help" in text


def test_ships_of_a_kilometre():
    assert doubts_about_objects([SHIP, replace(SHIP, size=(459.0, 60.0))]) == []
    islands = replace(SHIP, code=6, size=(1156.0, 492.0), height_m=88.0)
    assert doubts_about_objects([islands]) == []
    (text,) = doubts_about_objects([SHIP, replace(islands, code=1), replace(SHIP, height_m=90.0)])
    assert text.startswith("2 ships of implausible size, up to 1156 by 492 by 88 m")


def test_boxes_in_feet():
    feet = SHIP.placed(0.3048)
    assert feet.center == pytest.approx((1000 / 0.3048, 2000 / 0.3048))
    tile = MappedTile("t", Crs(unit_m=0.3048), objects=[feet])
    ((name, *_, x, y, length, width, yaw, _, _),) = ClassifiedTile(recording="t", map=tile).rows()
    assert (name, x, y, length, width, yaw) == ("t", "3280.840", "6561.680", "120.000", "20.000", f"{feet.yaw:.4f}")
    (feature,) = json.loads(geojson_of([tile], SILENT))["features"]
    ring = np.array(feature["geometry"]["coordinates"][0][:4])
    np.testing.assert_allclose(ring * 0.3048, SHIP.corners(), atol=1e-3)
    assert feature["properties"]["coordinates"] == "tile"


def separate(tile, out):
    pytest.importorskip("lazrs", reason="needs the extra las")
    return execute("classify", "separate", tile, "-o", out)


@pytest.mark.parametrize("tile", ["sample", "airborne"])
def test_real_and_simulated_water_gives_no_warning(tmp_path, tile):
    path = ROOT / "samples" / "tile.laz" if tile == "sample" else shared("airborne") / "ahn3_sluice.laz"
    assert separate(path, tmp_path / "s.laz").stderr == ""
