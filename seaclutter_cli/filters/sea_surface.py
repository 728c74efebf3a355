"""The sea surface by morphological opening, frame by frame, for a lidar that looks down."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.surface import SurfaceParams, surface_of
from seaclutter_cli.errors import FieldError, InputError
from seaclutter_cli.filters.base import WholeFrameFilter, valid_points
from seaclutter_cli.frame import Frame

_AXES = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}


@dataclass(frozen=True, kw_only=True)
class SeaSurfaceParams(SurfaceParams):
    """Removal of the sea surface.

    Parameters
    ----------
    up : str
        Axis of the cloud that points upwards: x, y, z, or one of them reversed, as -x.
    """

    up: Literal["x", "y", "z", "-x", "-y", "-z"] = "z"


class SeaSurface(WholeFrameFilter):
    """Sea surface by morphological opening, for a lidar that looks down (S1).

    Parameters
    ----------
    params : SeaSurfaceParams
        Config keys of the method.

    Notes
    -----
    What is not more than ``height_m`` above the opened surface goes, as an outlier. See `Surface` for how waves, edges
    and empty cells are treated. Islands wider than the window go with the sea: one frame seldom tells its level.
    """

    Params: ClassVar[type[SeaSurfaceParams]] = SeaSurfaceParams

    def __init__(self, params: SeaSurfaceParams) -> None:
        self.params = params

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the points of the sea."""
        valid, points = valid_points(frame)
        if not len(valid):
            return valid
        xyz = points.T[list(_AXES[self.params.up[-1]])]
        if self.params.up.startswith("-"):
            xyz = np.stack((xyz[0], xyz[1], -xyz[2]))
        try:
            height = surface_of(xyz, self.params).height(xyz)
        except InputError as error:
            raise FieldError(str(error)) from error
        return valid[~(height > self.params.height_m)]
