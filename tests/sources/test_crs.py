"""Coordinate reference systems of LAS files: units and conversion, against pyproj's own reading."""

import struct
from types import SimpleNamespace

import numpy as np
import pytest

from seaclutter_cli.errors import MissingExtraError
from seaclutter_cli.sources.tiles import Crs, read_crs

FOOT_US = 1200 / 3937


def record(number, data, user="LASF_Projection"):
    return SimpleNamespace(user_id=user, record_id=number, record_data=data)


def keys(**entries):
    """Return a GeoTIFF key directory; names are ``k`` and the number of the key."""
    quads = [(int(name[1:]), 0, 1, value) for name, value in entries.items()]
    return record(
        34735, struct.pack("<4H", 1, 1, 0, len(quads)) + b"".join(struct.pack("<4H", *quad) for quad in quads)
    )


@pytest.mark.parametrize("version", ["WKT1_GDAL", "WKT2_2019"])
@pytest.mark.parametrize(
    ("code", "unit_m", "height_unit_m", "is_geographic"),
    [
        ("EPSG:32631", 1.0, 1.0, False),
        ("EPSG:2992", 0.3048, 0.3048, False),
        ("EPSG:2263", FOOT_US, FOOT_US, False),
        ("EPSG:2263+5703", FOOT_US, 1.0, False),
        ("EPSG:32631+6360", 1.0, FOOT_US, False),
        ("EPSG:4326", 1.0, 1.0, True),
    ],
)
def test_units_in_wkt(version, code, unit_m, height_unit_m, is_geographic):
    pyproj = pytest.importorskip("pyproj", reason="needs the extra geo")
    text = pyproj.CRS.from_user_input(code).to_wkt(version)
    found = read_crs([record(4, b"", "LASF_Spec"), record(2112, text.encode() + b"\0")])
    assert found.unit_m == pytest.approx(unit_m, rel=1e-9)
    assert found.height_unit_m == pytest.approx(height_unit_m, rel=1e-9)
    assert found.is_geographic == is_geographic


@pytest.mark.parametrize("text", ["''", '""', "unknown", ""])
def test_what_is_no_wkt_is_left_out(text):
    record_of_text = record(2112, text.encode() + b"\0")
    assert read_crs([record_of_text]) == Crs()
    assert read_crs([record_of_text, keys(k1024=1, k3072=32631)]) == Crs("EPSG:32631")


def test_a_local_system_has_no_degrees():
    found = read_crs([record(2112, b'LOCAL_CS["site",LOCAL_DATUM["site",0],UNIT["foot",0.3048]]\0')])
    assert (found.is_geographic, found.unit_m) == (False, 0.3048)


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ({"k1024": 1, "k3072": 32631, "k3076": 9001}, Crs("EPSG:32631")),
        ({"k1024": 1, "k3072": 2992, "k3076": 9002}, Crs("EPSG:2992", 0.3048, 0.3048)),
        ({"k1024": 1, "k3072": 32767, "k3076": 9003, "k4099": 9001}, Crs("", FOOT_US, 1.0)),
        ({"k1024": 2, "k2048": 4326}, Crs("", is_geographic=True)),
        ({}, Crs()),
    ],
)
def test_units_in_geotiff_keys(entries, expected):
    assert read_crs([keys(**entries)]) == expected


@pytest.mark.parametrize("records", [[], [record(2112, b"")], [record(2112, b'PROJCS["x",UNIT["y",nan]]')]])
def test_without_a_usable_system_the_unit_is_the_metre(records):
    assert read_crs(records).unit_m == 1


def test_wgs84():
    pyproj = pytest.importorskip("pyproj", reason="needs the extra geo")
    xy = np.array([[500_000.0, 5_761_038.2], [512_345.0, 3_458_000.0]])
    convert = Crs("EPSG:32631").to_wgs84()
    geographic = pyproj.Proj("EPSG:32631")
    expected = np.array([geographic(*one, inverse=True) for one in xy])
    np.testing.assert_allclose(convert(xy), expected, atol=1e-9)
    assert Crs().to_wgs84() is None
    assert Crs("no such system").to_wgs84() is None


def test_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyproj", None)
    with pytest.raises(MissingExtraError, match="geo"):
        Crs("EPSG:32631").to_wgs84()


def test_wkt_and_keys_of_the_same_system_are_equal_by_code():
    pyproj = pytest.importorskip("pyproj", reason="needs the extra geo")
    utm = pyproj.CRS.from_epsg(32631)
    for version in ("WKT1_GDAL", "WKT2_2019"):
        text = utm.to_wkt(version).encode()
        assert read_crs([record(2112, text)]).by_code == Crs("EPSG:32631")
    compound = read_crs([record(2112, pyproj.CRS.from_epsg(7415).to_wkt("WKT1_GDAL").encode())])
    assert compound.by_code.definition == "EPSG:7415"  # neither that of its positions, 28992, nor that of its heights
    assert Crs('PROJCS["own",UNIT["metre",1]]').by_code == Crs('PROJCS["own",UNIT["metre",1]]')
