"""Objects in rough water that are higher than waves, or that strips, minutes apart, show at the same height."""

import numpy as np
import pytest

from seaclutter_cli.airborne.gridded import GriddedPoints
from seaclutter_cli.airborne.separation import OTHER, separate
from seaclutter_cli.airborne.standing import standing_elevations, standing_objects
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.airborne.waves import Waves
from seaclutter_cli.grids.elevation import ElevationGrid

DEVIATION_M = 0.2
WAVES = Waves((), 0.0, DEVIATION_M, 40.0, 0.5)
SIDE_M = 250


def sea(x, y, seed):
    """Return waves of 40 m and less from several directions, at one moment."""
    rng = np.random.default_rng(seed)
    z = sum(
        np.sin(2 * np.pi * (np.cos(a) * x + np.sin(a) * y) / length + rng.uniform(0, 2 * np.pi))
        for a, length in zip(rng.normal(0, 0.4, 12), rng.uniform(30, 45, 12), strict=True)
    )
    return DEVIATION_M * z / z.std()


def reef(x, y):
    """Return a dome of 0.9 m, 38 m wide; it is wider than the window, and no steeper than the waves."""
    return 0.9 - 1.0 * ((x - 130) ** 2 + (y - 120) ** 2) / 20**2


def strips(moments=(1, 2)):
    """Return the points of strips that see a reef in waves, their strip, and which are from the reef."""
    parts = []
    for number, moment in enumerate(moments):
        rng = np.random.default_rng(number)
        x, y = rng.uniform(0, SIDE_M, (2, 3 * SIDE_M**2))
        water = sea(x, y, moment)
        parts.append((x, y, np.maximum(water, reef(x, y)) + rng.normal(0, 0.02, len(x)), reef(x, y) > water))
    x, y, z, dry = (np.concatenate(part) for part in zip(*parts, strict=True))
    return np.stack((x, y, z)), np.repeat(np.arange(len(moments)), 3 * SIDE_M**2).astype(np.uint8), dry


def test_strips_show_a_reef_at_the_same_height_and_waves_at_others():
    xyz, strip, dry = strips()
    points = GriddedPoints.of([xyz], 1.0)
    found = standing_elevations(points, strip, WAVES)
    alike = np.isfinite(found).reshape(-1)[points.cells[0]]
    assert alike[dry & (xyz[2] > 0.5)].mean() > 0.9
    assert alike[~dry].mean() < 0.5
    deviation = np.full(found.shape, DEVIATION_M)
    unknown = np.full(found.shape, np.inf)
    stands = standing_objects(points.grid, unknown, found, deviation).reshape(-1)[points.cells[0]]
    assert stands[dry & (xyz[2] > 0.5)].mean() > 0.95
    assert stands[~dry].mean() < 0.001


def test_echoes_far_below_the_water_do_not_hide_what_stands():
    xyz, strip, dry = strips()
    pits = np.random.default_rng(4).random(len(strip)) < 0.02
    xyz[2, pits] -= 8
    points = GriddedPoints.of([xyz], 1.0)
    alike = np.isfinite(standing_elevations(points, strip, WAVES)).reshape(-1)[points.cells[0]]
    assert alike[dry & (xyz[2] > 0.5)].mean() > 0.75


def test_cells_that_one_strip_shows_are_not_alike():
    xyz, strip, _ = strips()
    kept = (strip == 0) | (xyz[0] < 100)
    points = GriddedPoints.of([xyz[:, kept]], 1.0)
    found = standing_elevations(points, strip[kept], WAVES)
    assert np.isfinite(found).any()
    assert not np.isfinite(found.reshape(-1)[points.cells[0][xyz[0, kept] > 101]]).any()


@pytest.mark.parametrize("moments", [(1, 1), (1,)], ids=["two lasers at one moment", "one strip"])
def test_one_moment_does_not_show_what_stands(moments):
    xyz, strip, _ = strips(moments)
    assert standing_elevations(GriddedPoints.of([xyz], 1.0), strip, WAVES) is None


def cells_in_a_row(values, empty):
    """Return a grid, and some values in a row of its cells."""
    grid = ElevationGrid(1.0)
    grid.add(np.array([[0.5], [0.5], [0.0]]))
    cells = np.full(grid.lowest.shape, empty)
    cells[0, 5, 5 : 5 + len(values)] = values
    return grid, cells


@pytest.mark.parametrize(("height", "expected"), [(0.75, True), (0.65, False)], ids=["high", "as crests"])
def test_what_strips_show_alike_is_higher_than_crests_and_belongs_together_from_two_deviations_on(height, expected):
    grid, alike = cells_in_a_row([0.45, height, 0.35, -np.inf, 0.6], -np.inf)
    deviation = np.full(alike.shape, DEVIATION_M)
    found = standing_objects(grid, np.full(alike.shape, np.inf), alike, deviation)
    assert np.flatnonzero(found[0, 5]).tolist() == ([5, 6] if expected else [])


@pytest.mark.parametrize(
    ("high", "deviation", "expected"),
    [([1.3] * 4, 0.2, 6), ([1.3] * 3, 0.2, 0), ([1.1] * 4, 0.2, 0), ([0.45] * 4, 0.05, 0)],
    ids=["high", "three cells", "as the highest crests", "low, on calm water"],
)
def test_no_wave_is_higher_than_six_deviations(high, deviation, expected):
    grid, above = cells_in_a_row([0.9, *high, 0.85, 0.7], np.inf)
    found = standing_objects(grid, above, np.full(above.shape, -np.inf), np.full(above.shape, deviation))
    assert np.count_nonzero(found) == expected


def test_a_reef_that_two_strips_show_is_an_object_and_no_swell():
    xyz, strip, dry = strips()
    times = np.where(strip == 0, 100.0, 700.0)
    found = separate([xyz], SeparationParams(), {"point_source_id": strip.astype(np.uint16), "gps_time": times}.get)
    other = found.classification == OTHER
    assert found.sea.surface == "followed"
    assert other[dry & (xyz[2] > 0.3)].mean() > 0.95
    assert other[~dry].mean() < 2e-4


def test_a_reef_higher_than_waves_is_an_object_in_one_strip():
    xyz, _, dry = strips((1,))
    xyz[2] *= np.where(dry, 1, 0.4)  # the waves are lower
    found = separate([xyz], SeparationParams())
    other = found.classification == OTHER
    assert found.sea.surface == "followed"
    assert other[dry & (xyz[2] > 0.5)].mean() > 0.95
    assert other[~dry].mean() < 2e-4


def test_the_looks_of_a_cone_are_too_close_in_time(monkeypatch):
    from seaclutter_cli.airborne import separation

    xyz, strip, _ = strips()
    seen = []
    monkeypatch.setattr(separation, "standing_elevations", lambda _points, strip, _waves: seen.append(np.unique(strip)))
    for late_s in (3.0, 600.0):
        times = xyz[0] / 70 + late_s * strip
        separate([xyz], SeparationParams(), {"gps_time": times}.get)
    assert [list(numbers) for numbers in seen] == [[0, 1]]
