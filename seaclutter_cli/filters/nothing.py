"""Filter that removes nothing: the unfiltered log as a baseline."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from seaclutter_cli.filters.base import BaseFilter
from seaclutter_cli.frame import FilterResult, Frame


@dataclass(frozen=True, kw_only=True)
class NothingParams:
    """Empty parameters: the method has no config keys."""


class Nothing(BaseFilter):
    """No filtering: every point is kept, invalid ones too.

    Parameters
    ----------
    params : NothingParams
        Empty.
    """

    Params: ClassVar[type[NothingParams]] = NothingParams

    def __init__(self, params: NothingParams) -> None:
        self.params = params

    def step(self, frame: Frame) -> FilterResult:
        """Return `Reason.KEPT` for every point of a frame."""
        return FilterResult(frame, np.zeros(frame.size, np.uint8))
