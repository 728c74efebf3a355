"""Strips of a tile: the passes of the aircraft, their looks ahead and behind, and the tide in each."""

import numpy as np
import pytest

from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.strips import looks_of, strip_levels, strips_of
from seaclutter_cli.airborne.surface import OTHER, SeparationParams
from seaclutter_cli.grids.elevation import GriddedPoints

SPEED_M_S, RADIUS_M = 60.0, 120.0


@pytest.mark.parametrize(("source", "times", "expected"), [
    ([7] * 5, [0.0, 3, 90, 93, np.nan], [0, 0, 1, 1, 0]),
    ([7, 8, 8, 7, 7], [0.0] * 5, [0, 1, 1, 0, 0]),
    (None, [0.0, 1, 2, 3, 4], None),
    ([7] * 5, None, None),
])  # fmt: skip
def test_strips_by_number_or_time(source, times, expected):
    found = strips_of({"point_source_id": source and np.array(source), "gps_time": times and np.array(times)}.get)
    assert (found if found is None else found.tolist()) == expected


def test_strips_of_few_points_are_one():
    assert set(strips_of({"point_source_id": np.r_[np.zeros(1000), np.arange(5)]}.get).tolist()) == {0, 1}


def cone(rng, sides=(300.0, 200.0), echoes=150_000):
    """Return position, time and look (1 ahead, -1 behind) of the echoes of a scanner on a cone that flies along x."""
    time, angle = rng.uniform(-10, 20, echoes), rng.uniform(0, 2 * np.pi, echoes)
    x, y = SPEED_M_S * time + RADIUS_M * np.cos(angle), 100 + RADIUS_M * np.sin(angle)
    inside = (x > 0) & (x < sides[0]) & (y > 0) & (y < sides[1])
    return np.stack((x, y))[:, inside], time[inside], np.sign(np.cos(angle))[inside]


def test_looks_ahead_and_behind_are_strips():
    place, time, look = cone(np.random.default_rng(1))
    xyz = np.vstack((place, np.zeros(len(time))))
    found = looks_of(None, np.array_split(xyz, 3, axis=1), {"gps_time": time}.get)
    assert np.mean((found == 0) == (look > 0)) > 0.98


def test_a_scanner_in_lines_sees_places_once():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 300, (2, 100_000))
    time = (x + 0.3 * y) / SPEED_M_S + rng.uniform(0, 0.05, len(x))
    strip = (y > 150).astype(np.uint8)
    assert looks_of(strip, [np.stack((x, y, y))], {"gps_time": time}.get) is strip
    assert looks_of(None, [np.stack((x, y, y))], {"gps_time": time * np.nan}.get) is None


def test_a_cone_over_waves():
    rng = np.random.default_rng(2)
    place, time, _ = cone(rng, echoes=300_000)
    z = np.zeros(len(time))
    for _ in range(40):
        k, angle = 2 * np.pi / (30 * rng.normal(1, 0.08)), rng.normal(0.6, 0.2)
        phase = k * (np.cos(angle) * place[0] + np.sin(angle) * place[1]) - np.sqrt(9.81 * k) * time
        z += np.sin(phase + rng.uniform(0, 7))
    xyz = np.vstack((place, 1.2 / 4 * z / z.std() + rng.normal(0, 0.03, len(z))))
    assert (separate([xyz], SeparationParams(), {"gps_time": time}.get).classification == OTHER).mean() < 0.01


def overlapping(tides, rng, echoes=40_000):
    """Return the points of strips of 200 m that overlap by 50 m, their strip, and which are on land (y > 200 m)."""
    strip = np.repeat(np.arange(len(tides)), echoes)
    x, y = rng.uniform(0, 200, len(strip)) + 150 * strip, rng.uniform(0, 300, len(strip))
    ground = 1 + (y - 200) / 20 + 0.2 * np.sin(x / 9) * np.sin(y / 7)
    land = y > 200
    z = np.where(land, ground, np.asarray(tides)[strip]) + rng.normal(0, 0.03, len(strip))
    return np.stack((x, y, z)), strip.astype(np.uint8), land


@pytest.mark.parametrize("tides", [(0.0, 0.0, 0.0), (0.0, 0.3, 0.6), (0.0, -0.7, 0.4)])
def test_tide_of_each_strip(tides):
    xyz, strip, _ = overlapping(tides, np.random.default_rng(3))
    found = strip_levels(GriddedPoints([xyz], 1.0), strip).tide_m
    np.testing.assert_allclose(found - found[0], tides, atol=0.02)


def test_waves_are_no_tide():
    rng = np.random.default_rng(4)
    xyz, strip, _ = overlapping((0.0, 0.0), rng)
    xyz[2] = 0.3 * np.sin(xyz[0] / 9 + 2 * strip) + 0.3 * np.sin(xyz[1] / 11 + 3 * strip)
    assert not strip_levels(GriddedPoints([xyz], 1.0), strip).tide_m.any()


@pytest.mark.parametrize("tides", [(0.0, 0.3, 0.6), (0.0, -0.7, 0.4)])
def test_strips_at_high_and_low_tide_are_sea(tides):
    rng = np.random.default_rng(5)
    xyz, strip, land = overlapping(tides, rng)
    intensity = np.where(land, rng.normal(200, 40, len(strip)), rng.gamma(2.0, 30, len(strip))).clip(0)
    columns = {"intensity": intensity, "point_source_id": strip + 1}
    other = separate([xyz], SeparationParams(), columns.get).classification == OTHER
    assert other[~land].mean() < 0.02
    assert other[land].mean() > 0.98
    # Published heights are of one surface for all strips.
    assert (separate([xyz], SeparationParams(height_m=0.5, land="ignore"), columns.get).height_m[~land] > 0.25).any()


def moved(still, rng, height=0.4, length=70.0):
    """Return points of two strips over all of a tile with waves, or with a relief that has the form of such waves."""
    strip = np.repeat([0, 1], 60_000)
    x, y = (rng.uniform(0, side, len(strip)) for side in (400, 300))
    total = np.zeros(len(strip))
    for _ in range(30):
        k, angle = 2 * np.pi / (length * rng.normal(1, 0.1)), 0.6 + rng.normal(0, 0.3)
        phase = np.sqrt(9.81 * k) * 300 * strip * (not still)
        total += np.sin(k * (np.cos(angle) * x + np.sin(angle) * y) - phase + rng.uniform(0, 7))
    z = height / 4 * total / total.std() + 0.05 * strip + rng.normal(0, 0.03, len(strip))
    return np.stack((x, y, z)), {"point_source_id": strip}


def test_what_two_strips_show_alike_is_no_wave():
    sea = separate([(points := moved(False, np.random.default_rng(1)))[0]], SeparationParams(), points[1].get)
    assert sea.sea.wave_height_m == pytest.approx(0.4, rel=0.25)
    assert (sea.classification == OTHER).mean() < 0.001
    assert not sea.is_doubtful
    ground = separate([(points := moved(True, np.random.default_rng(1)))[0]], SeparationParams(), points[1].get)
    assert ground.is_doubtful or (ground.classification == OTHER).mean() > 0.9


def test_changes_are_those_between_the_first_and_the_last_strip():
    xyz, strip, land = overlapping((0.0, 0.3, 0.6), np.random.default_rng(3))
    points = GriddedPoints([xyz], 1.0)
    levels = strip_levels(points, strip)
    change = levels.changes_m()
    seen = np.isfinite(change)
    np.testing.assert_array_equal(seen, np.count_nonzero(levels.seen, axis=0) > 1)
    assert 0.1 < seen.sum() / len(np.unique(np.floor(xyz[:2] / 8), axis=1).T) < 0.4
    assert np.nanmedian(np.abs(change)) < 0.2
    assert np.nanmax(np.abs(change)) > 0.2, "the tide is what most squares have in common, and land has none"
    assert land.any()
