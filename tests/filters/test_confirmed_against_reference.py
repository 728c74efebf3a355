"""Comparison of ``confirmed`` over whole logs, point by point, with the plain loops of `reference_confirmed`."""

from contextlib import closing
from dataclasses import astuple, replace

import numpy as np
import pytest

from seaclutter_cli.cloud import from_array
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import Reason
from seaclutter_cli.reading import frames
from seaclutter_cli.selection import Selection
from seaclutter_cli.sources.formats import open_source
from tests.filters.reference_confirmed import ConfirmedObjects
from tests.filters.seas import Body, random_bodies, sea_log
from tests.paths import ROOT

Params = FILTERS["confirmed"].Params
AMPLITUDES_M = (0.0, 0.05, 0.1, 0.2, 0.5)
OTHER_PARAMS = [
    {"causal": True},
    {"use_intensity": False},
    {"near": "keep", "start_m": 8.0, "initial_thresholds": (20, 16, 7, 4, 2)},
    {"start_m": 22.0, "end_m": 67.0, "initial_thresholds": (16, 7, 4)},
    {"start_m": 1.0, "end_m": 61.0},
    {"far": "drop", "end_m": 40.0, "initial_thresholds": (30, 16)},
    {"exclude_boxes": [(-20, 20, 0, 30, -3, 0), (30, 60, -60, 60, -5, 5)]},
    {"look_ahead_s": 1.2, "memory_s": 1.0, "score_threshold": 2.4},
    {"look_ahead_s": 0.0},
    {"cluster_tolerance_m": 0.6, "min_cluster_points": 1, "growth_m": 0.0, "growth_height_m": 0.4},
    {"min_rise_m": 0.05, "rise_sigmas": 1.0},
]


class Watched(FILTERS["confirmed"]):
    """The method, with a list of the objects of each frame."""

    def reset(self):
        super().reset()
        self.objects = []

    def _examine(self, frame, time_s):
        one = super()._examine(frame, time_s)
        pairs = zip(one.objects, one.tracks, strict=True)
        self.objects.append([(*found.points.tolist(), found.evidence, track.memory) for found, track in pairs])
        return one


def processed(method, log):
    """Return the results of a log, after asserting that each frame has one, in order."""
    results = [result for frame in log for result in method.process(frame)]
    results += method.flush()
    assert [result.frame.index for result in results] == [frame.index for frame in log]
    return results


def assert_same(params, log):
    """Assert that program and reference agree on all points of a log, and return the results.

    Objects and their evidence are compared, too, since most differences there are too small to change a reason.
    """
    method, reference = Watched(params), ConfirmedObjects(params)
    results = processed(method, log)
    for result, expected in zip(results, reference.log(log), strict=True):
        differing = np.flatnonzero(result.reason != np.array(expected.reason, np.uint8))
        assert not len(differing), [
            (result.frame.index, int(i), int(result.reason[i]), expected.reason[i]) for i in differing[:5]
        ]
        assert (result.rings is None) == (expected.rings is None)
        if expected.rings is not None:
            for name, values in vars(expected.rings).items():
                np.testing.assert_array_equal(getattr(result.rings, name), values)
    for found, scan in zip(method.objects, reference.scans, strict=True):
        expected = zip(scan.things, scan.memories, strict=True)
        assert len(found) == len(scan.things)
        for own, (thing, memory) in zip(found, expected, strict=True):
            assert own == pytest.approx((*(echo.number for echo in thing.echoes), thing.evidence, memory), abs=1e-9)
    for result, scan in zip(results, reference.scans, strict=True):
        assert (result.water is None) == (scan.water is None)
        if scan.water is not None:
            plane = scan.water.plane
            roll, pitch = np.degrees(np.arctan([-plane.c, plane.b]))
            expected = plane.a, roll, pitch, 4 * scan.water.sigma, scan.water.level_sigma
            np.testing.assert_allclose(astuple(result.water), expected, atol=1e-9)
    return results


def irregular(seed, count=22):
    """Return times of frames about 0.1 s apart, with a short pause, and a jump: none, ahead, or back."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.05, 0.15, count)
    steps[rng.integers(5, count)] = 0.45
    steps[rng.integers(12, count)] = [0.1, 7.0, -0.8, 0.0][seed % 4]
    return np.cumsum(steps)


def sea(seed, **kwargs):
    return sea_log(seed, random_bodies(seed), irregular(seed), **kwargs)


@pytest.mark.parametrize("seed", range(5))
def test_random_seas(seed):
    log = sea(seed, size=120 + 20 * (seed % 4), amplitude_m=AMPLITUDES_M[seed % 5], mirrors=30 * (seed % 3))
    results = assert_same(Params(score_threshold=1.0), log)
    counts = sum(result.counts for result in results)
    assert min(counts[[Reason.KEPT, Reason.OUTLIER, Reason.UNCONFIRMED]]) > 50, "every outcome occurs"


def test_a_long_log():
    """Memories reach their limits."""
    bodies = [Body(20, 5), Body(-15, 20, height=0.12, length=1, width=1, points=12, intensity=90)]
    assert_same(Params(), sea_log(5, bodies, 0.1 * np.arange(65), size=60, amplitude_m=0.03))


def test_a_narrow_view_shows_no_water():
    log = sea(6, size=900)
    sectors = [np.abs(np.arctan2(frame.coordinates[1], frame.coordinates[0]) - 0.17) < 0.16 for frame in log]
    log = [replace(frame, cloud=from_array(frame.cloud.points[own])) for frame, own in zip(log, sectors, strict=True)]
    results = assert_same(Params(), log)
    assert {result.water for result in results} == {None}


@pytest.mark.parametrize("number", range(len(OTHER_PARAMS)), ids=lambda number: "-".join(OTHER_PARAMS[number]))
def test_other_params(number):
    assert_same(Params(**OTHER_PARAMS[number]), sea(20 + number, size=120))


@pytest.mark.parametrize("gap_s", [2.0, 4.0])
def test_gap_shorter_than_a_jump(gap_s):
    """The frame behind the gap is collected before the frames that wait are decided, and must take no evidence away."""
    times = 0.1 * np.arange(20)
    times[10:] += gap_s
    assert_same(Params(), sea_log(1, random_bodies(1), times))


def test_order_of_the_points_does_not_matter():
    """The frames of the contract of all filters are too few for tracks to show the difference."""
    log = sea(0, size=150, amplitude_m=0)
    rng = np.random.default_rng(0)
    orders = [rng.permutation(frame.size) for frame in log]
    shuffled = [replace(frame, cloud=from_array(frame.cloud.points[o])) for frame, o in zip(log, orders, strict=True)]
    for one, other, order in zip(
        processed(Watched(Params()), log), processed(Watched(Params()), shuffled), orders, strict=True
    ):
        np.testing.assert_array_equal(other.reason, one.reason[order])


def test_sample_log():
    with closing(open_source(ROOT / "samples" / "sea.mcap")) as source:
        log = [frame for frame in frames(source, Selection()) if 8 <= frame.index < 20]
    thinned = [replace(frame, cloud=from_array(frame.cloud.points[::4]), stamp_ns=frame.stamp_ns) for frame in log]
    results = assert_same(Params(), thinned)
    assert all(400 <= result.frame.size <= 800 for result in results)
    assert min(sum(result.counts for result in results)[[Reason.KEPT, Reason.UNCONFIRMED]]) > 5
