"""Frames of lidars that are not mounted level."""

from dataclasses import replace

from seaclutter_cli.frame import Frame
from seaclutter_cli.water import Mounting


def levelled(frame: Frame, mounting: Mounting) -> Frame:
    """Return a frame with its points in the levelled frame; the same frame if the mounting is level.

    Ranges and validity are those of the given frame: a rotation changes neither.
    """
    if mounting.is_level:
        return frame
    result = replace(frame)
    vars(result).update(coordinates=mounting.levelled(frame.coordinates), range_m=frame.range_m, valid=frame.valid)
    return result
