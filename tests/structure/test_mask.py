"""Masks against a loop over sectors, and their files."""

import io
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import ConfigError, FieldError
from seaclutter_cli.frame import Frame
from seaclutter_cli.structure.mask import COLUMNS, Sector, StructureMask, load_mask

HEAD = ",".join(COLUMNS)


@st.composite
def sectors(draw):
    limits = []
    for low, high in ((-89, 89), (-180, 180), (0, 40)):
        first = draw(st.integers(low, high - 1))
        limits += [float(first), float(draw(st.integers(first + 1, high)))]
    return Sector(*limits)


def inside(sector, x, y, z):
    """Return whether a point is in a sector; None if it is on a border, where rounding decides."""
    range_m = math.sqrt(x * x + y * y + z * z)
    values = math.degrees(math.asin(z / range_m)), math.degrees(math.atan2(y, x)), range_m
    limits = (
        (sector.elevation_min_deg, sector.elevation_max_deg),
        (sector.azimuth_min_deg, sector.azimuth_max_deg),
        (sector.range_min_m, sector.range_max_m),
    )
    pairs = list(zip(values, limits, strict=True))
    if any(abs(value - limit) < 1e-6 for value, both in pairs for limit in both):
        return None
    return all(low <= value < high for value, (low, high) in pairs)


@settings(max_examples=200, deadline=None)
@given(sectors(), st.lists(st.tuples(*[st.floats(-30, 30).filter(lambda value: abs(value) > 0.01)] * 3), min_size=1))
def test_one_sector_against_its_limits(sector, places):
    xyz = np.array(places).T
    found = StructureMask((sector,)).contains(xyz, np.sqrt((xyz**2).sum(axis=0)))
    for place, one in zip(places, found, strict=True):
        assert inside(sector, *place) in (None, bool(one))


@settings(max_examples=100, deadline=None)
@given(st.lists(sectors(), min_size=2, max_size=5), st.integers(0, 2**32 - 1))
def test_several_sectors_contain_what_each_contains(chosen, seed):
    xyz = np.random.default_rng(seed).uniform(-25, 25, (3, 200))
    found = StructureMask(tuple(chosen)).contains(xyz, np.sqrt((xyz**2).sum(axis=0)))
    for place, one in zip(xyz.T, found, strict=True):
        assert one or not any(inside(sector, *place) for sector in chosen)


def test_sectors_that_do_not_touch_in_direction_have_their_own_ranges():
    mask = StructureMask((Sector(-5, 5, -10, 10, 2, 3), Sector(-5, 5, 80, 100, 8, 9)))
    xyz = np.array([[2.5, 8.5, 0, 0], [0, 0, 8.5, 2.5], [0, 0, 0, 0.0]])
    assert mask.contains(xyz, np.abs(xyz).max(axis=0)).tolist() == [True, False, True, False]


def test_points_without_a_range_are_outside():
    mask = StructureMask((Sector(-90, 90, -180, 180, 0, 5),))
    xyz = np.array([[np.nan, 0, np.inf, 1], [0, 0, 0, 0], [0, 0, 0, 0]])
    range_m = np.array([np.nan, 0, np.inf, 1])
    assert mask.contains(xyz, range_m).tolist() == [False, True, False, True]


@settings(max_examples=50, deadline=None)
@given(st.lists(sectors(), max_size=6))
def test_files_round_trip(tmp_path_factory, chosen):
    path = tmp_path_factory.mktemp("mask") / "mask.csv"
    path.write_text(StructureMask(tuple(chosen)).as_csv(), encoding="utf-8")
    assert load_mask(path).sectors == tuple(chosen)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "line 1: must have the columns elevation_min_deg"),
        ("a,b\n", "line 1: must have the columns"),
        (f"{HEAD}\n1,2,3\n", "line 2: must have 6 values, has 3"),
        (f"{HEAD}\n0,1,0,1,2,3\n0,1,0,1,2,x\n", "line 3: could not convert string to float: 'x'"),
        (f"{HEAD}\n1,1,0,1,2,3\n", "line 2: elevation_min_deg (1) must be less than elevation_max_deg (1)"),
        (f"{HEAD}\n0,1,0,181,2,3\n", "line 2: azimuths must be from -180 to 180"),
        (f"{HEAD}\n0,1,0,1,2,inf\n", "line 2: all values must be finite numbers"),
        (HEAD + "\n" + "".join(f"{k},{k + 0.5},{k * 0.06},{k * 0.06 + 0.03},1,2\n" for k in range(2500)), "too many"),
        ("\udcff", "neither UTF-8 text nor PNG"),
        ('"', "must have the columns"),
    ],
)
def test_files_that_are_no_masks(tmp_path, text, problem):
    path = tmp_path / "mask.csv"
    path.write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(ConfigError) as caught:
        load_mask(path)
    assert str(caught.value).startswith(f"filter.mask: {path}: ")
    assert problem in str(caught.value)


def test_a_file_that_is_missing_or_large(tmp_path, monkeypatch):
    with pytest.raises(ConfigError, match="cannot be read"):
        load_mask(tmp_path / "none.csv")
    monkeypatch.setattr("seaclutter_cli.structure.mask._MAX_BYTES", 10)
    (tmp_path / "mask.csv").write_text(HEAD)
    with pytest.raises(ConfigError, match="more than 10 bytes"):
        load_mask(tmp_path / "mask.csv")


def png(hidden, mode="L", size=None):
    """Return an image that is dark where own structure is."""
    stream = io.BytesIO()
    image = Image.fromarray(np.where(hidden, 0, 255).astype(np.uint8))
    image = image if size is None else image.resize(size)
    if mode == "drawn":  # on a transparent layer
        layer = np.zeros((*hidden.shape, 4), np.uint8)
        layer[hidden, 3] = 255
        image = Image.fromarray(layer)
    elif mode != "L":
        image = image.convert(mode)
    image.save(stream, "PNG")
    return stream.getvalue()


def numbered(xyz, ring):
    points = np.zeros(len(xyz), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("ring", "<u2")])
    for name, values in zip(points.dtype.names, (*xyz.T, ring), strict=True):
        points[name] = values
    return replace(Frame.of_arrays(xyz), cloud=from_array(points))


@pytest.mark.parametrize("mode", ["L", "1", "P", "RGB", "drawn"])
def test_images_of_the_shape_of_the_clouds(tmp_path, mode):
    hidden = np.random.default_rng(0).random((4, 6)) < 0.4
    (tmp_path / "mask.png").write_bytes(png(hidden, mode))
    cloud = replace(Frame.of_arrays(np.zeros((24, 3))).cloud, height=4, width=6)
    frame = replace(Frame.of_arrays(np.zeros((24, 3))), cloud=cloud)
    assert load_mask(tmp_path / "mask.png").covers(frame).tolist() == hidden.reshape(-1).tolist()


@pytest.mark.parametrize("upwards", [True, False])
def test_images_of_rings_by_azimuth(tmp_path, upwards):
    hidden = np.zeros((16, 36), np.bool_)
    hidden[0, 0] = hidden[15, 17] = True  # aft to port in the uppermost beam, just to port of the bow in the lowest
    (tmp_path / "mask.png").write_bytes(png(hidden))
    azimuth, ring = (each.reshape(-1) for each in np.meshgrid(np.arange(-175.0, 180, 10), np.arange(16)))
    elevation = np.radians(-15 + 2 * ring if upwards else 15 - 2 * ring)
    xyz = np.column_stack([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth)), np.tan(elevation)]) * 9
    frame = numbered(xyz, ring)
    found = np.flatnonzero(load_mask(tmp_path / "mask.png").covers(frame))
    top = 15 if upwards else 0
    assert sorted(zip(ring[found].tolist(), azimuth[found].tolist(), strict=True)) == sorted(
        [(top, 175.0), (15 - top, 5.0)]
    )
    lower = numbered(xyz, ring + 1)
    with pytest.raises(FieldError, match="has 16 rows, but the rings are up to 16"):
        load_mask(tmp_path / "mask.png").covers(lower)
    with pytest.raises(FieldError, match=r"needs clouds of 16 by 36 points, or with a field for the ring"):
        load_mask(tmp_path / "mask.png").covers(Frame.of_arrays(xyz))


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (png(np.zeros((9, 9), np.bool_))[:45], "cannot be decoded"),
        (png(np.zeros((2, 2), np.bool_), size=(3000, 3000)), "3,000 by 3,000 pixels are too many"),
        (b"\x89PNG\r\n\x1a\n" + bytes(40), "cannot be decoded"),
    ],
)
def test_images_that_are_no_masks(tmp_path, data, problem):
    (tmp_path / "mask.png").write_bytes(data)
    with pytest.raises(ConfigError, match=problem):
        load_mask(tmp_path / "mask.png")
