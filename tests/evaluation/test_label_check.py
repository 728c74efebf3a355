"""Mistakes in labels are named, and honest labels give no finding."""

import re

import numpy as np
import pytest

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.label_check import LabelCheck
from seaclutter_cli.evaluation.matching import targets_of
from seaclutter_cli.frame import Frame
from tests.evaluation.harbours import BOATS, CLASSES, harbour

PARAMS = EvaluationParams()


def findings(change=lambda rows: rows, classes=CLASSES, frames=6, params=PARAMS):
    check = LabelCheck(params)
    targets = visible = 0
    for number in range(frames):
        frame, truth = harbour(number, change, classes)
        check.add(frame, truth)
        scene = targets_of(frame, truth, params)
        targets, visible = targets + len(scene.visible), visible + int(scene.visible.sum())
    return [finding.text for finding in check.findings(targets, visible)]


def columns(*numbers):
    """Return a function that puts other columns of the rows in the place of the first ones."""
    return lambda rows: rows[:, [*numbers, *range(len(numbers), 7)]]


def changed(column, function):
    def change(rows):
        rows[:, column] = function(rows[:, column])
        return rows

    return change


def first(*changes):
    def change(rows):
        for one in changes:
            rows = one(rows)
        return rows

    return change


SWAPPED_SIZES = columns(0, 1, 2, 4, 3)
SHIFTED = changed(2, lambda z: z + 50)
DEGREES = changed(6, np.degrees)

MISTAKES = {
    "degrees": (DEGREES, "exceed 2 pi; they seem to be in degrees"),
    "clockwise": (changed(6, np.negative), "yaws count clockwise"),
    "compass": (changed(6, lambda yaw: np.pi / 2 - yaw), "yaws count clockwise from y"),
    "length and width": (SWAPPED_SIZES, "lengths and widths are swapped"),
    "x and y": (columns(1, 0), "x and y are swapped"),
    "left-handed": (first(changed(1, np.negative), changed(6, np.negative)), "y has the opposite sign"),
    "centimetres": (changed(slice(0, 6), lambda all_m: 100 * all_m), "positions and sizes are in centimetres"),
    "millimetres": (changed(slice(0, 6), lambda all_m: 1000 * all_m), "positions and sizes are in millimetres"),
    "sizes in centimetres": (changed(slice(3, 6), lambda sizes: 100 * sizes), "sizes are in centimetres"),
    "half sizes": (changed(slice(3, 6), lambda sizes: sizes / 2), "sizes are half sizes"),
    "z": (SHIFTED, "positions are off by about .(49.5|50) m in z: add -"),
    "x and z": (
        changed([0, 2], lambda xz: xz + np.array([3, 2])),
        "off by about .3 m in x and .(1.5|2|2.5) m in z",
    ),
    "large": (changed([3, 4], lambda sizes: 4 * sizes), "boxes seem too large"),
    "a side of 0": (changed(5, lambda height: 0 * height), "have a side of 0 m"),
    "another recording": (changed(0, lambda x: x + 500), "none of 24 boxes with at least 5 points inside"),
    "duplicates": (lambda rows: rows[[0, 1, 2, 0]], "6 of 24 boxes repeat another .*twice .frame 0, 1, 2 and 3 more"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(name):
    change, expected = MISTAKES[name]
    found = findings(change)
    assert re.search(expected, found[0])
    assert len(found) == 1


@pytest.mark.parametrize(("margin_m", "number"), [(0.5, 1), (15.0, 0)])
def test_positions_are_fine_with_a_margin_of_their_own(margin_m, number):
    texts = findings(changed(slice(3, 6), lambda sizes: 0 * sizes), params=EvaluationParams(box_margin_m=margin_m))
    about_size = [text for text in texts if "a side of 0 m" in text]
    assert len(about_size) == number
    assert all("or for positions alone a larger evaluation.box_margin_m" in text for text in about_size)


def test_a_box_that_no_target_can_have():
    def long(rows):
        rows[3, 3] = 600
        return rows

    assert "6 of 24 boxes have a side of more than 500 m: check the unit" in findings(long)


@pytest.mark.parametrize(("kind", "name"), [("ignored", "ignore"), ("DontCare", "ignore"), ("Empty", "none")])
def test_a_class_that_is_almost_one_with_a_meaning(kind, name):
    (found,) = findings(classes=(*CLASSES[:3], kind))
    assert f"6 of 24 boxes have the class '{kind}' and count as targets" in found
    assert f"have the class '{name}': rename it" in found


def test_three_mistakes_at_once():
    found = findings(first(SWAPPED_SIZES, DEGREES, SHIFTED))
    for part in ("degrees", "(49.5|50) m in z", "lengths and widths"):
        assert any(re.search(part, text) for text in found), part


@pytest.mark.parametrize("factor", [0.9, 1.1, 1.25])
@pytest.mark.parametrize("margin_m", [-0.1, 0, 0.4])
def test_slightly_loose_and_tight_boxes_are_fine(factor, margin_m):
    assert findings(changed(slice(3, 6), lambda sizes: factor * sizes + margin_m)) == []


def test_inaccurate_boxes_are_fine():
    random = np.random.default_rng(5)
    rough = random.normal(0, [0.2, 0.2, 0.15, 0.3, 0.2, 0.2, 0.05], BOATS.shape)
    assert findings(lambda rows: rows + rough) == []


def test_few_boxes_and_none_are_no_evidence():
    assert findings(SWAPPED_SIZES, frames=1) == []
    assert findings(frames=0) == []


def test_memory_is_bounded(monkeypatch):
    """Of many frames, some are kept, evenly spaced."""
    check = LabelCheck(PARAMS)
    frame, truth = harbour(0)
    for number in range(100):
        check.add(Frame(frame.cloud, index=number), truth)
    assert 6 <= len(check._sample.frames) <= 12
    assert check.boxes == 400
