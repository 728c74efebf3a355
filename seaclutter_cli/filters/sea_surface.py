"""Removal of the sea surface by morphological opening, frame by frame, for downward-looking lidars."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from seaclutter_cli.arrays import Indices
from seaclutter_cli.errors import FieldError, InputError
from seaclutter_cli.filters.base import WholeFrameFilter, valid_points
from seaclutter_cli.frame import Frame
from seaclutter_cli.grids.opening import SurfaceParams, heights_above_opening
from seaclutter_cli.params import key

_AXES = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}


@dataclass(frozen=True, kw_only=True)
class SeaSurfaceParams(SurfaceParams):
    """Parameters of the sea surface filter."""

    up: Literal["x", "y", "z", "-x", "-y", "-z"] = key("z", "Axis of the cloud that points up: x, y, z, -x, -y or -z.")


class SeaSurface(WholeFrameFilter[SeaSurfaceParams]):
    """Sea surface removal by morphological opening [Shi2022].

    This filter is for downward-looking lidars.

    Notes
    -----
    Points that are at most ``height_m`` above the opened surface are removed as outliers. `heights_above_opening`
    describes the treatment of waves, edges and empty cells. Islands wider than the window are removed with the sea,
    because the sea level can rarely be estimated from a single frame.

    References
    ----------
    .. [1] Shi Liang, Xing Junxin, Cai Yanjing (2022). "Classification of ship LIDAR point cloud data based on machine
       learning algorithm". Ship Science and Technology 44(17), 140-143. doi:10.3404/j.issn.1672-7649.2022.17.028
    """

    Params: ClassVar[type[SeaSurfaceParams]] = SeaSurfaceParams
    needs_height = True

    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the sea surface points."""
        valid, points = valid_points(frame)
        if not len(valid):
            return valid
        xyz = points.T[list(_AXES[self.params.up[-1]])]
        if self.params.up.startswith("-"):
            xyz = np.stack((xyz[0], xyz[1], -xyz[2]))
        try:
            height = heights_above_opening(xyz, self.params)
        except InputError as error:
            raise FieldError(str(error)) from error
        return valid[~(height > self.params.height_m)]
