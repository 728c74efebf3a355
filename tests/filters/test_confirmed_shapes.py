"""What the shapes of objects say: spray, low and flat bodies, mirrored echoes and turns, in whole logs."""

import numpy as np
import pytest

from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import Reason
from tests.filters.seas import MAST_M, Body, frame_at, sea_log, water

TIMES = np.arange(20) / 10


def run(log, **params):
    method = FILTERS["confirmed"](FILTERS["confirmed"].Params(**params))
    return [result for frame in log for result in method.process(frame)] + method.flush()


def log_with(extra, *, amplitude_m=0.03):
    """Return the frames of calm water with the points of ``extra``, a function of generator and time, behind it."""
    frames = []
    for index, time_s in enumerate(TIMES):
        rng = np.random.default_rng([7, index])
        rows = np.concatenate((water(rng, time_s, 400, amplitude_m), extra(rng, time_s)))
        frames.append(frame_at(time_s, rows, index=index))
    return frames


def kept(results, first=400):
    """Return the share of the points behind the water that is kept, in all frames."""
    return np.mean([result.keep[first:].mean() for result in results])


def in_box(rng, size, middle, extent):
    xyz = np.array(middle) + rng.uniform(-0.5, 0.5, (size, 3)) * extent
    return np.column_stack((xyz, rng.uniform(5, 90, size)))


@pytest.mark.parametrize("size", [40, 110])
def test_spray_3_m_above_the_water_is_removed(size):
    results = run(log_with(lambda rng, _: in_box(rng, size, (18, 4, 3 - MAST_M), (4, 4, 2))))
    assert kept(results) < 0.02


def row(rng, first_deg, end_deg, height_m, intensity):
    """Return the echoes of one beam at 16 m."""
    bearing = np.radians(np.arange(first_deg, end_deg, 0.25))
    distance, z = 16 + rng.normal(0, 0.02, len(bearing)), np.full(len(bearing), height_m - MAST_M)
    return np.column_stack((distance * np.cos(bearing), distance * np.sin(bearing), z, np.full(len(z), intensity)))


@pytest.mark.parametrize("everywhere", [False, True])
def test_a_dark_row_beside_a_cabin_is_its_hull_unless_the_water_has_rows_as_long(everywhere):
    """A beam meets the hull at the height of the water, whose echoes are single at the same range."""

    def boat(rng, time_s):
        cabin = [row(rng, 0, 3, height_m, 20.0) for height_m in np.arange(0, 0.9, 0.15)]
        rows = [row(rng, start, start + 15, 0.0, 3.0) for start in range(43, 320, 20)] if everywhere else []
        return np.concatenate((water(rng, time_s, 3000, 0.03), *rows, *cabin, row(rng, 3, 18, 0.0, 3.0)))

    share = np.mean([result.keep[-60:].mean() for result in run(log_with(boat))])
    assert (share < 0.1) if everywhere else (share > 0.4)


def wall(rng, _):
    bearing, elevation = (axis.ravel() for axis in np.meshgrid(np.arange(0, 12, 0.4), np.arange(-5, 3, 0.5)))
    x = np.full(len(bearing), 18.0)
    y, z = x * np.tan(np.radians(bearing)), x * np.tan(np.radians(elevation))
    return np.column_stack((x, y, z, rng.uniform(5, 90, len(x))))


def test_a_wall_of_the_same_size_is_kept():
    assert kept(run(log_with(wall))) > 0.95


def test_glint_before_a_wall_does_not_belong_to_it():
    """Echoes of bright water join each other up to the wall, but those 1.5 m before it are not its own."""
    wall_m = 19.4

    def glint(rng, time_s):
        patch = in_box(rng, 300, (wall_m - 2, 2, -MAST_M), (4, 3, 0.02))
        patch[:, 3] = rng.uniform(90, 200, len(patch))
        return np.concatenate((wall(rng, time_s) + np.array([wall_m - 18, 0, 0, 0]), patch))

    results = run(log_with(glint))
    assert np.mean([result.keep[400:-300].mean() for result in results]) > 0.95
    before = [result.keep[-300:][result.frame.coordinates[0, -300:] < wall_m - 1.6] for result in results]
    assert np.concatenate(before).mean() < 0.02


def test_a_flat_deck_that_one_beam_meets_above_calm_water_is_kept():
    """It is 1.3 m above the water, where no wave is."""

    def deck(rng, _):
        bearing = np.radians(np.arange(-8, 8, 0.4))
        distance = 15 + rng.normal(0, 0.02, len(bearing))
        z = np.full(len(bearing), 1.3 - MAST_M)
        return np.column_stack((distance * np.cos(bearing), distance * np.sin(bearing), z, np.full(len(bearing), 60.0)))

    assert kept(run(log_with(deck))) > 0.95


def test_flat_echoes_near_the_water_are_not_kept():
    assert kept(run(log_with(lambda rng, _: in_box(rng, 60, (15, 0, 0.05 - MAST_M), (3, 3, 0.05))))) < 0.02


@pytest.mark.parametrize(("brightness", "contrast", "top_m"), [(40, (2.5, 5), 0.4), (3, (6, 9), 0.19)])
def test_a_swimmer_is_brighter_than_the_water(brightness, contrast, top_m):
    """Water that reaches its thresholds would join into one object with the swimmer; in dark water, neither does."""

    def lit(rng, time_s):
        sea = water(rng, time_s, 4000, 0.03)
        sea[:, 3] = brightness * rng.uniform(0.85, 1.5, len(sea))
        swimmer = in_box(rng, 20, (12, 0, top_m / 2 - MAST_M), (0.5, 0.5, top_m))
        swimmer[:, 3] = brightness * rng.uniform(*contrast, len(swimmer))
        return np.concatenate((sea, swimmer))

    results = run(log_with(lit))
    assert kept(results, 4400) > 0.9
    assert np.mean([result.keep[:4400].mean() for result in results]) < 0.01


@pytest.mark.parametrize("distance_m", [20.0, 90.0])
def test_mirrored_echoes_are_no_candidates(distance_m):
    """A quay, and its image below the water, which has no echoes at 90 m."""

    def quay(rng, _):
        across, down = np.arange(-20, 20, 0.5) * 20 / distance_m, np.arange(-16, 4, 0.5) * 20 / distance_m
        bearing, elevation = (axis.ravel() for axis in np.meshgrid(across, down))
        x = np.full(len(bearing), distance_m)
        y, z = x * np.tan(np.radians(bearing)), x * np.tan(np.radians(elevation))
        return np.column_stack((x, y, z, rng.uniform(20, 60, len(x))))

    for result in run(log_with(quay)):
        z = result.frame.coordinates[2, 400:]
        assert result.water.level_m == pytest.approx(-MAST_M, abs=0.15)
        assert not result.keep[400:][z < -MAST_M - 0.6].any()
        assert result.keep[400:][z > -MAST_M + 0.5].mean() > 0.95
        assert (result.reason[400:][z < -MAST_M - 0.6] == Reason.MIRRORED).all()


def test_echoes_below_open_water_are_not_called_mirrored():
    for result in run(log_with(lambda rng, _: in_box(rng, 20, (20, 0, -1.5 - MAST_M), (6, 6, 1)))):
        assert not result.counts[[Reason.MIRRORED, Reason.KEPT]].any()


@pytest.mark.parametrize("rate_deg_s", [20.0, -20.0])
def test_bodies_are_kept_while_own_ship_turns(rate_deg_s):
    bodies = [Body(20, 5, points=30), Body(-18, 14, points=30), Body(5, -28, points=30), Body(-25, -20, points=30)]
    log = []
    for frame in sea_log(1, bodies, TIMES, amplitude_m=0.05, drops=0):
        time_s = frame.stamp_ns / 1e9
        angle = -np.radians(rate_deg_s * time_s)
        x, y, z = frame.coordinates
        turned = x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z
        rows = np.column_stack((*turned, frame.cloud.points["intensity"]))
        log.append((frame_at(time_s, rows, index=frame.index), frame))
    for result, (_, straight) in zip(run([one for one, _ in log]), log, strict=True):
        tall = straight.valid & (straight.coordinates[2] > 0.5 - MAST_M) & (straight.range_m > 12)
        assert result.keep[tall].mean() > 0.9
        x, y, _ = straight.coordinates
        beside = np.any([np.hypot(x - body.x, y - body.y) < 3 for body in bodies], axis=0)
        assert not (result.reason[beside] == Reason.UNCONFIRMED).any()
