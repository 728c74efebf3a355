"""Plausible sizes of targets by their class."""

from collections.abc import Iterator, Mapping

import numpy as np

from seaclutter_cli.evaluation.labelling.fit import LARGEST_M
from seaclutter_cli.truth import Boxes

_LONGEST_M: Mapping[str, float] = {
    "buoy": 20,
    "person": 4,
    "swimmer": 4,
    "kayak": 15,
    "canoe": 20,
    "dinghy": 15,
    "boat": 150,
    "yacht": 200,
}
"""Length that no target exceeds whose class contains a word; generous, because boxes may include wake and moorings."""


def too_long(boxes: Boxes) -> Iterator[tuple[str, float]]:
    """Yield class and longest side in metres of each box that is longer than any target of its class."""
    for kind, longest_m in zip(boxes.classes, boxes.sizes.max(axis=1, initial=0), strict=True):
        if longest_m > limit_m(kind):
            yield kind, float(longest_m)


def limit_m(kind: str) -> float:
    """Return the length that no target of a class exceeds, in metres.

    Examples
    --------
    >>> limit_m("Sailing boat"), limit_m("tanker")
    (150, 500.0)
    """
    return next((limit for word, limit in _LONGEST_M.items() if word in kind.lower()), LARGEST_M)


def without_size(boxes: Boxes) -> int:
    """Return the number of boxes with a side of 0."""
    return int(np.count_nonzero((boxes.sizes <= 0).any(axis=1)))
