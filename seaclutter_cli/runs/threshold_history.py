"""Thresholds of a range ring over the frames of a recording, for several variants, and the ideal threshold."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import UsageError
from seaclutter_cli.evaluation.matching import point_truth
from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.evaluation.tuning import ideal_threshold
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.plots.curves import draw_thresholds
from seaclutter_cli.plots.figure import render
from seaclutter_cli.runs.methods import Variant
from seaclutter_cli.text import count
from seaclutter_cli.truth import Truth


class ThresholdHistory:
    """Listener that stores the threshold of each frame and variant ([Li2023], Fig. 7).

    Parameters
    ----------
    variants : sequence of Variant
        Methods with range rings; V variants.
    ring : int
        Number of the range ring, from 1.

    Raises
    ------
    UsageError
        If a variant has no such range ring.
    """

    def __init__(self, variants: Sequence[Variant], ring: int) -> None:
        for variant in variants:
            rings = max(len(variant.config.ring_edges) - 1, 0)
            if ring > rings:
                raise UsageError(f"--ring {ring}: {variant.name} has {count(rings, 'range ring')}")
        self._variants, self._ring = variants, ring - 1
        self._evaluation = variants[0].config.evaluation
        self._edges = variants[0].config.ring_edges[ring - 1 : ring + 1]
        self._rows: list[list[float]] = []

    def begin(self, recording: str) -> None:
        """Start a recording; its frames follow those of the previous one."""

    def add_frame(
        self,
        frame: Frame,
        results: Sequence[FilterResult | None],
        truth: Truth | None,
        scores: Sequence[FrameScore | None],  # noqa: ARG002 - scores are not needed
    ) -> None:
        """Store the thresholds of a frame, and find the ideal one."""
        ideal = None
        if truth is not None:
            start_m, end_m = self._edges
            inside = frame.valid & (frame.range_m >= start_m) & (frame.range_m < end_m)
            points = point_truth(frame, truth, self._evaluation)
            ideal = ideal_threshold(frame.intensity[inside], points[inside])
        used = [_threshold(result, self._ring) for result in results]
        self._rows.append([np.nan if ideal is None else ideal, *used])

    @property
    def table(self) -> NDArray[np.float64]:
        """Ideal threshold and those of the variants, shape (F, 1 + V) for F frames; NaN if there is no threshold."""
        return np.array(self._rows, np.float64).reshape(-1, 1 + len(self._variants))

    def plot(self, suffix: str) -> bytes:
        """Return the content of the plot file; ``suffix`` is ``.png`` or ``.svg``."""
        ideal, *curves = self.table.T
        start_m, end_m = self._edges
        names = [variant.name for variant in self._variants]
        keys = {name.partition("=")[0] for name in names}
        title = keys.pop() if len(keys) == 1 and not any(" " in name for name in names) else None
        named = dict(zip((name.removeprefix(f"{title}=") for name in names), curves, strict=True))
        ring = f"{start_m:g} to {end_m:g} m"
        return render(lambda figure: draw_thresholds(figure, ring, named, ideal, title=title), suffix)


def _threshold(result: FilterResult | None, ring: int) -> float:
    return np.nan if result is None or result.rings is None else float(result.rings.thresholds[ring])
