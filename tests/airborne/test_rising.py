"""What rises out of rough water."""

import numpy as np
import pytest

from seaclutter_cli.airborne.following import FollowedSurface
from seaclutter_cli.airborne.rising import _are_objects


@pytest.mark.parametrize(
    ("crests", "certain", "contrast", "expected"),
    [(40, 0, 3.0, False), (40, 3, 3.0, False), (10, 0, 3.0, True), (40, 8, 3.0, True), (40, 3, 1.5, True)],
    ids=["foam", "its highest cells", "not on a crest", "a boat on a crest", "dark"],
)
def test_bright_groups_on_crests_are_foam(crests, certain, contrast, expected):
    shape = (1, 10, 8)
    group = np.zeros(shape, np.int32)
    group.reshape(-1)[:40] = 1
    first = np.arange(80).reshape(shape)
    none = np.zeros(shape)
    sea = FollowedSurface(none, none, none, np.full(shape, contrast), none > 0, first < crests)
    found = _are_objects(group, group > 0, first < certain, sea, np.full(shape, 3.0), 1.0)
    np.testing.assert_array_equal(found, [False, expected])
