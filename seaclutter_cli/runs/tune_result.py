"""Results of tuning, as text and as data."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.scores import Summary
from seaclutter_cli.evaluation.tuning import best
from seaclutter_cli.plots.curves import draw_rates
from seaclutter_cli.plots.figure import render
from seaclutter_cli.runs.comparison import Evaluated
from seaclutter_cli.runs.held_out import Split
from seaclutter_cli.runs.recordings import RecordingsResult
from seaclutter_cli.runs.score_table import FRAME_ERRORS, FRAMES, score_cells, score_legend
from seaclutter_cli.runs.sweep import Combination, Sweep
from seaclutter_cli.text import count, printable, table

_RATES = ("frames", "N_FP", "N_FN", "R_FP", "R_FN", "precision", "recall", "f1", "false_alarms", "omitted_alarms")
_BEST = "<"
_JUDGED = (FRAMES, *FRAME_ERRORS)


@dataclass(frozen=True)
class TuningResult(RecordingsResult):
    """Result of a sweep over methods and parameter values.

    Parameters
    ----------
    sweeps : sequence of Sweep
        Parameters and values that were tried.
    combinations : sequence of Combination
        All combinations.
    outcomes : sequence of Evaluated
        Outcome of each recording.
    split : Split
        Scores of the frames used for tuning, and of those held out.
    """

    sweeps: Sequence[Sweep]
    combinations: Sequence[Combination]
    outcomes: Sequence[Evaluated]
    split: Split

    @cached_property
    def best(self) -> str | None:
        """Name of the best combination; None if no frame is labelled."""
        return best(self.split.tuned)

    @cached_property
    def best_of_methods(self) -> list[str]:
        """Name of the best combination of each method, in the order of the methods."""
        methods = dict.fromkeys(one.method for one in self.combinations)
        own = [[one.variant.name for one in self.combinations if one.method == method] for method in methods]
        found = [best({name: self.split.tuned[name] for name in names}) for names in own]
        return [name for name in found if name]

    def best_config(self) -> str:
        """Return the best configuration as a commented file."""
        chosen = next(one.variant for one in self.combinations if one.variant.name == self.best)
        recordings = ", ".join(printable(outcome.recording) for outcome in self.outcomes if not outcome.error)
        lines = [f"# Best of {count(len(self.combinations), 'combination')} on {recordings}: {chosen.name}"]
        for part, summaries in self._parts() if self.split.held_out else ():
            found = summaries[chosen.name]
            figures = ", ".join(column.figure(found) for column in FRAME_ERRORS)
            lines.append(f"# {part}: {count(found.frames, 'frame')}, {figures}")
        return "\n".join([*lines, chosen.config.to_yaml(comments=True)])

    def curve(self, suffix: str) -> bytes:
        """Return the content of a plot of the rates over a single parameter."""
        (sweep,) = self.sweeps
        chosen = list(self.split.tuned).index(self.best) if self.best else None
        tuned, held_out = (_rates(summaries) for summaries in (self.split.tuned, self.split.held_out))
        return render(lambda figure: draw_rates(figure, sweep.key, sweep.shown, tuned, held_out, chosen), suffix)

    def _parts(self) -> list[tuple[str, Mapping[str, Summary]]]:
        """Return the scores of the frames used for tuning and, if there are any, of those held out."""
        parts = [("tuned", self.split.tuned), ("held out", self.split.held_out)]
        return [(name, summaries) for name, summaries in parts if summaries]

    def _rows(self) -> list[dict[str, Any]]:
        rows = []
        several = len({one.method for one in self.combinations}) > 1
        for one in self.combinations:
            name = one.variant.name
            row: dict[str, Any] = {"method": one.method} if several else {}
            row |= {sweep.key: one.values.get(sweep.key) for sweep in self.sweeps}
            found = self.split.tuned[name].as_dict()
            row |= {key: found[key] for key in _RATES}
            if self.split.held_out:
                found = self.split.held_out[name].as_dict()
                row |= {f"held_out_{key}": found[key] for key in _RATES}
            rows.append({**row, "best": name == self.best})
        return rows

    def as_dict(self) -> dict[str, Any]:
        """Return the result as JSON-compatible data."""
        return {
            "combinations": self._rows(),
            "best": self.best,
            "held_out": self.split.title or None,
            "recordings": [
                {"recording": outcome.recording, "error": outcome.error, "damage": [str(d) for d in outcome.damage]}
                for outcome in self.outcomes
            ],
        }

    def as_csv(self) -> str:
        """Return the result as CSV, with a row for each combination."""
        rows, text = self._rows(), io.StringIO()
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        return text.getvalue()

    def as_text(self) -> str:
        """Return the result as human-readable text: all combinations, then tuned and held-out figures of the best."""
        if not self.best:
            return f"{self._table()}\n\nno best combination: no frame is labelled"
        frames = max(summary.frames for summary in self.split.tuned.values())
        title = f"best on {count(frames, 'frame')}: {self.best}"
        if self.split.held_out:
            title += f"\nheld out: {printable(self.split.title)}"
        tables = f"{self._table()}\n\n{title}\n\n{self._judgement()}"
        legend = score_legend(tables, _JUDGED, {_BEST: "fewest frames with an error, then fewest errors, when tuned"})
        return f"{tables}\n\n{legend}"

    def _table(self) -> str:
        """Return a table of all combinations on the frames used for tuning."""
        cells = score_cells(self.split.tuned, FRAME_ERRORS)
        several = len({one.method for one in self.combinations}) > 1
        keys = [sweep.key for sweep in self.sweeps]
        rows = []
        for one in self.combinations:
            name = one.variant.name
            first = ([one.method] if several else []) + [str(one.values.get(key, "")) for key in keys]
            rows.append((*first, *cells[name], _BEST if name == self.best else ""))
        return table((*(["method"] if several else []), *keys, *(one.head for one in FRAME_ERRORS), ""), rows)

    def _judgement(self) -> str:
        """Return a table of the best combination of each method, on the frames for tuning and on those held out."""
        rows = []
        for part, summaries in self._parts():
            cells = score_cells({name: summaries[name] for name in self.best_of_methods}, _JUDGED)
            rows += [(name, part, *cells[name]) for name in self.best_of_methods]
        return table(("best combination", "", *(one.head for one in _JUDGED)), rows)


def _rates(summaries: Mapping[str, Summary]) -> NDArray[np.float64]:
    """Return the rates of frames with a false alarm and with a missed target, shape (2, K); NaN where unknown."""
    return np.array([(summary.r_fp, summary.r_fn) for summary in summaries.values()], np.float64).reshape(-1, 2).T
