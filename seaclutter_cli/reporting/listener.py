"""Interfaces for listeners, which receive every frame that is filtered and scored or read back from a filtered log."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Protocol

from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.reporting.history import Numbers
from seaclutter_cli.truth import Truth


class FrameListener(Protocol):
    """A listener for the frames of an evaluation."""

    def begin(self, recording: str) -> None:
        """Start a recording."""
        ...

    def add_frame(
        self,
        frame: Frame,
        results: Sequence[FilterResult | None],
        truth: Truth | None,
        scores: Sequence[FrameScore | None],
    ) -> None:
        """Take a frame, the result of each method, the ground truth, and the score of each method."""
        ...


class ReplayListener(ABC):
    """A listener for the frames of an evaluation or of filtered logs; it gets the reasons of points only on request."""

    @abstractmethod
    def begin(self, recording: str) -> None:
        """Start a recording."""

    def expect(self, frames: int) -> None:  # noqa: B027 - optional for subclasses
        """Take the approximate number of frames, before the first of them."""

    def add_frame(
        self,
        frame: Frame,
        results: Sequence[FilterResult | None],
        truth: Truth | None,
        scores: Sequence[FrameScore | None],
    ) -> None:
        """Take a frame, the result of each method, the ground truth, and the score of each method."""
        self.add(frame, [Numbers.of(result) for result in results], truth, scores, lambda: results)

    @abstractmethod
    def add(
        self,
        frame: Frame,
        numbers: Sequence[Numbers | None],
        truth: Truth | None,
        scores: Sequence[FrameScore | None],
        results: Callable[[], Sequence[FilterResult | None]],
    ) -> None:
        """Take the statistics of a frame; ``results``, which may be slow, returns the result of each method."""
