"""Figure of clutter and thresholds: correct counts, any data, reproducible bytes."""

import io
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from seaclutter_cli.calibration import Calibration
from seaclutter_cli.errors import MissingExtraError, UsageError
from seaclutter_cli.filters.joint import JointParams
from seaclutter_cli.plots.curves import ClutterDensity, draw_clutter
from seaclutter_cli.plots.figure import check_target, render


def density_of(ranges, intensity, *, start_m=10.0, width_m=15.0, rings=250):
    density = ClutterDensity(start_m, width_m, rings)
    for some in np.array_split(np.arange(len(ranges)), 3):
        density.add(np.asarray(ranges, float)[some], np.asarray(intensity, float)[some])
    return density


def picture(ranges, intensity, suffix=".png"):
    calibration = Calibration(JointParams(), filter_rate=0.8)
    calibration.add(ranges, intensity)
    density = density_of(ranges, intensity)
    return render(lambda figure: draw_clutter(figure, density, calibration.thresholds()), suffix)


def sea(draw, size=5000):
    rng = np.random.default_rng(1)
    ranges = 10 + 20 * rng.weibull(1.2, size)
    return ranges, draw(rng, ranges)


SEAS = {
    "8 bit": lambda rng, ranges: np.clip(np.floor(rng.exponential(500 / ranges)), 0, 255),
    "16 bit": lambda rng, ranges: np.floor(rng.exponential(2e5 / ranges)),
    "unit": lambda rng, ranges: np.clip(rng.exponential(2 / ranges), 0, 1),
    "negative": lambda rng, ranges: rng.normal(-40, 10, len(ranges)),
    "all equal": lambda rng, ranges: np.full(len(ranges), 7.0),
    "all 0": lambda rng, ranges: np.zeros(len(ranges)),
    "tiny": lambda rng, ranges: 1e-30 * rng.random(len(ranges)),
    "huge": lambda rng, ranges: np.append(rng.random(len(ranges) - 1), 1e300),
}


@pytest.mark.parametrize("name", ["unit", "negative", "all 0", "huge"])
def test_any_data_can_be_drawn(name):
    with Image.open(io.BytesIO(picture(*sea(SEAS[name])))) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    assert pixels.shape[1] == 1050
    blue = (pixels[..., 2] > pixels[..., 0] + 30).sum()
    red = (pixels[..., 0] > pixels[..., 2] + 80).sum()
    assert blue > 500
    assert red > 500


def test_a_single_point():
    assert picture(np.array([12.0]), np.array([3.0]))


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_the_same_bytes_without_date(suffix):
    first, second = (picture(*sea(SEAS["8 bit"]), suffix) for _ in range(2))
    assert first == second
    assert b"<dc:date>" not in first
    assert b"Matplotlib v" not in first


def test_labels_and_units():
    from matplotlib.figure import Figure

    figure = Figure()
    calibration = Calibration(JointParams(), filter_rate=0.8)
    calibration.add(*sea(SEAS["8 bit"]))
    found = calibration.thresholds()
    draw_clutter(figure, density_of(*sea(SEAS["8 bit"])), found)
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("Range (m)", "Intensity (sensor units)")
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        "threshold",
        f"far limit ({found.end_m:g} m)",
    ]
    (steps,) = (patch for patch in axes.patches if hasattr(patch, "get_data"))
    assert steps.get_data().values.tolist() == list(found.initial_thresholds)
    assert steps.get_data().edges.tolist() == [10, *(ring.end_m for ring in found.rings)]
    assert axes.get_ylim()[1] >= max(found.initial_thresholds)
    assert axes.get_xlim()[1] >= found.end_m


@given(
    st.lists(st.tuples(st.floats(10, 200), st.integers(0, 255)), min_size=1, max_size=200),
    st.sampled_from([20.0, 64.0, 100.0, 128.0, 256.0]),
)
def test_counts_of_whole_numbers_are_exact(points, most):
    ranges, intensity = np.array(points, float).T
    range_m, rows, counts = density_of(ranges, intensity).grid(100, (0.0, most))
    expected = np.histogram2d(intensity, ranges, (rows, range_m))[0]
    # numpy counts values at the last edge in the last cell
    last = (ranges == range_m[-1]) | (intensity == rows[-1])
    if not last.any():
        np.testing.assert_array_equal(counts, expected)
    assert np.diff(rows).min() >= 1


@pytest.mark.parametrize("draw", SEAS.values(), ids=SEAS)
def test_quantiles_within_a_row(draw):
    ranges, intensity = sea(draw)
    density = density_of(ranges, intensity)
    for share in (0.01, 0.5, 0.99):
        exact = np.quantile(intensity, share, method="inverted_cdf")
        assert density.quantile(share) == pytest.approx(exact, rel=1 / 64)


def test_without_points():
    density = ClutterDensity(10, 15, 250)
    assert density.quantile(0.5) == 0
    assert density.grid(70, (0.0, 1.0))[2].sum() == 0


def test_the_number_of_range_rings_is_bounded():
    density = density_of(np.append(np.arange(10, 200), 1e300), np.ones(191), rings=4)
    assert density.grid(1000, (0.0, 2.0))[2].sum() == 60


def test_targets_are_checked_before_drawing(tmp_path, monkeypatch):
    check_target(tmp_path / "a.png")
    with pytest.raises(UsageError, match=r"a\.pdf: figure files must end in \.png or \.svg"):
        check_target(tmp_path / "a.pdf")
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"requires an optional dependency: pip install 'seaclutter\[plot\]'"):
        check_target(tmp_path / "a.png")
