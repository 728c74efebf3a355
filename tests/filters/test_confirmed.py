"""Confirmed objects at their boundaries: ends of logs, gaps, crossings, walls, rain, and other rates of frames."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import FieldError
from seaclutter_cli.filters import FILTERS, confirmed
from seaclutter_cli.frame import Frame, Reason
from tests.filters.frames import make_frame
from tests.filters.seas import MAST_M, Body, frame_at, random_bodies, sea_log, share_kept

BOAT = Body(20, 5)


def make(**params):
    return FILTERS["confirmed"](FILTERS["confirmed"].Params(**params))


def run(log, **params):
    """Return the results of a log, after asserting that each frame has one, in order."""
    method = make(**params)
    results = [result for frame in log for result in method.process(frame)]
    results += method.flush()
    assert [result.frame for result in results] == list(log)
    return results


def times(count, rate_hz=10.0, start_s=0.0):
    return start_s + np.arange(count) / rate_hz


def shares(results, body):
    """Return the share of a body's points that is kept in each frame in which it is seen."""
    found = [share_kept(result, body) for result in results]
    return [share for share in found if not math.isnan(share)]


def reasons(results):
    return [result.reason.tolist() for result in results]


def thinned(frame, rows):
    """Return a frame with some of its points, or all in another order."""
    return replace(frame, cloud=from_array(frame.cloud.points[rows]))


class TestEnds:
    def test_a_boat_is_kept_from_the_first_to_the_last_frame(self):
        results = run(sea_log(1, [BOAT], times(15)))
        assert shares(results, BOAT) == [1.0] * 15

    def test_a_single_frame(self):
        (result,) = run(sea_log(1, [BOAT], times(1)))
        assert shares([result], BOAT) == [1.0]

    @pytest.mark.parametrize("causal", [False, True])
    def test_water_is_removed_in_every_frame(self, causal):
        for result in run(sea_log(2, [], times(25), drops=0), causal=causal):
            assert not result.keep.any()

    @pytest.mark.parametrize("causal", [False, True])
    def test_a_boat_that_appears_and_leaves(self, causal):
        boat = replace(BOAT, seen=(1.0, 2.5))
        results = run(sea_log(1, [boat], times(35), drops=0), causal=causal)
        assert len(shares(results, boat)) == 15
        assert np.mean(shares(results, boat)) > 0.9
        assert not any(result.keep.any() for result in (*results[:10], *results[25:]))

    def test_a_boat_that_closes_in_at_18_m_s(self):
        boat = Body(50, 5, vx=-18.0, points=30)
        assert min(shares(run(sea_log(1, [boat], times(12), drops=0)), boat)) > 0.9

    def test_what_is_seen_once_is_removed(self):
        splash = replace(BOAT, seen=(1.0, 1.05))
        assert shares(run(sea_log(1, [splash], times(25))), splash) == [0.0]


@pytest.mark.parametrize("back", [True, False])
def test_a_row_where_a_confirmed_object_is_expected_is_kept_if_it_is_seen_again(back):
    log = sea_log(1, [replace(BOAT, seen=(-math.inf, 1.95, 2.05 if back else math.inf))], times(35))
    around = math.atan2(BOAT.y, BOAT.x) + np.radians(np.arange(30, 331, 10))  # the water has such rows everywhere
    for index in range(21):
        bearing = np.append(around, math.atan2(BOAT.y, BOAT.x))[slice(None) if index == 20 else slice(-1)]
        bearing = np.ravel(bearing[:, None] + np.radians(np.arange(-4, 4) * 0.5))
        z, intensity = np.full((2, len(bearing)), [[-2.4], [1]])
        row = np.stack([19.6 * np.cos(bearing), 19.6 * np.sin(bearing), z, intensity], axis=1)
        rows = np.stack([log[index].cloud.points[name] for name in ("x", "y", "z", "intensity")], axis=1)
        log[index] = frame_at(index / 10, np.concatenate((rows, row)), index=index)
    assert (run(log, start_m=10.0)[20].keep[-8:] == back).all()


class TestInterruptions:
    def test_an_empty_frame_in_between(self):
        log = sea_log(1, [BOAT], times(15))
        log[7] = frame_at(0.7, np.empty((0, 4)), index=7)
        results = run(log)
        assert len(results[7].reason) == 0
        before, held = results[6].water, results[7].water
        assert replace(held, level_deviation_m=before.level_deviation_m) == before, "the water holds"
        assert held.level_deviation_m > before.level_deviation_m
        assert shares(results, BOAT) == [1.0] * 14

    @pytest.mark.parametrize("returns_s", [3, 4.5])
    @pytest.mark.parametrize("causal", [True, False])
    def test_a_boat_that_returns_is_kept_at_once(self, causal, returns_s):
        boat = replace(BOAT, seen=(0, 2, returns_s))
        kept = shares(run(sea_log(1, [boat], times(55), drops=0), causal=causal), boat)
        assert kept == [1.0] * (20 + 55 - round(10 * returns_s))

    @pytest.mark.parametrize(("lasts_s", "kept"), [(0.45, 0.0), (0.8, 1.0)])
    def test_spray_for_less_than_the_look_ahead(self, lasts_s, kept):
        spray = replace(BOAT, seen=(1.0, 1.0 + lasts_s))
        assert set(shares(run(sea_log(1, [spray], times(30), drops=0)), spray)) == {kept}

    def test_a_splash_in_the_last_frame(self):
        splash = replace(BOAT, seen=(1.95, 3.0))
        assert shares(run(sea_log(1, [splash], times(21), drops=0)), splash) == [0.0]

    @pytest.mark.parametrize("back_s", [0.05, 1.0, 1000.0])
    def test_a_clock_that_jumps_back(self, back_s):
        before, after = times(12, start_s=2000.0), times(12, start_s=2001.15 - back_s)
        log = sea_log(1, [BOAT], [*before, *after])
        results = run(log)
        assert len(shares(results, BOAT)) == 24
        assert np.mean(shares(results, BOAT)) > 0.95
        assert all(result.water is not None for result in results)
        before, whole = run(log[:12], start_m=10.0), run(log, start_m=10.0)  # which search no own ship ahead
        assert reasons(whole[:12]) == reasons(before), "frames before the jump see none behind it"

    def test_a_jump_ahead_starts_anew(self):
        log = sea_log(1, [replace(BOAT, seen=(0, 1))], [*times(10), *times(10, start_s=6.5)])
        results = run(log, start_m=10.0)
        assert reasons(results[:10]) == reasons(run(log[:10], start_m=10.0))
        assert results[9].water is not None
        assert results[10].water is not None

    def test_reset_discards_the_frames_that_wait(self):
        method = make()
        for frame in sea_log(7, [BOAT], times(8)):
            method.process(frame)
        method.reset()
        assert list(method.flush()) == []
        log = sea_log(1, [BOAT], times(12))
        again = [result for frame in log for result in method.process(frame)] + list(method.flush())
        assert reasons(again) == reasons(run(log))


class TestScenes:
    def test_two_boats_that_cross(self):
        one, other = Body(25, -8, 0, 4), Body(33, 8, 0, -4, seen=(-1, 1.75, 2.25))  # one hides the other
        results = run(sea_log(1, [one, other], times(40)))
        assert min(min(shares(results, body)) for body in (one, other)) > 0.6
        assert min(np.mean(shares(results, body)) for body in (one, other)) > 0.97

    def test_a_wall_through_the_whole_view(self):
        wall = Body(0, 15, length=100, width=0.5, height=4, points=400)
        results = run(sea_log(1, [wall], times(12)))
        assert min(shares(results, wall)) > 0.95
        for result in results:
            assert result.water.level_m == pytest.approx(-MAST_M, abs=0.15)

    def test_rain_of_isolated_points(self):
        for result in run(sea_log(1, [], times(20), drops=150)):
            assert result.keep.mean() < 0.01
            assert result.counts[Reason.OUTLIER] > 80

    def test_no_water_at_all(self):
        results = run([thinned(frame, frame.valid) for frame in sea_log(1, [BOAT], times(12), size=0, drops=0)])
        assert [result.water for result in results] == [None] * 12
        assert shares(results, BOAT) == [1.0] * 12

    def test_nothing_but_isolated_points_and_no_water(self):
        log = [make_frame([(20 + 5 * k, 0, 1) for k in range(7)], 90, index=index) for index in range(8)]
        for result in run(log):
            assert (result.water, set(result.reason.tolist())) == (None, {Reason.OUTLIER})

    def test_200_objects(self):
        places = [(5 * i, 5 * j) for i in range(-10, 11) for j in range(-10, 11) if 4 <= math.hypot(i, j) <= 9.7]
        bodies = [Body(x, y, length=1.2, width=1.2, height=2, points=8) for x, y in places]
        assert len(bodies) > 200
        results = run(sea_log(1, bodies, times(8), drops=0))
        kept = [share for body in bodies for share in shares(results, body)]
        assert np.mean(kept) > 0.95

    @pytest.mark.parametrize("causal", [False, True])
    @pytest.mark.parametrize("bodies", [[BOAT], random_bodies(3)], ids=["boat", "several"])
    def test_duplicate_points(self, causal, bodies):
        """Both returns of a pulse may be the same: points reported twice change no outcome, and both copies have it."""
        log = sea_log(1, bodies, times(10))
        twice = [thinned(frame, np.tile(np.arange(frame.size), 2)) for frame in log]
        for doubled, once in zip(run(twice, causal=causal), run(log, causal=causal), strict=True):
            np.testing.assert_array_equal(doubled.reason, np.tile(once.reason, 2))

    def test_some_points_twice(self):
        log = sea_log(1, [BOAT], times(10))
        some = [thinned(frame, np.append(np.arange(frame.size), np.arange(0, frame.size, 3))) for frame in log]
        for doubled, once in zip(run(some), run(log), strict=True):
            np.testing.assert_array_equal(doubled.reason, np.append(once.reason, once.reason[::3]))

    def test_what_comes_near_is_kept_and_own_ship_is_not(self):
        visitor = Body(-18, -4, vx=5, points=30)
        results = run(sea_log(1, [visitor], times(26)))
        near = [result for result in results if result.frame.stamp_ns > 2e9]
        assert all(abs(visitor.center(result.frame.stamp_ns / 1e9)[0]) < 8 for result in near)
        assert np.mean([share_kept(result, visitor) for result in near]) > 0.9
        for result in run(sea_log(1, [BOAT], times(26))):
            assert not result.keep[result.frame.range_m < 10].any()


@cache
def log_of_random_bodies():
    """Return a log and the reasons of its points."""
    log = sea_log(3, random_bodies(3), times(25))
    return log, reasons(run(log))


class TestRates:
    @pytest.mark.parametrize("origin_ns", [0, 10**18, 1_764_529_437_123_456_789, 2**62])
    def test_the_origin_of_the_time_does_not_matter(self, origin_ns):
        log, expected = log_of_random_bodies()
        later = [replace(frame, stamp_ns=origin_ns + frame.stamp_ns - log[0].stamp_ns) for frame in log]
        assert reasons(run(later)) == expected

    def test_frames_of_other_rates_confirm_the_same_objects(self):
        bodies = [
            BOAT,
            Body(-30, 10, 2, -1),
            Body(10, -40, height=4, points=8),
            Body(-15, -15, height=0.1, intensity=4),
        ]
        bodies += [Body(30, -20, seen=(1.0, 1.08)), Body(0, 25, seen=(1.0, 3.0))]
        outcomes = []
        for rate_hz in (5, 10, 20):
            results = run(sea_log(1, bodies, times(round(3.2 * rate_hz), rate_hz), drops=0))
            outcomes.append([np.nanmean([0.0, *shares(results, body)]) > 0.5 for body in bodies])
        assert outcomes[0] == outcomes[1] == outcomes[2] == [True, True, True, False, False, True]

    def test_step_is_the_last_frame_of_a_log(self):
        log = sea_log(3, random_bodies(3), times(14))
        method = make()
        found = reasons([method.step(frame) for frame in log])
        assert found == [reasons(run(log[:end]))[-1] for end in range(1, 15)]

    @pytest.mark.parametrize("params", [{"causal": True}, {"look_ahead_s": 0.0}])
    def test_step_without_look_ahead(self, params):
        log = sea_log(3, random_bodies(3), times(8))
        method = make(**params)
        assert reasons([method.step(frame) for frame in log]) == reasons(run(log, **params))

    def test_a_result_is_complete_once_the_log_is_long_enough(self):
        method, log = make(look_ahead_s=0.3, start_m=10.0), sea_log(1, [], times(8))
        found = [[result.frame.index for result in method.process(frame)] for frame in log]
        assert found == [[], [], [], [0], [1], [2], [3], [4]]
        assert [result.frame.index for result in method.flush()] == [5, 6, 7]
        assert list(method.flush()) == []

    def test_the_first_frames_wait_for_own_ship(self):
        log = sea_log(1, [], times(22))
        method = make(look_ahead_s=0.3)
        found = [[result.frame.index for result in method.process(frame)] for frame in log]
        assert found == [*[[]] * 19, [*range(17)], [17], [18]]
        assert [result.frame.index for result in method.flush()] == [19, 20, 21]
        causal = make(causal=True)
        assert [len(causal.process(frame)) for frame in log] == [1] * 22

    def test_a_buoy_alongside_is_kept_from_the_first_frames(self):
        boat = Body(7.5, 1.0, 0, 1.0)
        log = sea_log(1, [boat], times(40))
        kept = shares(run(log), boat)
        assert min(kept[:30]) > 0.6
        assert max(shares(run(log, start_m=10.0), boat)) == 0

    def test_few_points_wait(self, monkeypatch):
        log = sea_log(1, [], times(8))
        monkeypatch.setattr(confirmed, "_MAX_WAITING", 3 * max(frame.size for frame in log))
        method = make()
        found = [[result.frame.index for result in method.process(frame)] for frame in log]
        assert found == [[], [], [], [0], [1], [2], [3], [4]]
        assert reasons(run(log)) == reasons(run(log, look_ahead_s=0.3))


STAMPS = st.lists(
    st.one_of(st.integers(0, 1200).map(lambda ms: ms * 1_000_000), st.integers(0, 2**64 - 1)), max_size=30
)


@settings(max_examples=60)
@given(stamps=STAMPS, look_ahead_s=st.sampled_from([0.0, 0.1, 0.5, 5.0]), causal=st.booleans())
def test_results_come_in_order_and_exactly_once(stamps, look_ahead_s, causal):
    points = np.array([[20, 0, 0.1 * k, 50] for k in range(5)])
    log = [replace(frame_at(0, points, index=index), stamp_ns=stamp) for index, stamp in enumerate(stamps)]
    assert len(run(log, look_ahead_s=look_ahead_s, causal=causal)) == len(log)


class TestFields:
    def without(self, log):
        return [replace(frame, cloud=from_array(frame.cloud.points[["x", "y", "z"]].copy())) for frame in log]

    def test_intensities_are_not_needed_without_thresholds(self):
        log = sea_log(1, [BOAT], times(10))
        log = [thinned(frame, frame.valid) for frame in log]  # without intensities that are not numbers
        results = run(self.without(log), use_intensity=False)
        assert shares(results, BOAT) == [1.0] * 10
        assert reasons(results) == reasons(run(log, use_intensity=False))
        assert {result.rings for result in results} == {None}
        assert not any(result.counts[Reason.LOW_INTENSITY] for result in results)

    def test_an_error_names_the_field(self):
        (frame,) = self.without(sea_log(1, [], times(1)))
        with pytest.raises(FieldError, match="no intensity field; the cloud has x, y, z"):
            make().process(frame)
        with pytest.raises(FieldError, match="no field 'power'"):
            make().process(replace(sea_log(1, [], times(1))[0], intensity_field="power"))

    def test_a_frame_with_an_error_changes_no_other_frame_in_order(self):
        log = sea_log(1, [BOAT], times(12))
        method, results = make(), []
        for frame in log:
            if frame.index == 6:
                with pytest.raises(FieldError):
                    method.process(*self.without([replace(frame, stamp_ns=frame.stamp_ns - 50_000_000)]))
            results += method.process(frame)
        results += method.flush()
        assert [result.frame.index for result in results] == list(range(12))
        assert shares(results, BOAT) == [1.0] * 12

    def test_an_error_behind_a_jump_loses_no_results(self):
        log = sea_log(1, [BOAT], [*times(8), *times(8, start_s=100)])
        method, results = make(), []
        for frame in log:
            if frame.index == 8:
                with pytest.raises(FieldError):
                    method.process(*self.without([frame]))
            results += method.process(frame)
        results += method.flush()
        assert [result.frame.index for result in results] == list(range(16))


def test_points_of_range_rings_nearer_than_3_m_are_not_kept_unseen():
    lonely = Frame(from_array(frame_at(0, np.array([[2.0, 0, 0, 50]])).cloud.points))
    (result,) = run([lonely], start_m=1.0, end_m=61.0)
    assert result.reason.tolist() != [Reason.KEPT]
