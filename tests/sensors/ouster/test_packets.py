"""Damaged frame ids among those of revolutions, with losses and late packets."""

import pytest

from seaclutter_cli.sensors.ouster.decoder import _is_damaged


@pytest.mark.parametrize(
    ("before", "place", "after", "expected"),
    [
        (7.3, 8.0, 8.1, False),
        (7.0, 8.0, 9.0, False),
        (7.0, 9.0, 12.0, False),
        (65535.3, 0.0, 0.1, False),
        (6.3, 7.0, 6.1, False),
        (7.1, 300.2, 7.3, True),
        (7.3, 300.0, 8.1, True),
        (7.2, 300.3, 8.0, True),
        (65535.3, 300.0, 0.1, True),
        (8.0, 7.1, 8.2, True),
        (8.0, 9.1, 8.2, True),
        (7.2, 8.0, 7.3, True),
        (7.0, 300.1, 301.2, False),
    ],
)
def test_ids(before, place, after, expected):
    """A place is a frame id and a number in its revolution of four packets."""
    before, place, after = (int(value) * 4 + round(value % 1 * 10) for value in (before, place, after))
    assert _is_damaged(place, after, before=before, per_revolution=4) == expected
