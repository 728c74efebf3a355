"""GeoPackages as GDAL reads them."""

import time

import numpy as np
import pytest

from seaclutter_cli.runs.classify.maps import geopackage

pytest.importorskip("fudgeo")
pyogrio = pytest.importorskip("pyogrio")

LINE, RING = [(4.1, 52.0), (4.2, 52.1), (4.3, 52.1)], [(4.1, 52.0), (4.2, 52.0), (4.2, 52.1), (4.1, 52.0)]
LAYERS = {
    "shoreline": ({"tile": str, "length_m": float}, [(LINE, ("a", 3.5)), (LINE[:2], ("ß", 1.0))]),
    "objects": ({"class": str, "points": int}, [(RING, ("ship", 30))]),
}


def test_gdal_reads_all_features(tmp_path):
    path = tmp_path / "x.gpkg"
    path.write_bytes(geopackage(LAYERS))
    assert pyogrio.list_layers(path).tolist() == [["shoreline", "LineString"], ["objects", "Polygon"]]
    for layer, expected in (("shoreline", [["a", "ß"], [3.5, 1.0]]), ("objects", [["ship"], [30]])):
        fields, features = LAYERS[layer]
        info = pyogrio.read_info(path, layer=layer)
        assert (info["crs"], info["features"]) == ("EPSG:4326", len(features))
        meta, _, shapes, values = pyogrio.raw.read(path, layer=layer)
        assert meta["fields"].tolist() == list(fields)
        assert [column.tolist() for column in values] == expected
        numbers = np.frombuffer(shapes[0], "<f8", offset=9 if layer == "shoreline" else 13)
        np.testing.assert_array_equal(numbers.reshape(-1, 2), features[0][0])


def test_the_same_layers_give_the_same_bytes(monkeypatch):
    first = geopackage(LAYERS)
    monkeypatch.setattr("fudgeo.geopkg.now", lambda: time.strftime("2031-%m-%dT00:00:00.000000Z"))
    assert geopackage(LAYERS) == first


def test_no_features(tmp_path):
    path = tmp_path / "x.gpkg"
    path.write_bytes(geopackage({"shoreline": ({"tile": str}, [])}))
    assert pyogrio.read_info(path)["features"] == 0
