"""The report page of a method that estimates the water and confirms objects, in a browser."""

import numpy as np
import pytest

from tests.filters.seas import water as sea_water
from tests.paths import ROOT
from tests.reporting.pages import SMALL_CONTROLS
from tests.reporting.runs import LABELLED, POINT, data_of, lump, make_log, report, unpacked

SEA = ROOT / "samples" / "sea.mcap"


@pytest.fixture(scope="module")
def water(tmp_path_factory):
    """Return a report on the sample with a method that estimates the water; frame 11 has an unconfirmed cluster."""
    page = tmp_path_factory.mktemp("page") / "water.html"
    report(SEA, "-m", "confirmed", "-m", "joint", "-n", 20, "--pick", 11, "-o", page)
    return page


@pytest.fixture(scope="module")
def dry(tmp_path_factory):
    """Return a report on the sample with a method that does not estimate the water."""
    page = tmp_path_factory.mktemp("page") / "dry.html"
    report(SEA, "-m", "joint", "-n", 5, "-o", page)
    return page


def test_height_above_the_water(water, dry, visit):
    assert visit(dry).page.get_by_role("button", name="Height above water").count() == 0
    page = visit(water)
    page.page.get_by_role("button", name="Height above water").click()
    assert page.pixels()["#3f95e8"] > 100, "half of the water is below its mean"
    legend = page.page.locator("#clouds .legend").inner_text().split("\n")
    assert legend[:5] == ["0 m and below", "0.5 m", "1 m", "2 m", "3 m and above"]
    sample = data_of(water)["samples"][0]
    x, y, z = unpacked(sample["xyz"], "<i2").reshape(-1, 3).T * sample["scale"]
    plane = sample["water"]
    heights = z - plane["level"] - plane["slope_x"] * x - plane["slope_y"] * y
    words = page.page.evaluate("[...openSample(0).heights]")
    colors = np.array([int(word).to_bytes(4, "little")[:3].hex() for word in words])
    for height, color in ((0.0, "3f95e8"), (0.5, "b45a9a"), (1.0, "b3203f"), (2.0, "6e0f14"), (3.0, "1c0608")):
        assert set(colors[np.abs(heights - height) < 0.009]) <= {color}
    assert set(colors[heights < 0]) == {"3f95e8"}
    assert len(set(colors[heights > 0.5])) > 20


def test_a_frame_without_water_is_grey(visit, tmp_path):
    def make(number):
        if number == 0:  # a boat only
            return lump(30, 100)
        points = np.zeros(300, LABELLED)
        for name, values in zip(
            POINT.names, sea_water(np.random.default_rng(number), 0.1 * number, 300).T, strict=True
        ):
            points[name] = values
        return points

    log = make_log(tmp_path / "log.mcap", make=make)
    report(log, "-m", "confirmed", "-o", tmp_path / "page.html")
    page = visit(tmp_path / "page.html")
    rows = [one["row"] for one in data_of(tmp_path / "page.html")["samples"]]
    page.page.get_by_role("button", name="Height above water").click()
    page.page.get_by_label("frame", exact=True).select_option(index=rows.index(1))
    assert "No water" not in page.shown()
    assert "#8b8f94" not in page.pixels()
    page.page.get_by_label("frame", exact=True).select_option(index=rows.index(0))
    assert "No water seen." in page.shown()
    assert page.page.locator("#clouds .legend").inner_text().startswith("no water seen in this frame")
    page.page.get_by_label("clusters").uncheck()
    assert page.pixels()["#8b8f94"] >= 10
    assert "NaN" not in page.page.locator("main").inner_text()


def test_confirmed_and_unconfirmed_clusters(water, visit):
    page = visit(water)
    picked = next(k for k, one in enumerate(data_of(water)["samples"]) if one["why"] == "picked")
    page.page.get_by_label("frame", exact=True).select_option(index=picked)
    assert "2 confirmed clusters, 2 unconfirmed." in page.shown()
    assert page.pixels()["#870f1e"] > 10
    page.page.evaluate("""() => {
      window.drawn = [];
      const box = CloudView.prototype.box;
      CloudView.prototype.box = function (...parts) { window.drawn.push(parts[3]); return box.apply(this, parts); };
    }""")
    legend = page.page.locator("#clouds .legend")

    def outlines():
        page.page.evaluate("window.drawn = []")
        page.page.get_by_role("button", name="Reset view").click()
        page.settle()
        return page.page.evaluate("window.drawn")

    assert outlines() == ["#14213d"] * 2 + ["#870f1e"] * 2
    assert legend.inner_text().endswith("confirmed cluster\nunconfirmed cluster")
    page.page.get_by_role("button", name="Kept points").click()
    assert outlines() == ["#14213d", "#14213d"]
    assert legend.inner_text().endswith("\nconfirmed cluster")
    page.page.get_by_role("button", name="After thresholds").click()
    assert outlines() == []
    assert "cluster" not in legend.inner_text()
    page.page.get_by_role("button", name="Raw").click()
    page.page.get_by_label("method", exact=True).select_option(label="joint")
    assert "confirmed" not in page.shown().replace("unconfirmed ones", "")
    assert "#870f1e" not in outlines()


def test_without_thresholds_only_confirmed_clusters_are_counted(visit, tmp_path):
    report(SEA, "-m", "confirmed", "-s", "filter.use_intensity=false", "-n", 5, "-o", tmp_path / "page.html")
    page = visit(tmp_path / "page.html")
    assert "2 confirmed clusters. All" in page.shown()
    assert "unconfirmed cluster" not in page.page.locator("#clouds .legend").inner_text()


def test_charts_of_the_water(water, dry, visit):
    assert visit(dry).page.get_by_role("img", name="Water level").count() == 0
    page = visit(water)
    state = data_of(water)["samples"]
    first = next(one["water"] for one in state if one["row"] == 0)
    for name, value in (("Water level", first["level"]), ("Significant wave height", first["wave_height"])):
        chart = page.page.get_by_role("img", name=name)
        chart.focus()
        page.page.keyboard.press("ArrowRight")
        text = chart.evaluate("chart => chart.parentElement.nextElementSibling.textContent")
        assert text == f"frame 0, 0.00 s: {name.lower()} {float(f'{value:.3g}'):g}"
        assert chart.locator("path[fill=none]:not(.axis)").get_attribute("d").count("L") == 19
    page.page.get_by_label("method for the time series").select_option(label="joint")
    assert page.page.get_by_role("img", name="Water level").count() == 0


@pytest.mark.parametrize("color", ["Reason", "Height above water"])
def test_water_on_small_screens(water, visit, color):
    page = visit(water, width=360, height=740, device_scale_factor=2, has_touch=True)
    page.page.get_by_role("button", name=color).tap()
    assert page.page.evaluate("document.documentElement.scrollWidth") == 360
    assert page.page.evaluate(SMALL_CONTROLS) == 0
