"""What most filters have in common."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.frame import FilterResult, Frame, Reason


class BaseFilter:
    """A filter without state that needs no first pass; subclasses add ``Params`` and ``step``."""

    needs_first_pass = False

    def observe(self, frame: Frame) -> None:
        """Ignore the frame."""

    def reset(self) -> None:
        """Have nothing to forget."""


class SpatialFilter(BaseFilter, ABC):
    """A filter that looks at the places of all valid points of a frame; intensity plays no part."""

    def step(self, frame: Frame) -> FilterResult:
        """Return a reason for every point of a frame."""
        reason = np.full(frame.size, Reason.INVALID, np.uint8)
        valid = np.flatnonzero(frame.valid)
        points = np.ascontiguousarray(frame.xyz[:, valid].T)
        reason[valid] = np.where(self.outlying(points), Reason.OUTLIER, Reason.KEPT)
        return FilterResult(frame, reason)

    @abstractmethod
    def outlying(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which of some points, shape (N, 3), are outliers."""
