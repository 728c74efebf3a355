"""What most filters have in common."""

from abc import ABC, abstractmethod
from typing import ClassVar

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


class WholeFrameFilter(BaseFilter, ABC):
    """A filter that removes points from among all valid ones of a frame, for one reason."""

    reason: ClassVar[Reason] = Reason.OUTLIER

    def step(self, frame: Frame) -> FilterResult:
        """Return a reason for every point of a frame."""
        reason = np.where(frame.valid, Reason.KEPT, Reason.INVALID).astype(np.uint8)
        reason[self.removed(frame)] = self.reason
        return FilterResult(frame, reason)

    @abstractmethod
    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the valid points that go."""


class SpatialFilter(WholeFrameFilter):
    """A filter that looks at the places of all valid points of a frame; intensity plays no part."""

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the outliers."""
        valid, points = valid_points(frame)
        return valid[self.outlying(points)]

    @abstractmethod
    def outlying(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which of some points, shape (N, 3), are outliers."""


def valid_points(frame: Frame) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the indices of a frame's valid points, shape (N,), and their places, shape (N, 3)."""
    valid = np.flatnonzero(frame.valid)
    return valid, np.ascontiguousarray(frame.coordinates[:, valid].T)
