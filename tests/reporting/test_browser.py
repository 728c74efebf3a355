"""The report page in a browser: no errors, no requests, drawn points, and operation by mouse, keyboard and touch."""

from itertools import pairwise

import pytest

from tests.logs import cloud_log
from tests.paths import ROOT
from tests.reporting.pages import SMALL_CONTROLS
from tests.reporting.runs import HOSTILE, LABELLED, make_labels, make_log, report

SEA = ROOT / "samples" / "sea"


@pytest.fixture(scope="module")
def sea(tmp_path_factory):
    """Return a report on the sample with three methods."""
    page = tmp_path_factory.mktemp("page") / "sea.html"
    methods = [word for name in ("joint", "ring_intensity", "none") for word in ("-m", name)]
    report(SEA.with_suffix(".mcap"), "--labels", SEA.with_suffix(".labels.csv"), *methods, "-o", page)
    return page


def test_points_are_drawn_in_the_colours_of_their_reasons(sea, visit):
    found = visit(sea).pixels()
    assert found["#14213d"] > 100  # kept
    assert found["#3f95e8"] > 500  # low intensity


def test_outliers_among_kept_points_are_visible(sea, visit):
    page = visit(sea)
    counts = page.page.evaluate("data.samples.map((_, i) => openSample(i).reasons[0].filter(one => one === 4).length)")
    page.page.get_by_label("frame", exact=True).select_option(index=counts.index(max(counts)))
    visible = page.pixels()["#d1661a"]
    page.page.get_by_label("kept", exact=True).uncheck()
    alone = page.pixels()["#d1661a"]
    assert visible >= 0.9 * alone > 0


def test_unlabelled_frames_have_their_own_heading(visit, tmp_path):
    labels = make_labels(tmp_path / "boxes.csv")
    lines = labels.read_text(encoding="utf-8").splitlines(keepends=True)
    labels.write_text("".join([lines[0], *(line for line in lines[1:] if line.split(",")[0] in "01")]), "utf-8")
    report(make_log(tmp_path / "log.mcap"), "--labels", labels, "-o", tmp_path / "page.html")
    page = visit(tmp_path / "page.html")
    for button in page.page.locator(".picks button").all():
        title = button.evaluate("one => one.closest('ul').previousElementSibling.textContent")
        assert (title == "Unlabelled frames") == ("unlabelled" in button.inner_text())
    assert page.page.get_by_role("heading", name="Unlabelled frames").count() == 1


def test_thresholds_of_a_single_frame_are_dots(visit, tmp_path):
    report(make_log(tmp_path / "log.mcap"), "-n", 1, "-o", tmp_path / "page.html")
    chart = visit(tmp_path / "page.html").page.get_by_role("img", name="Threshold of each range ring")
    radii = chart.locator("circle").evaluate_all("dots => dots.map(dot => Number(dot.getAttribute('r')))")
    assert len(radii) == 4
    assert min(radii) >= 3


def test_a_click_on_a_bad_frame_shows_it(sea, visit):
    page = visit(sea)
    bad = page.page.get_by_role("button", name="2 false alarms").first
    name = bad.inner_text().splitlines()[0]
    before = page.pixels()
    bad.click()
    assert page.shown().startswith(f"{name}, ")
    assert "joint: 2 false alarms" in page.shown()
    assert page.pixels() != before
    page.page.wait_for_function("document.querySelector('#clouds').getBoundingClientRect().top < 900", timeout=5000)


def test_the_worst_frame_is_first_and_shown(sea, visit):
    page = visit(sea)
    first = page.page.locator(".picks button").first
    assert "alarm" in first.inner_text()
    assert first.get_attribute("aria-current") == "true"
    assert page.shown().startswith(first.inner_text().splitlines()[0])


def test_other_frames_with_errors_are_listed(sea, visit):
    page = visit(sea)
    page.page.get_by_text("12 more frames with errors").click()
    text = page.page.locator("details", has_text="more frames with errors").inner_text()
    assert "1 to 3, 6 to 7, 10 to 11, 14, 16 to 17, 21 to 22." in text
    assert "--pick" in text


def test_a_click_on_the_timeline_shows_the_nearest_frame(sea, visit):
    page = visit(sea)
    timeline = page.page.get_by_role("img", name="Frames with false alarms and missed targets")
    box = timeline.bounding_box()
    timeline.click(position={"x": box["width"] - 16, "y": 20})
    numbers = page.page.evaluate("data.samples.map(sample => frames.number[sample.row])")
    assert page.shown().startswith(f"frame {max(numbers)},")


def test_the_slider_goes_through_the_frames_in_their_order(sea, visit):
    page = visit(sea)
    slider = page.page.get_by_role("slider", name="frame, by time")
    rows = page.page.evaluate("data.samples.map(sample => frames.number[sample.row])")
    assert rows != sorted(rows), "the list begins with the worst"
    slider.focus()
    page.page.keyboard.press("Home")
    passed = [page.shown().split(",")[0]]
    for _ in rows[1:]:
        page.page.keyboard.press("ArrowRight")
        passed.append(page.shown().split(",")[0])
    assert passed == [f"frame {number}" for number in sorted(rows)]
    assert slider.get_attribute("aria-valuetext").startswith(passed[-1])
    page.page.get_by_role("button", name="2 false alarms").first.click()
    assert slider.get_attribute("aria-valuetext").startswith(page.shown().split(".")[0])


def test_wide_tables_say_that_they_scroll(sea, visit):
    for width, hidden in ((390, False), (1280, True)):
        page = visit(sea, width=width)
        page.settle()
        hint = page.page.get_by_role("region", name="method").locator("xpath=preceding-sibling::p")
        assert hint.is_hidden() == hidden
    narrow = visit(sea, width=390)
    cell = narrow.page.get_by_role("region", name="method").get_by_text("joint", exact=True)
    before = cell.bounding_box()["x"]
    narrow.page.get_by_role("region", name="method").evaluate("box => { box.scrollLeft = 200 }")
    assert cell.bounding_box()["x"] == before, "names stay in view"


def test_the_best_filters_are_bold(sea, visit):
    table = visit(sea).page.get_by_role("region", name="method")
    heads = table.locator("th").all_inner_texts()
    rows = {row.locator("td").first.inner_text(): row for row in table.locator("tbody tr").all()}
    missed = {name: row.locator("td").nth(heads.index("N_FN")).locator("strong").count() for name, row in rows.items()}
    assert missed == {"joint": 0, "ring_intensity": 1, "none": 0, "ideal": 0}, "the ideal is no filter"


def test_provenance_is_shown(sea, visit):
    text = visit(sea).page.locator("#provenance").inner_text()
    assert "seaclutter report " in text
    assert "2023-11-14 22:13:20 to 22:13:26 UTC" in text
    assert "RS-LiDAR-32" in text


def test_stage_by_stage(sea, visit):
    page = visit(sea)
    page.page.get_by_role("button", name="Stage by stage").click()
    assert page.page.locator("canvas").count() == 3
    low = [page.pixels(number).get("#3f95e8", 0) for number in range(3)]
    assert low[0] > 0 == low[1] == low[2]


def test_two_methods(sea, visit):
    page = visit(sea)
    page.page.get_by_role("button", name="Two methods").click()
    page.page.get_by_label("second method").select_option(label="none")
    assert page.pixels(1)["#14213d"] > 2 * page.pixels(0)["#14213d"]


def test_labels_and_hidden_reasons(sea, visit):
    page = visit(sea)
    page.page.get_by_label("low intensity").uncheck()
    assert "#3f95e8" not in page.pixels()
    page.page.get_by_role("button", name="Label", exact=True).click()
    assert page.pixels()["#3f95e8"] > 500  # clutter


def test_keys_rotate_the_view_and_move_the_cursor(sea, visit):
    page = visit(sea)
    page.page.locator("canvas").focus()
    pictures = [page.pixels()]
    for key in ("ArrowLeft", "+", "Shift+ArrowUp", "t", "0"):
        page.page.keyboard.press(key)
        pictures.append(page.pixels())
    assert all(now != before for before, now in pairwise(pictures))
    assert pictures[-1] == pictures[0]
    chart = page.page.get_by_role("img", name="Threshold of each range ring")
    chart.focus()
    page.page.keyboard.press("ArrowRight")
    page.page.keyboard.press("ArrowRight")
    text = chart.evaluate("chart => chart.parentElement.nextElementSibling.textContent")
    assert text.startswith("frame 1, 0.10 s: 10 to 25 m")


def test_everything_can_be_reached_by_tab(sea, visit):
    page = visit(sea)
    names = set()
    for _ in range(60):
        page.page.keyboard.press("Tab")
        names.add(
            page.page.evaluate("document.activeElement.tagName + ' ' + document.activeElement.textContent.trim()")
        )
    assert {"BUTTON Next", "BUTTON Two methods", "CANVAS ", "A Skip to the point clouds"} <= names


def test_drag_and_wheel(sea, visit):
    page = visit(sea)
    canvas = page.page.locator("canvas")
    canvas.scroll_into_view_if_needed()
    box, before = canvas.bounding_box(), page.pixels()
    page.page.mouse.move(box["x"] + 300, box["y"] + 200)
    page.page.mouse.wheel(0, 50)
    page.settle()
    assert page.pixels() == before, "without focus, the wheel scrolls the page"
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    page.page.mouse.move(box["x"] + 300, box["y"] + 200)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + 380, box["y"] + 240)
    page.page.mouse.up()
    rotated = page.pixels()
    assert rotated != before
    page.page.mouse.wheel(0, -300)
    page.page.wait_for_timeout(100)
    assert page.pixels() != rotated


@pytest.mark.parametrize("layout", ["Single view", "Stage by stage", "Two methods"])
def test_small_screens(sea, visit, layout):
    page = visit(sea, width=360, height=740, device_scale_factor=2, has_touch=True)
    page.page.get_by_role("button", name=layout).tap()
    assert page.page.evaluate("document.documentElement.scrollWidth") == 360
    assert page.pixels()["#14213d"] > 100
    assert page.page.evaluate(SMALL_CONTROLS) == 0


def test_hostile_names(visit, tmp_path):
    log = make_log(tmp_path / "<img src=x onerror=alert(3)>.mcap")
    quoted = HOSTILE.replace('"', '""')
    rows = "".join(f'{k},"{quoted}","{quoted}",30.5,0,0,3,2,2,0\n' for k in range(6))
    head = "frame,track_id,class,x,y,z,length,width,height,yaw\n"
    (tmp_path / "l.csv").write_text(head + rows, encoding="utf-8")
    report(log, "--labels", tmp_path / "l.csv", "-o", tmp_path / "page.html")
    page = visit(tmp_path / "page.html")
    assert page.page.locator("h1").inner_text() == "<img src=x onerror=alert(3)>"
    assert page.page.locator("img").count() == 0
    assert page.page.locator("script").count() == 2


UNUSUAL = {
    "no labels": ([], {}),
    "one frame": (["-n", 1], {}),
    "one frame, labelled": (["-n", 1, "--labels", "{labels}"], {}),
    "nothing removed": (["-m", "none"], {}),
    "fifty rings": (["-s", "filter.ring_width_m=1.2", "-s", f"filter.initial_thresholds={[5] * 50}"], {}),
    "five rings": (["-s", "filter.ring_width_m=12", "-s", f"filter.initial_thresholds={[5] * 5}"], {}),
    "scenes": (["-m", "adaptive_radius"], {}),
    "no points": ([], {"make": lambda _: __import__("numpy").zeros(0, LABELLED)}),
}


@pytest.mark.parametrize("name", UNUSUAL)
def test_unusual_logs(visit, tmp_path, name):
    arguments, changes = UNUSUAL[name]
    labels = make_labels(tmp_path / "boxes.csv")
    log = make_log(tmp_path / "log.mcap", **changes)
    filled = [str(word).format(labels=labels) for word in arguments]
    report(log, *filled, "-o", tmp_path / "page.html")
    page = visit(tmp_path / "page.html")
    assert page.page.locator("canvas").count() == 1
    assert "NaN" not in page.page.content().replace("NaN(", "").split('<script type="application/json"')[0]
    if name == "fifty rings":
        page.page.get_by_label("range ring", exact=True).select_option(index=3)
        assert page.page.get_by_text("12.4 to 13.6 m").count() >= 1
    if name == "scenes":
        chart = page.page.get_by_role("img", name="Class of scene per frame")
        chart.focus()
        page.page.keyboard.press("ArrowRight")
        assert chart.evaluate("chart => chart.parentElement.nextElementSibling.textContent").endswith(": open")
    if name == "no points":
        assert "all 0 returns" in page.shown().lower()


def test_a_log_without_frames(visit, tmp_path):
    log = cloud_log(tmp_path / "log.mcap", frames=0)
    report(log, "-o", tmp_path / "page.html")
    page = visit(tmp_path / "page.html")
    assert "No frames" in page.page.locator("#summary").inner_text()
