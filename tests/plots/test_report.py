"""Figures of a report: content, size, reproducible bytes."""

import io
import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.scores import score_frame
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import Reason, WaterState
from seaclutter_cli.plots.report import FIGURES, draw_figures
from seaclutter_cli.reporting import palette
from seaclutter_cli.reporting.collector import Collector, History, Method, ScoredFrame
from seaclutter_cli.tracking.follow import Follower
from seaclutter_cli.truth import Truth
from tests.evaluation.scenes import boxes, frame_of, lump, told
from tests.reporting.colors import difference

EDGES = (10.0, 25.0, 40.0, 55.0, 70.0)
FRAMES = 12
TARGET, WAVE = lump(30), lump(45, y=10.0)


def collect(*, edges=EDGES, names=("joint", "none"), frames=FRAMES, labelled=True):
    """Return the collected data of a scene with a target, and a wave in every other frame."""
    methods = [FILTERS[name](FILTERS[name].Params()) for name in names]
    kinds = [Method(name, edges if name != "none" else (), "") for name in names]
    collected = Collector(kinds, EvaluationParams(), partial(Follower, 1.5, 5), labelled=labelled, frames=6)
    collected.begin("sea")
    truth = Truth(boxes((30.5, 3.0))) if labelled else None
    for index in range(frames):
        frame = frame_of(TARGET, *([WAVE] if index % 2 else []), index=index)
        results = [method.step(frame) for method in methods]
        collected.add(ScoredFrame(frame, results, truth, score_frame(frame, results, truth, EvaluationParams())))
    return collected


def drawn(name, collected):
    figure = Figure()
    FIGURES[name].draw(figure, collected)
    return figure


def test_figures_are_drawn_if_there_is_data():
    assert set(draw_figures(collect(), "svg")) == {f"{name}.svg" for name in FIGURES if name != "water"}
    alone = draw_figures(collect(names=("none",), labelled=False), "svg")
    assert set(alone) == {"intensity.svg", "reasons.svg", "stages.svg"}
    assert draw_figures(collect(frames=0), "svg") == {}


def test_the_same_content_gives_the_same_bytes():
    assert draw_figures(collect(frames=3), "svg") == draw_figures(collect(frames=3), "svg")


def test_figures_have_the_width_of_a_column_at_print_quality():
    from PIL import Image

    for name, content in draw_figures(collect(), "png").items():
        with Image.open(io.BytesIO(content)) as picture:
            assert picture.width == 1050, name
            assert picture.info["dpi"][0] == pytest.approx(300, abs=1)


def test_text_is_legible_at_that_width():
    for name in FIGURES:
        figure = drawn(name, collect())
        for axes in figure.axes:
            texts = [axes.xaxis.label, axes.yaxis.label, axes.title]
            assert all(text.get_size() >= 7 for text in texts if text.get_text()), name


@pytest.mark.parametrize("name", [name for name in FIGURES if name != "alarms"])
def test_axes_have_units(name):
    labels = {axes.get_xlabel() or axes.get_ylabel() for axes in drawn(name, collect()).axes}
    assert all(re.search(r"Frame|\(m\)|Points|unit", label) for label in labels)


def test_thresholds_are_those_of_the_filter():
    collected = collect()
    lines = drawn("thresholds", collected).axes[0].lines
    assert len(lines) == 4
    for ring, line in enumerate(lines):
        np.testing.assert_array_equal(line.get_ydata(), collected.histories[0]["thresholds"][:, ring])
    assert lines[0].get_label() == "10 to 25 m"


def test_the_threshold_over_range_is_the_mean():
    collected = collect()
    steps = [patch for patch in drawn("intensity", collected).axes[0].patches if patch.get_label() == "mean threshold"]
    values, edges, _ = steps[0].get_data()
    assert tuple(edges) == EDGES
    np.testing.assert_allclose(values, collected.histories[0]["thresholds"].mean(axis=0))
    outlier = palette.REASONS[Reason.OUTLIER]
    assert difference(to_hex(steps[0].get_edgecolor()), outlier) > 30


def test_level_and_wave_height_of_the_water():
    collected = collect()
    rows = [
        None,
        WaterState(-2.5, 0, 0, 0.3, 0.1),
        WaterState(-2.4, 0, 0, 0.4, 0.1),
        None,
        WaterState(-2.3, 0, 0, 0.5, 0.1),
    ]
    collected.histories[0] = History(4)
    for water in rows:
        collected.histories[0].add(told(np.zeros(9), water=water), None)
    assert FIGURES["water"].applies(collected)
    level, height = drawn("water", collected).axes
    unknown = float("nan")
    np.testing.assert_allclose(level.lines[0].get_ydata(), [unknown, -2.5, -2.4, unknown, -2.3], rtol=1e-6)
    np.testing.assert_allclose(height.lines[0].get_ydata(), [unknown, 0.3, 0.4, unknown, 0.5], rtol=1e-6)
    assert height.get_ylim()[0] == 0
    assert 4 in level.lines[0].get_markevery()


@pytest.mark.parametrize("name", ["thresholds", "corrections"])
def test_few_frames_have_markers_and_whole_ticks(name):
    for frames in (1, 2):
        axes = drawn(name, collect(frames=frames)).axes[0]
        assert all(line.get_marker() == "o" and len(line.get_markevery()) == frames for line in axes.lines)
        low, high = axes.get_xlim()
        ticks = [tick for tick in axes.get_xticks() if low <= tick <= high]
        assert ticks == list(range(frames))
    assert all(line.get_marker() == "None" for line in drawn(name, collect()).axes[0].lines)


def test_a_value_between_unknown_ones_has_a_marker():
    collected = collect()
    rows = collected.histories[0]._rows
    for row in (4, 6):
        rows[row]["thresholds"] = rows[row]["corrections"] = np.nan
    assert all(line.get_markevery() == [5] for line in drawn("thresholds", collected).axes[0].lines)


def test_reasons_add_up_to_all_points():
    collected = collect()
    heights = [
        collection.get_paths()[0].vertices[:, 1].max() for collection in drawn("reasons", collected).axes[0].collections
    ]
    assert max(heights) == pytest.approx(0.02)


def test_alarms_are_drawn_at_their_frames():
    axes = drawn("alarms", collect()).axes[0]
    wrong = [one for one in axes.collections if one.get_label() == "false alarm"]
    starts = sorted(path.vertices[:, 0].min() for path in wrong[0].get_paths())
    assert starts == [number - 0.5 for number in range(1, FRAMES, 2)]
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["joint", "none"]


def test_the_first_and_the_last_frame_are_as_wide_as_others():
    assert drawn("alarms", collect()).axes[0].get_xlim() == (-0.5, FRAMES - 0.5)


def test_the_legend_of_alarms_lists_only_states_that_occur():
    assert legend_of(drawn("alarms", collect())) == ["correct", "false alarm"]
    assert legend_of(drawn("alarms", collect(frames=1))) == ["correct"]


def test_names_are_shortened_to_24_characters():
    collected = collect()
    names = ["ring_intensity_outlier", "m" * 24, "ring_intensity_outlier_and_more"]
    collected.methods[:] = [replace(collected.methods[0], name=name) for name in names]
    collected.histories.append(collected.histories[1])
    axes = drawn("alarms", collected).axes[0]
    assert [tick.get_text() for tick in axes.get_yticklabels()] == [*names[:2], "ring_intensity_out…_more"]


def test_stages_show_less_and_less():
    panels = drawn("stages", collect()).axes
    counts = [sum(len(line.get_xdata()) for line in axes.lines if line.get_marker() == ".") for axes in panels]
    assert counts[0] >= counts[1] >= counts[2] > 0
    assert [axes.get_title()[:3] for axes in panels] == ["(a)", "(b)", "(c)"]
    assert all(axes.get_aspect() == 1 for axes in panels)


def test_removed_points_do_not_hide_kept_ones():
    lines = {line.get_color(): line for line in drawn("stages", collect()).axes[0].lines if line.get_marker() == "."}
    order, kept = list(lines), palette.REASONS[Reason.KEPT]
    for color in (palette.REASONS[Reason.LOW_INTENSITY], palette.REASONS[Reason.OUTLIER]):
        assert order.index(color) > order.index(kept)
        assert lines[color].get_markersize() < lines[kept].get_markersize()


def test_counts_of_stages_are_of_the_frame():
    collected = collect()
    sample = collected.figure_sample
    titles = [axes.get_title() for axes in drawn("stages", collected).axes]
    assert titles[0] == f"(a) raw: {sample.valid} points"
    assert titles[2] == f"(c) after outlier removal: {np.count_nonzero(sample.reasons[0] == Reason.KEPT)} points"


def test_the_last_stage_of_a_method_that_confirms_is_not_outlier_removal():
    collected = collect()
    collected.figure_sample.reasons[0][-1] = Reason.UNCONFIRMED
    assert drawn("stages", collected).axes[2].get_title().startswith("(c) kept: ")


def test_ahead_is_up_and_port_is_left():
    kept = [one for one in drawn("stages", collect()).axes[0].lines if one.get_color() == palette.REASONS[Reason.KEPT]]
    positions = {(round(x), round(y)) for x, y in zip(kept[0].get_xdata(), kept[0].get_ydata(), strict=True)}
    assert {(0, 30), (-10, 45)} <= positions


def test_two_methods_show_a_false_alarm_each():
    for axes in drawn("methods", collect()).axes:
        assert len([line for line in axes.lines if line.get_fillstyle() == "none" and len(line.get_xdata())]) == 1


def legend_of(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_the_legend_of_methods_lists_only_marks_that_occur():
    assert legend_of(drawn("methods", collect())) == ["kept", "detected target", "false alarm"]
    calm = collect(frames=1)
    assert legend_of(drawn("methods", calm)) == ["kept", "detected target"]
    box = {"class": "ignore", "center": [0, 0, 0], "size": [5, 2, 1], "yaw": 0.0}
    states = ("ignored", "hidden", ["missed", None])
    calm.figure_sample.boxes.extend({**box, "state": state} for state in states)
    names = ["detected target", "missed target", "target not visible", "target not evaluated", "area to ignore"]
    figure = drawn("methods", calm)
    assert legend_of(figure) == ["kept", *names]
    styles = [(line.get_linestyle(), line.get_color()) for line in figure.legends[0].get_lines()[1:]]
    assert len(set(styles)) == len(names)


def test_a_false_alarm_outside_the_axes_is_not_in_the_legend():
    collected = collect(frames=1)
    far = {"kind": "false", "low": [900, 0, 0], "high": [901, 1, 1], "points": 1}
    collected.figure_sample.clusters[0].append(far)
    assert "false alarm" not in legend_of(drawn("methods", collected))
