"""The filter that removes nothing: the log as it is, beside which others are judged."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from seaclutter_cli.filters.base import BaseFilter
from seaclutter_cli.frame import FilterResult, Frame


@dataclass(frozen=True, kw_only=True)
class NothingParams:
    """No config keys."""


class Nothing(BaseFilter):
    """Keep every point, invalid ones too.

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
