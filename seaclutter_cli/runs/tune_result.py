"""Results of tuning, as text and as data."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from seaclutter_cli.evaluation.scores import Summary
from seaclutter_cli.evaluation.tuning import best
from seaclutter_cli.plots.figure import render
from seaclutter_cli.plots.tuning import draw_rates
from seaclutter_cli.runs.comparison import Comparison, Evaluated
from seaclutter_cli.runs.methods import Variant
from seaclutter_cli.runs.recordings import RecordingsResult
from seaclutter_cli.runs.sweep import Sweep
from seaclutter_cli.text import count, table

_RATES = ("frames", "N_FP", "N_FN", "R_FP", "R_FN", "precision", "recall", "f1", "false_alarms", "omitted_alarms")


@dataclass(frozen=True)
class TuningResult(RecordingsResult):
    """Result of a sweep over parameter values.

    Parameters
    ----------
    sweeps : sequence of Sweep
        Parameters and values that were tried.
    variants : sequence of Variant
        All combinations.
    outcomes : sequence of Evaluated
        Outcome of each recording.
    """

    sweeps: Sequence[Sweep]
    variants: Sequence[Variant]
    outcomes: Sequence[Evaluated]

    @cached_property
    def totals(self) -> Mapping[str, Summary]:
        """Sums over all recordings for each combination."""
        return Comparison(self.variants, self.outcomes).totals()

    @cached_property
    def best(self) -> str | None:
        """Name of the best combination; None if no frame is labelled."""
        return best(self.totals)

    def best_config(self) -> str:
        """Return the best configuration as a commented file."""
        config = next(variant.config for variant in self.variants if variant.name == self.best)
        recordings = ", ".join(outcome.recording for outcome in self.outcomes if not outcome.error)
        comment = f"# Best of {count(len(self.variants), 'combination')} on {recordings}: {self.best}"
        return f"{comment}\n{config.to_yaml(comments=True)}"

    def curve(self, suffix: str) -> bytes:
        """Return the content of a plot of the rates over a single parameter."""
        rates = [(summary.r_fp, summary.r_fn) for summary in self.totals.values()]
        r_fp, r_fn = np.array(rates, np.float64).reshape(-1, 2).T
        chosen = list(self.totals).index(self.best) if self.best else None
        (sweep,) = self.sweeps
        return render(lambda figure: draw_rates(figure, sweep.key, sweep.shown, r_fp, r_fn, chosen), suffix)

    def _rows(self) -> list[dict[str, Any]]:
        rows = []
        for variant in self.variants:
            config, found = variant.config.as_dict()["filter"], self.totals[variant.name].as_dict()
            values = {sweep.key: sweep.value_in(config) for sweep in self.sweeps}
            rows.append({**values, **{name: found[name] for name in _RATES}, "best": variant.name == self.best})
        return rows

    def as_dict(self) -> dict[str, Any]:
        """Return the result as JSON-compatible data."""
        return {
            "combinations": self._rows(),
            "best": self.best,
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
        """Return the result as human-readable text."""
        head = (*(sweep.key for sweep in self.sweeps), "N_FP", "N_FN", "R_FP %", "R_FN %", "F1", "")
        rows = [self._cells(variant) for variant in self.variants]
        frames = max(summary.frames for summary in self.totals.values())
        best = f"best on {count(frames, 'frame')}: {self.best}"
        return f"{table(head, rows)}\n\n{best if self.best else 'no best combination: no frame is labelled'}"

    def _cells(self, variant: Variant) -> tuple[str, ...]:
        config, summary = variant.config.as_dict()["filter"], self.totals[variant.name]
        rates = [None if rate is None else f"{100 * rate:.2f}" for rate in (summary.r_fp, summary.r_fn)]
        f1 = None if summary.f1 is None else f"{summary.f1:.3f}"
        cells = (summary.n_fp, summary.n_fn, *rates, f1)
        values = (sweep.value_in(config) for sweep in self.sweeps)
        mark = "<" if variant.name == self.best else ""
        return (*(str(value) for value in values), *("-" if cell is None else str(cell) for cell in cells), mark)
