"""Who looks on while frames are filtered or read back."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.reporting.history import Numbers
from seaclutter_cli.truth import Truth


class Audience(ABC):
    """Is told of every frame, and of the reasons of its points if it asks."""

    def expect(self, frames: int) -> None:  # noqa: B027 - not all need to know
        """Hear before the first frame of all how many there will be, about."""

    def see(
        self,
        frame: Frame,
        results: Sequence[FilterResult | None],
        truth: Truth | None,
        scores: Sequence[FrameScore | None],
    ) -> None:
        """Take a frame, what each method made of it, its truth, and how each method did."""
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
        """Take the numbers of a frame; ``results``, which may cost time, returns the reasons of its points."""
