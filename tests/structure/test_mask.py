"""Masks against a loop over sectors, and their files."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.structure.mask import COLUMNS, Sector, StructureMask

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
    assert StructureMask.load(path).sectors == tuple(chosen)


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
        ("\udcff", "not UTF-8 text"),
        ('"', "must have the columns"),
    ],
)
def test_files_that_are_no_masks(tmp_path, text, problem):
    path = tmp_path / "mask.csv"
    path.write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(ConfigError) as caught:
        StructureMask.load(path)
    assert str(caught.value).startswith(f"filter.mask: {path}: ")
    assert problem in str(caught.value)


def test_a_file_that_is_missing_or_large(tmp_path, monkeypatch):
    with pytest.raises(ConfigError, match="cannot be read"):
        StructureMask.load(tmp_path / "none.csv")
    monkeypatch.setattr("seaclutter_cli.structure.mask._MAX_BYTES", 10)
    (tmp_path / "mask.csv").write_text(HEAD)
    with pytest.raises(ConfigError, match="more than 10 characters"):
        StructureMask.load(tmp_path / "mask.csv")
