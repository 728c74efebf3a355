"""Figures of tiles and confusion matrices: content, reproducible bytes, minimal input."""

import numpy as np
import pytest

from seaclutter_cli.plots.tiles import COLORS, LEFT_OUT, draw_confusion, draw_tile
from seaclutter_cli.truth import OBJECT_CLASSES

pytest.importorskip("matplotlib")


def tile(sea, points, boxes):
    from seaclutter_cli.plots.figure import render

    return render(lambda figure: draw_tile(figure, sea, points, boxes), ".png", aspect=0.92)


def test_every_class_has_its_own_colour():
    assert set(COLORS) == set(OBJECT_CLASSES)
    assert len(set(COLORS.values())) == len(COLORS)


def test_points_left_out_are_grey():
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure

    figure = Figure()
    draw_tile(figure, np.zeros((2, 3)), {"ship": np.ones((2, 4)), LEFT_OUT: np.full((2, 5), 7.0)}, [])
    drawn = {len(c.get_offsets()): c.get_facecolor()[0] for c in figure.axes[0].collections}
    assert len(set(drawn[5][:3])) == 1
    assert tuple(drawn[4][:3]) == to_rgb(COLORS["ship"])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["ship", "left out"]


def test_a_tile_is_drawn_the_same_each_time():
    rng = np.random.default_rng(0)
    sea, ship = rng.uniform(0, 100, (2, 500)) + 5e5, rng.uniform(40, 50, (2, 80)) + 5e5
    corners = np.array([[40, 40], [50, 40], [50, 50], [40, 50]]) + 5e5
    one, other, bare = (tile(sea, {"ship": ship}, boxes) for boxes in ([("ship", corners)], [("ship", corners)], []))
    assert one == other != bare


def test_boxes_are_as_large_as_reported():
    from matplotlib.figure import Figure

    figure = Figure()
    corners = np.array([[40.0, 40], [55.5, 40], [55.5, 44.7], [40, 44.7]])
    draw_tile(figure, np.array([[10.0, 90], [20, 80]]), {"ship": corners.T}, [("ship", corners)])
    (line,) = figure.axes[0].lines
    np.testing.assert_allclose(line.get_xydata(), np.vstack((corners, corners[:1])) - [10, 20])


def test_a_tile_without_objects():
    assert tile(np.zeros((2, 3)), {}, []).startswith(b"\x89PNG")


def test_confusion():
    from seaclutter_cli.plots.figure import render

    matrix = np.array([[5, 1], [0, 0]])
    one, other = (render(lambda figure, m=m: draw_confusion(figure, ["a", "b"], m), ".svg") for m in (matrix, matrix.T))
    assert one != other
