"""Choice of the filter rates of a calibration: what they cost and gain on frames that are held out.

One filter rate for all range rings leaves many points where clutter is dense, which cluster to false alarms, and
removes faint targets where there is hardly any clutter. Rates that leave the same number of points per frame do
neither.

Each half of the labelled frames is judged with thresholds from the other half. A fifth of the frames, in the middle,
gives no thresholds: neighbouring frames are alike.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

from seaclutter_cli.errors import InputError
from seaclutter_cli.evaluation.scores import Summary
from seaclutter_cli.evaluation.tuning import Parts, best
from seaclutter_cli.runs.evaluate import F1, FALSE_ALARMS, N_FN, N_FP, POINTS, EvaluateWork, score_cells, score_legend
from seaclutter_cli.runs.observer import Observer, Silent, Step
from seaclutter_cli.text import count, table

_RATES = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98)
_MAX_LEFT = (20.0, 10.0, 5.0, 2.0)
_TRAINED, _HELD_OUT = 0.4, 0.5
MIN_FRAMES = 20
"""Minimum number of labelled frames to compare candidates."""
_COLUMNS = (N_FP, N_FN, F1, FALSE_ALARMS, POINTS[1])
_BEST, _USED = "<", "used"


class Candidate(NamedTuple):
    """A way to set the thresholds: the share of clutter points to remove in each range ring, and most that are left."""

    filter_rate: float
    max_left: float | None = None


def candidates(given: Candidate) -> list[Candidate]:
    """Return the candidates that are compared, the least strict first: single rates, then limits of what is left."""
    rates = [Candidate(rate) for rate in sorted({*_RATES, given.filter_rate})]
    limits = [Candidate(given.filter_rate, left) for left in sorted({*_MAX_LEFT, given.max_left or 2.0}, reverse=True)]
    return [*rates, *limits]


@dataclass(frozen=True)
class TradeOff:
    """Scores of candidates on frames that gave no thresholds, and the candidate that is used."""

    scores: Mapping[Candidate, Summary]
    used: Candidate

    @property
    def best(self) -> Candidate:
        """Candidate with the fewest frames with an error, then the fewest errors; in a tie, the first."""
        return best(self.scores) or self.used

    def as_dict(self) -> dict[str, Any]:
        """Return the scores as JSON-compatible data."""
        rows = [
            {**one._asdict(), **summary.as_dict(), "best": one == self.best, "used": one == self.used}
            for one, summary in self.scores.items()
        ]
        for row in rows:
            del row["filter_ms"]  # differs from run to run
        return {"candidates": rows}

    def as_text(self) -> str:
        """Return the scores as a table."""
        cells = score_cells(self.scores, _COLUMNS)
        rows = []
        for one in self.scores:
            notes = [_BEST] * (one == self.best) + [_USED] * (one == self.used)
            left = "" if one.max_left is None else f"{one.max_left:g}"
            rows.append((f"{one.filter_rate:g}", left, *cells[one], " ".join(notes)))
        frames = max(summary.frames for summary in self.scores.values())
        title = f"On {count(frames, 'labelled frame')}, each half with thresholds from the other:"
        lines = table(("filter rate", "max left", *(column.head for column in _COLUMNS), ""), rows)
        others = {
            "max left": "clutter points per frame that a range ring may keep",
            _BEST: "fewest frames with an error, then fewest errors; in a tie, the first",
        }
        return f"{title}\n\n{lines}\n\n{score_legend(lines, _COLUMNS, others)}"


def training_frames(frames: int) -> tuple[range, range]:
    """Return the labelled frames of a recording that give thresholds for its last half, and for its first half.

    Examples
    --------
    >>> training_frames(60)
    (range(0, 24), range(36, 60))
    """
    part = math.floor(_TRAINED * frames)
    return range(part), range(frames - part, frames)


def held_out_scores(works: Sequence[EvaluateWork], observer: Observer) -> list[Summary]:
    """Return the scores of candidates on the frames that gave no thresholds.

    The first half of the variants of each work are the candidates with thresholds from the first frames, the second
    half those with thresholds from the last frames.
    """
    number = len(works[0].variants)
    scores = [Summary() for _ in range(number // 2)]
    for work in works:
        outcome = work.run(OnlyProgress(observer))
        if outcome.error:
            raise InputError(outcome.error)
        first, last = (outcome.parts or Parts(number)).split(_HELD_OUT)
        for total, *halves in zip(scores, last[: number // 2], first[number // 2 :], strict=True):
            for summary in halves:
                total.update(summary)
    return scores


class OnlyProgress(Silent):
    """Observer that shows progress only: warnings and damage were reported when the log was read before."""

    def __init__(self, observer: Observer) -> None:
        self._observer = observer

    @contextmanager
    def progress(self, title: str, total: int | None, unit: str = "frame") -> Iterator[Step]:
        """Show the progress."""
        with self._observer.progress(title, total, unit) as step:
            yield step
