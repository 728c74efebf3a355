"""Labelled objects, options of the readers, and the truth of a frame that they become."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from seaclutter_cli.errors import LabelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.text import printable
from seaclutter_cli.truth import Boxes, Truth

IGNORE = "ignore"
MAX_OBJECTS = 10_000
"""Maximum number of labelled objects and areas in a frame."""


class Labelled(NamedTuple):
    """Labelled object or area; in metres and radians, with sizes along the axes x, y and z of the box.

    It is ``proposed`` if the program labelled it and nobody corrected it.
    """

    track: str
    kind: str
    center: tuple[float, float, float]
    size: tuple[float, float, float]
    yaw: float
    proposed: bool = False


class Proposal(NamedTuple):
    """Labelled object of a frame as the program proposes it; ``mark`` says whether it is ``sure`` or ``doubtful``."""

    frame: int
    labelled: Labelled
    score: float
    mark: str


def checked(labelled: Labelled) -> Labelled:
    """Return a labelled object; `LabelError` if a size is negative."""
    negative = [size for size in labelled.size if size < 0]
    if negative:
        raise LabelError(f"box size must not be negative, got {negative[0]:g} m")
    return labelled


def truth_of(objects: Sequence[Labelled]) -> Truth:
    """Return the truth of a frame: areas of class ``ignore``, and targets; `LabelError` above `MAX_OBJECTS`."""
    if len(objects) > MAX_OBJECTS:
        raise LabelError(f"{len(objects):,} labels in one frame, more than {MAX_OBJECTS:,}")
    ignored = [labelled for labelled in objects if labelled.kind.lower() == IGNORE]
    targets = [labelled for labelled in objects if labelled.kind.lower() != IGNORE]
    return Truth(_boxes(targets), _boxes(ignored), proposed=sum(labelled.proposed for labelled in objects))


def _boxes(objects: Sequence[Labelled]) -> Boxes:
    return Boxes(
        _distinct([printable(labelled.track) for labelled in objects]),
        tuple(printable(labelled.kind) for labelled in objects),
        np.array([labelled.center for labelled in objects], np.float64).reshape(-1, 3),
        np.array([labelled.size for labelled in objects], np.float64).reshape(-1, 3),
        np.array([labelled.yaw for labelled in objects], np.float64),
    )


def _distinct(tracks: Sequence[str]) -> tuple[str, ...]:
    """Return unique tracks: objects with no track, or with one already used in the frame, get a new one."""
    names: dict[str, None] = {}
    given = set(tracks)
    for number, track in enumerate(tracks):
        name = track or f"#{number}"
        while name in names or (name != track and name in given):
            name += f"#{number}"
        names[name] = None
    return tuple(names)


@dataclass(frozen=True, kw_only=True)
class LabelOptions:
    """Settings of the label readers: classes of per-point labels that are clutter, or else neither that nor targets.

    If ``by_sequence``, a frame's number is the ``sequence`` of its message, not its ``index``, as folders of frames
    need: a damaged file is left out of the stream but keeps its number.
    """

    clutter_ids: tuple[int, ...] = (110,)
    ignore_ids: tuple[int, ...] = (0, 99)
    by_sequence: bool = False

    def number(self, frame: Frame) -> int:
        """Return the number of a frame in the labels, from 0."""
        return frame.message.sequence if self.by_sequence and frame.message else frame.index
