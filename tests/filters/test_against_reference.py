"""Comparison of every filter, point by point, with the plain loops of `reference`."""

import math
from contextlib import closing
from functools import cache

import numpy as np
import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st

from seaclutter_cli import neighbors
from seaclutter_cli.cloud import from_array
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.filters.radius import Preset
from seaclutter_cli.reading import frames
from seaclutter_cli.selection import Selection
from seaclutter_cli.sources.formats import open_source
from tests.filters.frames import frame_of, make_frame, sea_frame, take
from tests.filters.reference import REFERENCES
from tests.filters.reference_points import distances_to_others, points_of
from tests.pairs import covering
from tests.paths import SAMPLE, shared

RING_METHODS = {"joint", "ring_intensity", "ring_intensity_outlier"}
OTHER_RINGS = [
    {"end_m": 62.0},
    {"start_m": 14.5, "end_m": 24.5, "ring_width_m": 2.5},
    {"near": "keep", "far": "drop", "exclude_boxes": [(-20, 20, 0, 30, -3, 0), (30, 60, -60, 60, -5, 5)]},
    {"start_m": 0.0, "end_m": 120.0, "ring_width_m": 120.0, "initial_thresholds": (9.5,)},
]
ADAPTIVE = {"outlier_stage": "adaptive_radius"}
OTHER_OUTLIERS = [
    ADAPTIVE,
    {**ADAPTIVE, "outlier_radius_ratio": 0.3, "outlier_min_neighbors": 3, "initial_thresholds": (9, 8, 7, 4)},
    {"max_neighbors": 5, "neighbor_fraction": 0.5, "std_ratio": 0.3},
    {"max_neighbors": 1, "initial_thresholds": (0, 0, 0, 0), "std_ratio": 2.5},
]
PARAMS = {
    "joint": [{}, *OTHER_RINGS, *OTHER_OUTLIERS, {"update_weight": 0.2}, {"update_weight": 1.0, "std_ratio": 0.0}],
    "ring_intensity_outlier": [{}, *OTHER_RINGS, *OTHER_OUTLIERS],
    "ring_intensity": [{}, *OTHER_RINGS],
    "global_intensity": [
        {},
        {"filter_rate": 0.9, "near": "keep", "far": "drop"},
        {"filter_rate": 0.55, "exclude_boxes": [(-30, 30, 0, 30, -3, 0)]},
        {"threshold": 7.5, "start_m": 20.0, "end_m": 61.5},
    ],
    "sor": [{}, {"neighbors": 4, "std_ratio": 0.5}, {"neighbors": 1, "std_ratio": 0.0}],
    "ror": [{}, {"radius_m": 2.0, "min_neighbors": 12}, {"radius_m": 0.125, "min_neighbors": 1}],
    "dror": [{}, {"angle_deg": 1.5, "min_points": 6}, {"radius_multiplier": 0.5, "min_radius_m": 1.5, "min_points": 2}],
    "adaptive_radius": [
        {},
        {"scene": "confined"},
        {"scene": "dense", "presets": {"dense": Preset(radius_ratio=0.25, min_neighbors=2)}},
        {"scene": "all", "presets": {"all": Preset(radius_ratio=1e300, min_neighbors=30)}},
    ],
    "dsor": [
        {},
        {"neighbors": 9, "std_ratio": 1.0, "range_multiplier_per_m": 0.02},
        {"neighbors": 1, "std_ratio": 0.0},
    ],
    "lior": [{}, {"intensity_threshold": 16.0, "max_range_m": 40.0, "radius_m": 1.5, "min_neighbors": 1}],
    "lidsor": [
        {},
        {"neighbors": 3, "std_ratio": 0.0, "intensity_threshold": 30.0, "max_range_m": 50.0},
        {"range_multiplier_per_m": 0.01, "intensity_threshold": 7.0, "max_range_m": 200.0},
    ],
    "naive": [{}, {"intensity_threshold": 7.0, "max_range_m": 25.0}],
    "sea_surface": [
        {"cell_m": 5.0},
        {"cell_m": 3.0, "window_m": 7.0, "height_m": 0.25, "up": "-z"},
        {"cell_m": 8.0, "window_m": 4.0, "height_m": 2.0, "up": "x"},
    ],
    "patchwork": [
        {},
        {"sensor_height_m": 5.0, "min_range_m": 0.0, "max_range_m": 40.0, "min_points": 3},
        {"ground_distance_m": 0.5, "seed_height_m": 0.4, "uprightness": 0.95},
    ],
}
OF_FEW_CELLS = {"sea_surface": {"cell_m": 4.0, "window_m": 25.0}}
CASES = [(name, params) for name in FILTERS for params in PARAMS.get(name, [{}])]


def assert_same(name, params, frames):
    """Assert that filter and reference agree on the frames of a recording."""
    made = FILTERS[name].Params(**params)
    program, reference = FILTERS[name](made), REFERENCES[name](made)
    if program.needs_first_pass:
        for frame in frames:
            program.observe(frame)
            reference.observe(frame)
    for frame in frames:
        result, expected = program.step(frame), reference.step(frame)
        differing = np.flatnonzero(result.reason != np.array(expected.reason, np.uint8))
        assert not len(differing), [
            (frame.index, int(i), points_of(frame)[i], int(result.reason[i]), expected.reason[i]) for i in differing[:5]
        ]
        assert_same_rings(result.rings, expected.rings, 1 / 8000 if name == "global_intensity" else 1e-9)


def assert_same_rings(rings, expected, tolerance):
    """Assert that range-ring results agree, except for rounding and approximate thresholds."""
    assert (rings is None) == (expected is None)
    if expected is None:
        return
    np.testing.assert_allclose(rings.thresholds, expected.thresholds, rtol=tolerance)
    np.testing.assert_allclose(rings.corrections, expected.corrections, rtol=1e-9)
    np.testing.assert_array_equal(rings.points, expected.points)
    np.testing.assert_array_equal(rings.low_intensity, expected.low_intensity)
    np.testing.assert_array_equal(rings.outliers, expected.outliers)


@pytest.mark.parametrize("name", FILTERS)
def test_every_method_has_a_reference(name):
    assert name in REFERENCES, f"add an implementation of {name!r} to reference.py"


@pytest.mark.parametrize(("name", "params"), CASES)
def test_random_sea(name, params):
    assert_same(name, params, [sea_frame(1, index=index) for index in range(3)])


@pytest.mark.parametrize(("name", "intensities"), [*covering(FILTERS, ("u1", "u2", "i2", "f8")), ("joint", "u2")])
def test_types_of_the_fields(name, intensities):
    scale = 100 if intensities == "u2" else 1
    thresholds = tuple(scale * value for value in (30, 16, 7, 4))
    params = {"initial_thresholds": thresholds} if name in RING_METHODS else OF_FEW_CELLS.get(name, {})
    frames = [sea_frame(5, index=i, coordinates="f8", intensities=intensities, scale=scale) for i in range(3)]
    assert_same(name, params, frames)


@pytest.mark.parametrize(
    "name", [name for name in FILTERS if name not in {"none", "ring_intensity", "global_intensity", "naive"}]
)
def test_slower_search_for_neighbors(name, monkeypatch):
    """Platforms without a wheel of the faster search use this one."""
    monkeypatch.setattr(neighbors, "_FastTree", None)
    assert_same(name, OF_FEW_CELLS.get(name, {}), [sea_frame(6, index=index) for index in range(3)])
    assert_same(name, OF_FEW_CELLS.get(name, {}), sample_frames(200)[:1])


@pytest.mark.parametrize("name", ["joint", "sor", "ror"])
def test_many_frames(name):
    """An error in one correction affects all following frames."""
    assert_same(name, {}, [sea_frame(9, size=120, index=index, intensities="u1") for index in range(25)])


# Coordinates in quarters of a metre give duplicates, equal distances, and ranges on the edges of the range rings.
COORDINATES = st.one_of(
    st.integers(-64, 64).map(lambda quarters: quarters / 4),
    st.sampled_from([0.0, 10.0, 25.0, 40.0, 55.0, 70.0, 71.0, math.nextafter(25.0, 0), math.nan, math.inf]),
)
INTENSITIES = st.one_of(st.integers(0, 40), st.sampled_from([4.0, 7.0, 16.0, 30.0, math.nan, -math.inf]))
POINTS = st.lists(st.tuples(COORDINATES, COORDINATES, COORDINATES, INTENSITIES), max_size=40)


@pytest.mark.parametrize("name", FILTERS)
@settings(max_examples=25, deadline=None)
@given(recording=st.lists(POINTS, min_size=1, max_size=4))
def test_any_points(name, recording):
    """All parameters of a method share the recordings, which take longer to make than to filter."""
    arrays = [np.array(points, float).reshape(-1, 4) for points in recording]
    frames = [make_frame(a[:, :3], a[:, 3], index=i) for i, a in enumerate(arrays)]
    for params in PARAMS.get(name, [{}]):
        note(f"parameters: {params}")
        assert_same(name, params, frames)


@cache
def sample_frames(step):
    """Return the frames of the sample log, reduced to every ``step``-th point."""
    if not SAMPLE.exists():
        pytest.skip("the sample log is not in this checkout")
    with closing(open_source(SAMPLE)) as source:
        return [take(frame, slice(None, None, step)) for frame in frames(source, Selection())]


@pytest.mark.parametrize("name", FILTERS)
def test_sample_log(name):
    """The frames show falling snow, thinned out, with a configuration for snow."""
    rings = {"start_m": 0.0, "end_m": 60.0, "initial_thresholds": (1, 1, 1, 1), "near": "keep"}
    assert_same(name, rings if name in RING_METHODS else OF_FEW_CELLS.get(name, {}), sample_frames(140))


@pytest.mark.parametrize("name", FILTERS)
def test_snow_in_a_sector(name):
    """The sector keeps the full density of the sensor, including duplicates."""
    frames = []
    for path in sorted((shared("wads-36") / "velodyne").glob("*.bin"))[-3:]:
        x, y, z, intensity = np.fromfile(path, "<f4").reshape(-1, 4).T
        sector = np.abs(np.arctan2(y, x) - 0.5) < 0.025
        xyz = np.column_stack([x, y, z])[sector]
        frames.append(make_frame(xyz, intensity[sector], index=len(frames), coordinates="f4", intensities="f4"))
    assert_same(
        name, {"initial_thresholds": (2, 2, 2, 2)} if name in RING_METHODS else OF_FEW_CELLS.get(name, {}), frames
    )


@pytest.mark.parametrize("name", ["dror", "dsor", "lior", "lidsor", "naive"])
def test_real_snow_is_removed_and_most_of_the_scene_is_kept(name):
    """The labels (110: falling snow) show that a rule works as intended, not how well it performs."""
    folder = shared("wads-36")
    path = min((folder / "velodyne").glob("*.bin"))
    x, y, z, intensity = np.fromfile(path, "<f4").reshape(-1, 4).T
    snow = (np.fromfile(folder / "labels" / f"{path.stem}.label", "<u4") & 0xFFFF) == 110
    frame = make_frame(np.column_stack([x, y, z]), intensity, coordinates="f4", intensities="f4")
    keep = FILTERS[name](FILTERS[name].Params()).step(frame).keep
    assert keep[snow].mean() < 0.6
    assert keep[~snow & frame.valid].mean() > 0.8


@pytest.mark.parametrize("name", FILTERS)
def test_frame_of_a_vlp16(name):
    pypcd4 = pytest.importorskip("pypcd4")
    points = pypcd4.PointCloud.from_path(next((shared("nebula") / "vlp16").glob("*.pcd"))).pc_data[::6]
    rings = {"start_m": 1.0, "end_m": 17.0, "ring_width_m": 4.0}
    assert_same(name, rings if name in RING_METHODS else OF_FEW_CELLS.get(name, {}), [frame_of(from_array(points))])


def test_both_distance_computations_of_the_reference_agree(monkeypatch):
    points = [point for point in points_of(sea_frame(1)) if not point.invalid]
    monkeypatch.setattr("tests.filters.reference_points.MANY", 1000)
    slow = list(distances_to_others(points[:300]))
    monkeypatch.setattr("tests.filters.reference_points.MANY", 0)
    np.testing.assert_allclose(list(distances_to_others(points[:300])), slow, rtol=1e-14, atol=1e-300)
