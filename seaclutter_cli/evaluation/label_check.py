"""Check of the labels of a recording against its points."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.label_fit import DEGREES, LARGEST_M, FrameSample, LabelFit
from seaclutter_cli.frame import Frame
from seaclutter_cli.text import count, listed, printable
from seaclutter_cli.truth import Truth

_FEW = 0.1
_MIN_BOXES = 5
_MOST = 0.85
_FULL_TURN = 2 * np.pi + 0.01
_SAME_M = 1e-3
_MEANINGS = {
    "ignore": ("areas to ignore", re.compile("ignor|dontcare")),
    "none": ("frames without a target", re.compile("(empty|nothing|no(object|target|label)s?|null|nan)$")),
}
"""Classes with a meaning, and what names are probably meant to be them."""


@dataclass(frozen=True)
class Finding:
    """A probable mistake in labels: its kind, for programs, and what was found, what it may mean, and what to do."""

    kind: str
    text: str


class LabelCheck:
    """Check of the labels of a recording, frame by frame, in bounded memory."""

    def __init__(self, params: EvaluationParams) -> None:
        self.params, self.boxes = params, 0
        self._over_full_turn = self._without_size = self._positions = self._too_long = 0
        self._duplicates, self._classes = Counter[int](), Counter[str]()
        self._sample = FrameSample(params.box_margin_m)

    def add(self, frame: Frame, truth: Truth) -> None:
        """Check the boxes of a frame; frames with labels of points only have none."""
        if not (boxes := truth.targets):
            return
        self.boxes += len(boxes)
        self._classes.update(boxes.classes)
        self._over_full_turn += int(np.count_nonzero(np.abs(boxes.yaws) > _FULL_TURN))
        self._without_size += int(np.count_nonzero((boxes.sizes <= 0).any(axis=1)))
        self._positions += int(np.count_nonzero((boxes.sizes == 0).all(axis=1)))
        rows = np.round(np.column_stack([boxes.centers, boxes.sizes]) / _SAME_M)
        if same := len(rows) - len(np.unique(rows, axis=0)):
            self._duplicates[frame.index] = same
        self._too_long += int(np.count_nonzero((boxes.sizes > LARGEST_M).any(axis=1)))
        others = np.array([not _resembles(kind, "ignore") for kind in boxes.classes])
        self._sample.offer(frame, replace(truth, targets=boxes.chosen(np.flatnonzero(others))))

    def findings(self, targets: int, visible: int) -> list[Finding]:
        """Return the probable mistakes, given the number of targets in all frames, and of those with enough points."""
        fitted = list(self._fitted())
        found = [*self._class_names(), *self._counted(), *fitted]
        if self._too_long and not any("sizes" in finding.text for finding in fitted):
            text = f"{self._of(self._too_long)} have a side of more than {LARGEST_M:g} m: check the unit"
            found.append(Finding("size", text))
        if not fitted and targets >= _MIN_BOXES and visible < _FEW * targets:
            few, least = f"only {visible:,}" if visible else "none", count(self.params.min_visible_points, "point")
            text = (
                f"{few} of {count(targets, 'box')} with at least {least} inside; check that the labels belong to this "
                "recording, and are in metres and radians in the frame of the lidar"
            )
            found.append(Finding("points", text))
        return found

    def _fitted(self) -> Iterator[Finding]:
        if sum(len(one.targets) for one in self._sample.frames) < _MIN_BOXES:
            return
        fit = LabelFit(self._sample.frames, self.params.box_margin_m, self.params.min_visible_points)
        if (share := fit.share_in_middle()) > _MOST:
            inside = f"{100 * share:.0f} % of the points inside are in the middle third of length and width"
            yield Finding("size", f"boxes seem too large: {inside}: check the sizes and their unit")
            return
        for guess in fit.guesses([DEGREES] if self._over_full_turn else []):
            after, before = (f"{100 * part:.0f} %" for part in (guess.after, guess.before))
            evidence = f"then {after} of the points in and around boxes are inside, not {before}"
            yield Finding("fit", f"it seems that {guess.change.mistake}: {guess.change.remedy} ({evidence})")

    def _counted(self) -> Iterator[Finding]:
        """Yield what is wrong whatever the points are."""
        if self._over_full_turn:
            text = f"yaws of {self._of(self._over_full_turn)} exceed 2 pi; they seem to be in degrees"
            yield Finding("yaw", f"{text}: convert them to radians")
        if self._duplicates:
            first = listed([str(frame) for frame in sorted(self._duplicates)])
            text = f"{self._of(self._duplicates.total())} repeat another one and count twice (frame {first})"
            yield Finding("duplicate", f"{text}: delete them")
        # Positions alone are labels too if the margin has been chosen for them.
        chosen = self.params.box_margin_m > EvaluationParams().box_margin_m
        if wrong := self._without_size - (self._positions if chosen else 0):
            text = f"{self._of(wrong)} have a side of 0 m: set length, width and height"
            if wrong == self._positions:
                text += ", or for positions alone a larger evaluation.box_margin_m"
            yield Finding("size", text)

    def _of(self, number: int) -> str:
        return f"{number:,} of {count(self.boxes, 'box')}"

    def _class_names(self) -> Iterator[Finding]:
        """Yield classes that look like one with a meaning, but count as targets."""
        for kind, number in self._classes.items():
            for name, (meaning, _) in _MEANINGS.items():
                if _resembles(kind, name):
                    text = f"{self._of(number)} have the class {kind!r} and count as targets; {meaning} have the class "
                    yield Finding("class", f"{printable(text)}{name!r}: rename it")


def _resembles(kind: str, name: str) -> bool:
    """Return whether a class is probably meant to be one of `_MEANINGS`."""
    return bool(_MEANINGS[name][1].match(re.sub(r"[^a-z]", "", kind.lower())))
