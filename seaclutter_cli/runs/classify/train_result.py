"""Test report of a trained forest, as text and as data."""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.forest import class_name
from seaclutter_cli.evaluation.confusion import Confusion
from seaclutter_cli.runs.recordings import Result
from seaclutter_cli.text import UNKNOWN, count, table


@dataclass(frozen=True)
class TrainingReport(Result):
    """Test report of a forest on held-out points and objects.

    Parameters
    ----------
    codes : tuple of int
        Codes of the classes.
    points, objects : Confusion
        Confusion matrix of points; and of objects, each with the class predicted for most of its points.
    importances : dict of str to float
        Importance of each feature.
    split : str
        Unit of the split: ``tile`` or ``object``.
    trained, tested : int
        Number of points in training and in the test.
    """

    is_summary = True

    codes: tuple[int, ...]
    points: Confusion
    objects: Confusion
    importances: dict[str, float]
    split: str
    trained: int
    tested: int

    @property
    def names(self) -> list[str]:
        """Names of the classes."""
        return [class_name(code) for code in self.codes]

    @property
    def kappa(self) -> float:
        """Cohen's kappa of points; NaN if all tested points are of one class, where it is meaningless."""
        several = np.count_nonzero(self.points.counts.sum(axis=1)) > 1
        return self.points.kappa if several else float("nan")

    def as_dict(self) -> dict[str, Any]:
        """Return the report as JSON-compatible data."""
        points = self.points
        columns = (points.precision, points.recall, points.f1, points.counts.sum(axis=1), self.objects.f1)
        keys = ("precision", "recall", "f1", "points", "object_f1")
        rows = [dict(zip(("class", *keys), (name, *map(_plain, v)), strict=True)) for name, *v in self._rows(columns)]
        summary = {
            "accuracy": _plain(points.accuracy),
            "kappa": _plain(self.kappa),
            "macro_f1": _plain(points.macro_f1),
        }
        return {
            "held_out": self.split if self.tested else None,
            "points_trained": self.trained,
            "points_tested": self.tested,
            **summary,
            "object_macro_f1": _plain(self.objects.macro_f1),
            "classes": rows,
            "confusion": points.counts.tolist(),
            "importances": self.importances,
        }

    def _rows(self, columns: Sequence[NDArray[Any]]) -> list[tuple[Any, ...]]:
        return list(zip(self.names, *columns, strict=True))

    def as_text(self) -> str:
        """Return the report as human-readable text; one line if nothing was tested."""
        trained = f"trained on {count(self.trained, 'point')}"
        if not self.tested:
            return f"{trained}; no test, because nothing could be held out"
        points, objects = self.points, self.objects
        columns = (points.precision, points.recall, points.f1, points.counts.sum(axis=1), objects.f1)
        rows = [(n, _3(p), _3(r), _3(f), f"{c:,}", _3(o)) for n, p, r, f, c, o in self._rows(columns)]
        head = ("class", "precision", "recall", "F1", "points", "  object F1")
        rows.append(("mean", "", "", _3(points.macro_f1), f"{points.counts.sum():,}", _3(objects.macro_f1)))
        ranked = sorted(self.importances.items(), key=lambda item: -item[1])
        return "\n".join(
            (
                f"{trained}, tested on {count(self.tested, 'point')} of other {self.split}s",
                table(head, rows),
                f"overall accuracy {_3(points.accuracy)}, kappa {_3(self.kappa)}",
                fill("importance: " + ", ".join(f"{name} {value:.2f}" for name, value in ranked), 80),
            )
        )


def _3(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else UNKNOWN


def _plain(value: Any) -> Any:
    number = value.item() if hasattr(value, "item") else value
    return None if isinstance(number, float) and not np.isfinite(number) else number
