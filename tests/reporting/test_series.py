"""Series over frames: stored unchanged, binned for the screen, and counted in density plots."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.evaluation.matching import Alarms
from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import Rings, WaterState
from seaclutter_cli.reporting.collector import MAX_BINS, History, bin_starts, binned, density_of
from seaclutter_cli.reporting.sample import take_sample
from tests.evaluation.scenes import frame_of, lump, result_of, told
from tests.reporting.test_sample import PARAMS


def test_a_history_returns_the_values_added():
    history = History(2)
    rings = Rings(np.array([30.0, 16]), np.array([0.0, 5]), *np.zeros((3, 2), np.int64))
    water = WaterState(-2.5, 1.0, -2.0, 0.75, 0.125)
    alarms = Alarms(targets=3, visible=2, detected=1, clusters=4, false_alarms=3)
    history.add(told(np.arange(9), rings, water=water), FrameScore(21, 0, 4, 0, alarms, None))
    history.add(None, None)
    history.add(told(np.arange(9)), FrameScore(21, 0, 5, 0, None, None))
    assert history["counts"][0].tolist() == list(range(9))
    assert np.isnan(history["counts"][1]).all()
    assert history["thresholds"][0].tolist() == [30, 16]
    assert history["corrections"][0].tolist() == [0, 5]
    assert np.isnan(history["thresholds"][1:]).all()
    assert history["water"][0].tolist() == [-2.5, 1.0, -2.0, 0.75, 0.125]
    assert np.isnan(history["water"][1:]).all()
    assert (history["missed"][0], history["false_alarms"][0]) == (1, 3)
    assert np.isnan(history["false_alarms"][1:]).all()


def test_scenes_by_name():
    history = History(0)
    for scene in ("open", None, "confined", "open"):
        history.add(told(np.arange(9), None, scene), None)
    history.add(None, None)
    found = {name: frames.tolist() for name, frames in history.scenes.items()}
    assert found == {"confined": [0, 0, 1, 0, 0], "open": [1, 0, 0, 1, 0]}


@given(st.lists(st.one_of(st.none(), st.integers(-1000, 1000)), max_size=60), st.integers(1, 7))
def test_bins_against_python(values, step):
    series = np.array([[np.nan if value is None else value] for value in values], np.float32).reshape(-1, 1)
    starts = np.arange(0, len(values), step)
    found = np.stack(binned(series, starts), axis=-1).reshape(-1, 3)
    for start, row in zip(starts, found, strict=True):
        known = [value for value in values[start : start + step] if value is not None]
        expected = [sum(known) / len(known), min(known), max(known)] if known else [np.nan] * 3
        assert row == pytest.approx(expected, nan_ok=True, rel=1e-5)


@pytest.mark.parametrize("frames", [0, 1, MAX_BINS, MAX_BINS + 1, 10_000])
def test_bins_cover_all_frames(frames):
    starts = bin_starts(frames)
    assert len(starts) <= MAX_BINS
    assert (len(starts) == frames) == (frames <= MAX_BINS)
    assert len(set(np.diff(starts))) <= 1


def test_the_density_counts_every_point_of_thinned_frames():
    frame = frame_of(lump(20, count=3000, spread=0.001))
    sample = take_sample(frame, [result_of(frame, removed=range(2000))], None, PARAMS, 300)
    reach_m, low, high, counts = density_of([sample, sample], 0, [10.0, 25.0], 90.0)
    assert counts.sum() == pytest.approx(3000, rel=1e-4)
    assert counts[0].sum() == pytest.approx(1000, rel=1e-4)
    row, column = np.argwhere(counts.sum(axis=0))[0]
    heights = np.linspace(low, high, counts.shape[1] + 1)
    assert heights[row] <= 100 < heights[row + 1]
    assert reach_m * column / counts.shape[2] == pytest.approx(20, abs=0.3)


def test_no_density_without_frames():
    assert density_of([], 0, [], 0.0) is None
