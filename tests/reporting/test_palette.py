"""Colours of reports: legible text, and points and curves that all readers can distinguish."""

from itertools import combinations, pairwise

import pytest

from seaclutter_cli.reporting import palette
from tests.reporting.colors import VISIONS, ciede2000, contrast, difference

TEXT = 4.5  # WCAG 2.2, 1.4.3 level AA
GRAPHICS = 3.0  # 1.4.11
MIN_DIFFERENCE = 11.0  # colours side by side in a legend are easy to distinguish from around 10

INK = palette.INK


def test_ciede2000_against_published_pairs():
    # Sharma, Wu and Dalal (2005), table 1: pairs 1, 7, 17 and 25
    assert ciede2000((50, 2.6772, -79.7751), (50, 0, -82.7485)) == pytest.approx(2.0425, abs=1e-4)
    assert ciede2000((50, 0, 0), (50, -1, 2)) == pytest.approx(2.3669, abs=1e-4)
    assert ciede2000((50, 2.5, 0), (73, 25, -18)) == pytest.approx(27.1492, abs=1e-4)
    assert ciede2000((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387)) == pytest.approx(1.2644, abs=1e-4)


def test_contrast_of_black_on_white():
    assert contrast("#000000", "#ffffff") == pytest.approx(21)


@pytest.mark.parametrize("name", ["ink", "muted", "link", "bad"])
@pytest.mark.parametrize("ground", ["paper", "wash"])
def test_text_is_legible(name, ground):
    assert contrast(INK[name], INK[ground]) >= TEXT


@pytest.mark.parametrize(
    "color",
    [
        *palette.LINES,
        *palette.RAMP,
        *palette.TRUTH.values(),
        palette.STATES["false alarm"],
        palette.STATES["missed target"],
    ],
)
def test_graphics_are_visible(color):
    assert contrast(color, INK["paper"]) >= GRAPHICS


@pytest.mark.parametrize("reason", [reason for reason in palette.REASONS if reason.name != "INVALID"])
def test_points_are_visible(reason):
    assert contrast(palette.REASONS[reason], INK["paper"]) >= GRAPHICS


@pytest.mark.parametrize("vision", VISIONS)
def test_colors_of_heights_get_darker(vision):
    colors = list(palette.HEIGHTS.values())
    assert list(palette.HEIGHTS) == sorted(palette.HEIGHTS)
    for lower, higher in pairwise(colors):
        assert difference(lower, higher, vision) >= MIN_DIFFERENCE
    ratios = [contrast(color, INK["paper"]) for color in colors]
    assert ratios == sorted(ratios)
    assert ratios[0] >= GRAPHICS


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("colors", [palette.REASONS, palette.TRUTH, palette.STATES], ids=["reasons", "truth", "states"])
def test_colors_are_distinguishable(colors, vision):
    for (one, first), (other, second) in combinations(colors.items(), 2):
        assert difference(first, second, vision) >= MIN_DIFFERENCE, (one, other)
