"""Land and water of tiles: level regions, their echoes, several water levels, real tiles."""

import numpy as np
import pytest

from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.surface import GROUND, OTHER, WATER, SeparationParams
from tests.airborne.coasts import COASTS, hummocks, relief, sea_only, shares, tile, waves
from tests.paths import shared


def test_crests_beside_measured_waves_are_water_that_reflects_like_ground():
    xyz, land, columns = tile(sea_only, height=1.5, length=100.0, speckle=False, seed=42)
    assert shares(xyz, land, columns)[1] < 0.002


def test_a_polder_below_the_sea_behind_a_dike():
    xyz, _, columns = tile(lambda x, _y, _b: np.where((x > 190) & (x < 205), 4.0, -5))
    rng = np.random.default_rng(3)
    polder = xyz[0] >= 205
    xyz[2, polder] = -2 + relief(rng, *xyz[:2, polder])
    columns["intensity"][polder] = rng.normal(200, 40, polder.sum())
    land, water = shares(xyz, xyz[0] > 190, columns)
    assert land > 0.98
    assert water < 0.02


@pytest.mark.parametrize("names", [("intensity", "number_of_returns"), ()])
def test_basins_on_both_sides_of_a_weir_in_waves(names):
    weir = tile(
        lambda x, _y, _b: np.where(np.abs(x - 200) < 3, 2.5, -5),
        level=lambda x, _: np.where(x < 200, 0, 1.2),
        height=1.2,
        length=40.0,
    )
    land, water = shares(*weir[:2], {name: weir[2][name] for name in names})
    assert land > 0.95
    assert water < (0.01 if names else 0.02)


def test_squares_along_the_contours_of_a_slope_are_no_basins():
    """Each row of squares is level, and higher ground is on one side of it."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, 300, (2, 420_000))
    ground = np.minimum((y - 140) / 20, 3 + np.abs(np.sin(x / 23) * np.sin(y / 19)))
    sea = 39.4 + waves(rng, x, y, 0.7, 20.0)
    land = 39.4 + ground > sea
    xyz = np.stack((x, y, np.maximum(39.4 + ground, sea) + rng.normal(0, 0.03, len(x))))
    high = land & (ground > 0.6)
    assert shares(xyz, high, {})[0] > 0.97


def test_basins_on_both_sides_of_a_weir():
    weir = tile(lambda x, _y, _b: np.where(np.abs(x - 200) < 3, 2.5, -5), level=lambda x, _: np.where(x < 200, 0, 1.2))
    land, water = shares(*weir)
    assert land > 0.99
    assert water < 0.01


@pytest.mark.parametrize("names", [("intensity", "number_of_returns"), ()])
def test_the_crest_of_a_weir_holds_back_its_upper_basin(names):
    """The crest begins with a square that lies mostly in the lower basin."""
    river = tile(
        lambda x, y, _b: np.select(
            [np.abs(y - 150) > 50, np.abs(x - 201.5) < 1.5], [6 + (y - 150) ** 2 / 1e3, 2.0], -5
        ),
        level=lambda x, _: np.where(x < 201.5, 1.5, 0.0),
        speckle=bool(names),
    )
    land, water = shares(*river[:2], {name: river[2][name] for name in names})
    assert land > 0.99
    assert water < 0.02


@pytest.mark.parametrize(("height", "length", "speckle"), [(0.1, 15.0, True), (0.5, 60.0, False), (1.2, 40.0, True)])
def test_a_tile_of_sea_has_no_land(height, length, speckle):
    xyz, _, columns = tile(sea_only, height=height, length=length, speckle=speckle)
    for attributes in (columns, {}):
        found = separate([xyz], SeparationParams(), attributes.get)
        assert (found.classification == OTHER).mean() < 0.01
        assert not (found.is_doubtful and attributes), "without intensities, low waves are like fields"


@pytest.mark.parametrize(("coast", "height", "length"), [("cliff", 1.2, 40.0), ("beach 1 in 30", 1.2, 40.0)])
def test_coasts_whose_water_reflects_like_ground(coast, height, length):
    land, water = shares(*tile(COASTS[coast], height=height, length=length, speckle=False))
    assert land > 0.95
    assert water < 0.02


def test_a_slope_without_water_is_land():
    assert shares(*tile(lambda x, _, bumps: 1 + x / 100 + bumps))[0] > 0.98


def test_a_wood_beside_a_lake_is_land_though_its_echoes_differ():
    rng = np.random.default_rng(5)
    xyz, land, columns = tile(lambda x, _, bumps: np.where(x > 200, 3 + bumps, -5))
    wood = land & (xyz[0] > 250)
    pulses = np.where(wood & (rng.random(len(land)) < 0.6), 2, 1)
    columns["intensity"] = np.where(
        pulses > 1, columns["intensity"] * rng.uniform(0, 0.6, len(land)), columns["intensity"]
    )
    on_land, on_water = shares(xyz, land, columns | {"number_of_returns": pulses})
    assert on_land > 0.99
    assert on_water < 0.02


@pytest.mark.parametrize("names", [("intensity", "number_of_returns"), ()])
def test_hills_have_no_sea(names):
    xyz, land, columns = tile(lambda x, y, bumps: 200 + 15 * np.sin(x / 40) * np.sin(y / 35) + 4 * bumps)
    assert shares(xyz, land, {name: columns[name] for name in names})[0] == 1


def test_ground_of_land_is_class_2_on_request():
    xyz, land, columns = tile(COASTS["dike and low polder"])
    house = land & (np.abs(xyz[0] - 300) < 5) & (np.abs(xyz[1] - 150) < 5)
    xyz[2, house] += 6
    found = separate([xyz], SeparationParams(land="class2"), columns.get).classification
    inland = land & (xyz[0] > 215)
    assert (found[inland & ~house] == GROUND).mean() > 0.97
    assert (found[house] == OTHER).all()
    kept = separate([xyz], SeparationParams(), columns.get).classification
    np.testing.assert_array_equal(np.where(found == GROUND, OTHER, found), kept)


@pytest.mark.parametrize(("folder", "name", "unit"), [("las", "autzen_trim", 0.3048), ("airborne", "ahn3_sluice", 1.0)])
def test_real_tiles(folder, name, unit):
    laspy = pytest.importorskip("laspy")
    read = laspy.read(shared(folder) / f"{name}.laz")
    columns = {key: np.asarray(read[key]) for key in ("intensity", "number_of_returns")}
    xyz = np.stack((read.x, read.y, read.z)) * unit
    sea = separate([xyz], SeparationParams(), columns.get).classification == WATER
    truth = np.asarray(read.classification)
    if name == "autzen_trim":  # a river with a pool that is level
        assert sea.mean() < 0.02
    else:
        assert sea[truth == 2].mean() < 0.03
        assert sea[truth == 9].mean() > 0.985


@pytest.mark.parametrize(("trusted", "intensities"), [((2,), True), ((9,), False), ((2, 9), False)])
def test_trusted_classes_tell_a_polder_below_the_sea_that_nothing_else_tells(trusted, intensities):
    def polder(x, _, bumps):
        return np.select([x < 190, x < 205], [-5.0, 4.0], -2 + bumps)

    xyz, _, columns = tile(polder, speckle=False)
    land = xyz[0] >= 190
    given = np.where(land, GROUND, WATER)
    given[::3] = OTHER  # unclassified
    columns = {"classification": given, **(columns if intensities else {})}
    found = separate([xyz], SeparationParams(trust_classes=trusted), columns.get).classification
    for code in trusted:
        assert (found[given == code] == code).all()
    assert (found[land] != WATER).mean() > 0.99
    assert (found[~land] == WATER).mean() > 0.98
    without = separate([xyz], SeparationParams(), columns.get).classification
    assert (without[land] == WATER).mean() > 0.5


def test_trusted_points_keep_their_class_on_rough_water_too():
    xyz, land, columns = tile(COASTS["cliff"], height=1.1, length=30.0)
    columns["classification"] = np.where(land, OTHER, WATER)
    columns["classification"][:1000] = GROUND
    found = separate([xyz], SeparationParams(trust_classes=(2,)), columns.get).classification
    np.testing.assert_array_equal(found == GROUND, columns["classification"] == GROUND)


@pytest.mark.parametrize("kind", ["sluice", "autzen"])
def test_real_tiles_with_trusted_ground(kind):
    laspy = pytest.importorskip("laspy")
    path = {"sluice": shared("airborne") / "ahn3_sluice.laz", "autzen": shared("las") / "autzen_trim.laz"}[kind]
    unit = 0.3048 if kind == "autzen" else 1.0
    points = laspy.read(path)
    xyz = unit * np.stack([np.asarray(points[axis]) for axis in "xyz"])
    given = np.asarray(points.classification)
    found = separate([xyz], SeparationParams(trust_classes=(2,)), {"classification": given}.get).classification
    if kind == "sluice":
        assert (found[given == WATER] == WATER).mean() > 0.98
    assert (found[given != WATER] == WATER).mean() < 0.02


def woods(ground, water=None, *, size=(120.0, 120.0), seed=2):
    """Return a tile below trees, whose pulses have several echoes, except where ``water`` is; all reflect alike."""
    rng = np.random.default_rng(seed)
    count = int(4 * size[0] * size[1])
    x, y = (rng.uniform(0, side, count) for side in size)
    wet = np.zeros(count, bool) if water is None else water(x, y)
    z = np.where(wet, 0, ground(x, y)) + rng.normal(0, 0.02, count)
    leaves = ~wet & (rng.uniform(size=count) < 0.6)
    passed = rng.uniform(size=leaves.sum()) < 0.4
    again = np.flatnonzero(leaves)[passed]
    top = z + np.where(leaves, rng.uniform(2, 12, count), 0)
    number = np.ones(count + len(again), int)
    number[again], number[count:] = 2, 2
    xyz = np.stack((np.append(x, x[again]), np.append(y, y[again]), np.append(top, z[again])))
    columns = {"intensity": rng.normal(200, 40, len(number)), "number_of_returns": number}
    return xyz, np.append(~wet, ~wet[again]), columns


def test_woods_without_water_are_land():
    assert shares(*woods(hummocks))[0] == 1


def test_a_lake_in_the_woods_is_water():
    lake = woods(hummocks, lambda x, y: np.hypot(x - 90, y - 90) < 60, size=(180.0, 180.0))
    land, water = shares(*lake)
    assert land > 0.9
    assert water < 0.05


def test_scattered_squares_of_hills_are_land():
    rng = np.random.default_rng(4)
    x, y = (rng.uniform(0, 1000, 60_000) for _ in "xy")
    columns = {"intensity": rng.normal(200, 40, len(x)), "number_of_returns": np.ones(len(x), int)}
    hills = np.stack((x, y, 20 * np.sin(x / 150) + 20 * np.cos(y / 170) + rng.uniform(0, 8, len(x))))
    assert shares(hills, np.ones(len(x), bool), columns)[0] == 1


@pytest.mark.parametrize("speckle", [True, False])
def test_a_window_smaller_than_the_swell_is_no_land(speckle):
    for seed in range(2):
        xyz, _, columns = tile(sea_only, height=1.5, length=100.0, level=45.0, speckle=speckle, seed=seed)
        inside = (xyz[:2] < 50).all(axis=0)
        found = separate([xyz[:, inside]], SeparationParams(), {k: v[inside] for k, v in columns.items()}.get)
        assert (found.classification == OTHER).mean() < 0.02


@pytest.mark.parametrize("names", [("intensity", "number_of_returns"), ()])
def test_level_land_without_water_is_doubtful(names):
    """Its fields differ by some centimetres."""
    field = np.random.default_rng(4).normal(3, 0.03, 60)
    xyz, land, columns = tile(lambda x, y, bumps: field[(x // 50 + 8 * (y // 60)).astype(int)] + bumps / 5)
    assert land.all()
    columns = {name: columns[name] for name in names}
    assert separate([xyz], SeparationParams(), columns.get).is_doubtful


def test_waves_are_recognised_in_looks_of_a_tenth_of_the_cells():
    rng = np.random.default_rng(9)
    strip = np.repeat(np.arange(8), 6000)
    x, y = rng.uniform(0, 300, len(strip)), rng.uniform(0, 200, len(strip))
    sea = [waves(np.random.default_rng(number), x, y, 1.4, 40.0) for number in range(8)]
    xyz, columns = np.stack((x, y, np.choose(strip, sea))), {"point_source_id": strip}
    land = np.zeros(len(strip), np.bool_)
    assert shares(xyz, land, columns)[1] < 1e-3
    land = (x - 150) ** 2 + (y - 100) ** 2 < 15**2
    xyz[2, land] = 5.0
    assert shares(xyz, land, columns)[0] > 0.99


def test_a_small_field_is_doubtful():
    rng = np.random.default_rng(6)
    x, y = (rng.uniform(0, 50, 20_000) for _ in "xy")
    field = np.stack((x, y, 0.02 * x + rng.normal(0, 0.03, len(x))))
    columns = {"intensity": rng.normal(200, 40, len(x)), "number_of_returns": np.ones(len(x), int)}
    assert separate([field], SeparationParams(), columns.get).is_doubtful


@pytest.mark.parametrize("seed", [0, 4, 5])
def test_fields_that_undulate_like_a_long_swell_are_land_or_doubtful(seed):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 300, (2, 300_000))
    field = np.full(len(x), 58.0)
    for _ in range(10):
        turn = rng.uniform(0, 7)
        phase = 2 * np.pi / rng.uniform(120, 180) * (np.cos(turn) * x + np.sin(turn) * y)
        field += 0.35 * np.sin(phase + rng.uniform(0, 7))
    found = separate([np.stack((x + 40, y + 20, field))], SeparationParams())
    assert found.is_doubtful or (found.classification == OTHER).all()


def test_undulating_fields_beside_a_canal_are_doubtful():
    """They are no longer than waves, but water would run off into the canal, which is narrower than a square."""
    x, y = np.random.default_rng(5).uniform(0, 300, (2, 300_000))
    field = 0.35 * np.sin(2 * np.pi * x / 80) * np.sin(2 * np.pi * y / 90)
    xyz = np.stack((x, y, np.where(np.abs(x - 150) < 3, -1.5, field)))
    assert separate([xyz], SeparationParams()).is_doubtful


def test_a_swell_that_fields_do_not_resemble_is_not_doubtful():
    x, y = np.random.default_rng(6).uniform(0, 300, (2, 300_000))
    swell = np.stack((x, y, 0.5 * np.sin(2 * np.pi * (x + y / 3) / 40)))
    assert not separate([swell], SeparationParams()).is_doubtful
