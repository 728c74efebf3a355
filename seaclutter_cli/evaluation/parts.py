"""Scores of a recording in consecutive parts, so that its end can be held out."""

from collections.abc import Sequence

from seaclutter_cli.evaluation.scores import FrameScore, Summary

_MAX_PARTS = 64


class Parts:
    """Scores of several methods in consecutive parts of a recording, in bounded memory.

    All parts but the last have the same number of labelled frames: one, until there are 64 parts; then every two
    parts are joined.

    Parameters
    ----------
    methods : int
        Number of methods.
    """

    def __init__(self, methods: int) -> None:
        self._methods = methods
        self._parts: list[list[Summary]] = []
        self._part_frames, self._frames_in_last = 1, 1

    def add(self, scores: Sequence[FrameScore | None]) -> None:
        """Add a labelled frame: the score of each method, None for a method that could not use it."""
        if self._frames_in_last == self._part_frames or not self._parts:
            self._start_part()
        self._frames_in_last += 1
        for summary, score in zip(self._parts[-1], scores, strict=True):
            if score is not None:
                summary.add(score, None)

    def _start_part(self) -> None:
        if len(self._parts) == _MAX_PARTS:
            self._parts = [self._sums(self._parts[k : k + 2]) for k in range(0, _MAX_PARTS, 2)]
            self._part_frames *= 2
        self._parts.append(self._sums([]))
        self._frames_in_last = 0

    def split(self, share: float) -> tuple[list[Summary], list[Summary]]:
        """Return the sums of the frames before the end, and of those at the end, for each method.

        Parameters
        ----------
        share : float
            Share of the frames at the end, from 0 to 1. Between them, both sums have a frame if there are two.
        """
        end = round(share * len(self._parts))
        if 0 < share < 1:
            end = min(max(end, 1), len(self._parts) - 1)
        first = len(self._parts) - end
        return self._sums(self._parts[:first]), self._sums(self._parts[first:])

    def _sums(self, parts: Sequence[Sequence[Summary]]) -> list[Summary]:
        sums = [Summary() for _ in range(self._methods)]
        for part in parts:
            for total, summary in zip(sums, part, strict=True):
                total.update(summary)
        return sums
