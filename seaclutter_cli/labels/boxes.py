"""Labelled objects, one by one, made into the truth of a frame."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from seaclutter_cli.errors import LabelError
from seaclutter_cli.text import printable
from seaclutter_cli.truth import Boxes, Truth

IGNORE = "ignore"


class Labelled(NamedTuple):
    """One labelled object or area; metres and radians, sizes along the box's own x, y and z."""

    track: str
    kind: str
    center: tuple[float, float, float]
    size: tuple[float, float, float]
    yaw: float


def checked(labelled: Labelled) -> Labelled:
    """Return an object whose sizes are possible.

    Raises
    ------
    LabelError
        If one is negative.
    """
    negative = [size for size in labelled.size if size < 0]
    if negative:
        raise LabelError(f"a size of {negative[0]:g} m is none")
    return labelled


def truth_of(objects: Sequence[Labelled]) -> Truth:
    """Return the truth of a frame: objects of class ``ignore`` are areas to ignore, all others targets."""
    ignored = [labelled for labelled in objects if labelled.kind.lower() == IGNORE]
    targets = [labelled for labelled in objects if labelled.kind.lower() != IGNORE]
    return Truth(_boxes(targets), _boxes(ignored))


def _boxes(objects: Sequence[Labelled]) -> Boxes:
    return Boxes(
        _distinct([printable(labelled.track) for labelled in objects]),
        tuple(printable(labelled.kind) for labelled in objects),
        np.array([labelled.center for labelled in objects], np.float64).reshape(-1, 3),
        np.array([labelled.size for labelled in objects], np.float64).reshape(-1, 3),
        np.array([labelled.yaw for labelled in objects], np.float64),
    )


def _distinct(tracks: Sequence[str]) -> tuple[str, ...]:
    """Give objects without a track, or with one that is taken in this frame, one of their own."""
    names: dict[str, None] = {}
    for number, track in enumerate(tracks):
        name = track or f"#{number}"
        while name in names or (name != track and name in tracks):
            name += f"#{number}"
        names[name] = None
    return tuple(names)
