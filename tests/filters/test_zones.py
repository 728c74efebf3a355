"""Own structure by polygons and masks, in filters and configurations, against slow references."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import seaclutter
from seaclutter_cli.config import load_config
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters.zones import ExcludedPolygon, Exclusion
from seaclutter_cli.frame import Frame, Reason
from seaclutter_cli.structure.mask import Sector, StructureMask

NUMBERS = st.integers(-20, 20).map(lambda k: k / 2)
OUTLINES = st.lists(st.tuples(NUMBERS, NUMBERS), min_size=3, max_size=7)


def winding(point, outline):
    """Return whether the outline winds an odd number of times round a point, by angles; None on the outline."""
    total = 0.0
    for (x1, y1), (x2, y2) in zip(outline, [*outline[1:], outline[0]], strict=True):
        first, second = (x1 - point[0], y1 - point[1]), (x2 - point[0], y2 - point[1])
        cross, dot = first[0] * second[1] - first[1] * second[0], first[0] * second[0] + first[1] * second[1]
        if abs(cross) < 1e-9 and dot <= 1e-9:
            return None
        total += math.atan2(cross, dot)
    return round(total / (2 * math.pi)) % 2 == 1


@settings(max_examples=300, deadline=None)
@given(OUTLINES, st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=20))
def test_polygons_against_angles(outline, points):
    assume(len(set(outline)) > 2)
    limits = {"z_min_m": -2.0, "z_max_m": 3.0}
    exclusion = Exclusion(polygons=[ExcludedPolygon(vertices=tuple(outline), **limits)])
    for point, inside in zip(points, exclusion.contains(Frame.of_arrays(np.array(points))), strict=True):
        expected = winding(point[:2], outline)
        if expected is not None:
            assert bool(inside) == (expected and -2 <= point[2] <= 3)


def test_a_polygon_without_limits_of_the_height():
    outline = ((0, 0), (4, 0), (4, 4), (0, 4))
    xyz = np.array([[1, 1, -1e6], [1, 1, 1e6], [5, 1, 0], [np.nan, 1, 0], [1, np.inf, 0]])
    exclusion = Exclusion(polygons=[ExcludedPolygon(vertices=outline)])
    assert exclusion.contains(Frame.of_arrays(xyz)).tolist() == [True, True, False, False, False]


POINTS = np.array([[20.0, 0, 0], [20, 3, 0], [0, 30, 0], [5, 0, 0], [80, 0, 0]])
POLYGON = {"vertices": [[15, -1], [25, -1], [25, 1], [15, 1]]}


@pytest.mark.parametrize("method", ["joint", "global_intensity", "confirmed"])
def test_filters_remove_them_first(tmp_path, method):
    path = tmp_path / "mask.csv"
    path.write_text(StructureMask((Sector(-1, 1, 80, 100, 25, 35), Sector(-1, 1, -1, 1, 1, 8))).as_csv())
    config = {"filter": {"exclude_polygons": [POLYGON], "mask": str(path)}}
    result = seaclutter.filter_points(POINTS, np.full(5, 99), method=method, config=config)
    excluded = [True, False, True, True, False]
    assert (result.reason == Reason.EXCLUDED).tolist() == excluded


def test_configurations_show_and_read_back_polygons():
    text = f"filter.exclude_polygons=[{{vertices: {POLYGON['vertices']}, z_min_m: -1}}]"
    config = load_config(overrides=[text])
    assert config.filter.exclude_polygons[0].vertices[1] == (25, -1)
    assert config.as_dict()["filter"]["exclude_polygons"] == [{**POLYGON, "z_min_m": -1, "z_max_m": None}]
    for comments in (False, True):
        import yaml

        again = load_config(yaml.safe_load(config.to_yaml(comments=comments)))
        assert again == config


@pytest.mark.parametrize(
    ("polygons", "problem"),
    [
        ("[{vertices: [[0, 0], [1, 1]]}]", "filter.exclude_polygons.0.vertices: must be a list of at least 3 values"),
        ("[{vertices: [[0, 0], [1, 1], [2, x]]}]", "filter.exclude_polygons.0.vertices.2.1: must be a number"),
        ("[{z_min_m: 1}]", "filter.exclude_polygons.0.vertices: is missing"),
        ("[{vertices: [[0, 0], [1, 1], [2, 0]], z_max: 1}]", "z_max: unknown key; did you mean "),
        ("[{vertices: [[0, 0], [1, 1], [2, 0]], z_min_m: 2, z_max_m: 1}]", "z_min_m (2) must not be greater"),
        ("[[0, 0]]", "filter.exclude_polygons.0: must be a section with keys, got a list"),
        ("3", "filter.exclude_polygons: must be a list, got 3"),
    ],
)
def test_polygons_that_are_not_valid(polygons, problem):
    with pytest.raises(ConfigError) as caught:
        load_config(overrides=[f"filter.exclude_polygons={polygons}"])
    assert problem in str(caught.value)


def test_a_mask_that_cannot_be_read_is_an_error_of_the_configuration(tmp_path):
    with pytest.raises(ConfigError, match=r"filter\.mask: .*cannot be read"):
        seaclutter.filter_points(POINTS, np.full(5, 99), config={"filter": {"mask": str(tmp_path / "none.csv")}})


def test_polygons_have_a_bounded_number_of_vertices():
    many = {"vertices": [[np.cos(k), np.sin(k)] for k in np.arange(1001.0)]}
    with pytest.raises(ConfigError, match="exclude_polygons has 1,001 vertices; at most 1,000 are possible"):
        load_config({"filter": {"exclude_polygons": [many]}})
