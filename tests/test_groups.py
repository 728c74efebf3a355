"""Groups of equal numbers, against `numpy.unique`."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.arrays import group_sizes, group_starts


@given(st.lists(st.integers(-3, 3)))
def test_groups_are_those_of_unique(numbers: list[int]) -> None:
    ordered = np.sort(np.array(numbers, np.int64))
    _, starts, sizes = np.unique(ordered, return_index=True, return_counts=True)
    found = group_starts(ordered)
    assert found.tolist() == starts.tolist()
    assert group_sizes(found, len(ordered)).tolist() == sizes.tolist()
