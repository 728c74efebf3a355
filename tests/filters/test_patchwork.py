"""Patchwork++ as a filter: what it takes for ground, and what it writes."""

import subprocess
import sys

import numpy as np
import pytest

from seaclutter_cli.config import load_config
from seaclutter_cli.errors import MissingExtraError
from seaclutter_cli.filters.patchwork import Patchwork, PatchworkParams
from tests.filters.frames import around, make_frame


@pytest.fixture(autouse=True)
def library():
    return pytest.importorskip("pypatchworkpp")


def flat_with_box(height_m, *, index=0):
    """Return a frame of flat ground and a box on it, and whether each point is of the box, more than 0.3 m up."""
    rng = np.random.default_rng(index)
    ground = around(rng, 20_000, (3, 60), (-height_m - 0.02, -height_m + 0.02))
    box = rng.uniform([14, 2, 0.3 - height_m], [16, 4, 2 - height_m], (400, 3))
    return make_frame(np.vstack([ground, box]), 10, index=index), np.repeat([False, True], [len(ground), len(box)])


@pytest.mark.parametrize("height_m", [1.2, 2.5, 8.0])
def test_flat_ground_is_removed_and_a_box_on_it_kept(height_m):
    """The height of the lidar is found by the method itself."""
    method = Patchwork(PatchworkParams())
    for index in range(4):
        frame, is_box = flat_with_box(height_m, index=index)
        keep = method.step(frame).keep
        assert keep[is_box].mean() > 0.95
        assert keep[~is_box].mean() < 0.02


def test_points_outside_its_ranges_are_kept():
    frame, _ = flat_with_box(2.0)
    keep = Patchwork(PatchworkParams(min_range_m=20.0, max_range_m=40.0)).step(frame).keep
    range_m = np.hypot(*frame.coordinates[:2])
    assert keep[(range_m < 20) | (range_m > 40)].all()
    assert not keep[(range_m > 21) & (range_m < 39)].all()


def test_ranges_must_be_in_order():
    with pytest.raises(ValueError, match=r"max_range_m \(5\) must be greater than min_range_m"):
        PatchworkParams(min_range_m=5.0, max_range_m=5.0)


def test_coordinates_beyond_single_precision():
    frame, _ = flat_with_box(2.0)
    points = frame.coordinates.T.copy()
    points[::100] = [1e60, -1e200, 3]
    points[1::100, 2] = 1e39
    result = Patchwork(PatchworkParams()).step(make_frame(points, 10))
    assert result.keep[::100].all()
    assert result.keep[1::100].all()
    assert result.counts.sum() == frame.size


def test_standard_output_is_that_of_the_command():
    code = "import seaclutter, numpy as n; seaclutter.filter_points(n.ones((9, 3)), method='patchwork'); print('end')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "end\n"


def test_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pypatchworkpp", None)
    with pytest.raises(MissingExtraError, match=r"patchwork requires .*seaclutter\[peers\]"):
        load_config(method="patchwork").make_filter()
