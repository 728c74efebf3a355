"""What the water shows at the range of a point in other directions: echoes, and rows of them."""

import numpy as np
import pytest

from seaclutter_cli.filters.confirmation.background import Background


def row(bearing_deg, count, distance_m=20.0):
    """Return the coordinates of a row of echoes, shape (3, N), and the number of echoes in the row of each."""
    bearing = np.radians(bearing_deg + np.arange(count) * 0.1)
    return distance_m * np.array([np.cos(bearing), np.sin(bearing), 0 * bearing]), np.full(count, count, np.int32)


def shares(rows, frames=1):
    """Return the shares at the first echo of the first row, in the last of several equal frames."""
    xyz, run = (np.concatenate(parts, axis=-1) for parts in zip(*rows, strict=True))
    background, water = Background(), np.ones(len(run), np.bool_)
    for frame in range(frames):
        around, in_rows = background.shares(xyz, run, water, frame / 10)
    return around[0], in_rows[0]


def test_a_row_is_alone_among_single_echoes_all_around():
    singles = [row(bearing, 1) for bearing in np.arange(2.5, 360, 5)]
    assert shares([row(1, 40), *singles]) == (1, 0)


@pytest.mark.parametrize(("count", "expected"), [(31, 0), (32, 1), (40, 1), (49, 1)])
def test_rows_count_that_are_as_long_by_octaves(count, expected):
    others = [row(bearing, count) for bearing in np.arange(20.5, 345, 5)]
    around, in_rows = shares([row(1, 40), *others])
    assert around > 0.9
    assert (in_rows > 0.9) == expected
    assert in_rows == (around if expected else 0)


def test_rows_at_other_ranges_do_not_count():
    assert shares([row(1, 40), *(row(bearing, 40, 35.0) for bearing in np.arange(20.5, 345, 5))]) == (0, 0)


def test_what_was_seen_is_forgotten():
    others = [row(bearing, 40) for bearing in np.arange(20.5, 345, 5)]
    background, (xyz, run) = Background(), (np.concatenate(parts, axis=-1) for parts in zip(*others, strict=True))
    background.shares(xyz, run, np.ones(len(run), np.bool_), 0.0)
    one, length = row(1, 40)
    _, in_rows = background.shares(one, length, np.zeros(40, np.bool_), 6.0)
    assert in_rows[0] == pytest.approx(np.exp(-1), abs=0.05)
