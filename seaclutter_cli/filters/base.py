"""Base class and helpers of the filters."""

from abc import abstractmethod
from typing import ClassVar, Generic, TypeVar

import numpy as np

from seaclutter_cli.arrays import Floats, Indices
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.interfaces import Filter

P = TypeVar("P")

ROUNDING = 1e-9
"""Relative difference below which distances are equal; prevents outliers by rounding error in even spacing."""


class WholeFrameFilter(Filter, Generic[P]):
    """Base of filters that remove valid points of a frame for a single reason."""

    params: P
    reason: ClassVar[Reason] = Reason.OUTLIER

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame."""
        reason = np.where(frame.valid, Reason.KEPT, Reason.INVALID).astype(np.uint8)
        reason[self.removed(frame)] = self.reason
        return FilterResult(frame, reason)

    @abstractmethod
    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the valid points to remove."""


def valid_points(frame: Frame) -> tuple[Indices, Floats]:
    """Return the indices of a frame's valid points, shape (N,), and their coordinates, shape (N, 3)."""
    valid = np.flatnonzero(frame.valid)
    return valid, np.ascontiguousarray(frame.coordinates[:, valid].T)
