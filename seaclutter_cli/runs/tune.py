"""Tuning: every combination of methods and parameter values over labelled recordings, in one pass."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.errors import UsageError
from seaclutter_cli.evaluation.matching import point_truth
from seaclutter_cli.evaluation.scores import Parts, Summary, best, ideal_threshold
from seaclutter_cli.plots.curves import draw_rates, draw_thresholds
from seaclutter_cli.plots.figure import render
from seaclutter_cli.reporting.collector import FrameListener, ScoredFrame
from seaclutter_cli.runs.batch import prepared, run_all, without_labels
from seaclutter_cli.runs.evaluate import Evaluated, EvaluateWork
from seaclutter_cli.runs.methods import Sweep, Variant, grid, note_left_out
from seaclutter_cli.runs.options import BatchOptions
from seaclutter_cli.runs.options.logs import TuneOptions
from seaclutter_cli.runs.outputs import Contents, write_files
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, data_of
from seaclutter_cli.runs.score_tables import FRAME_ERRORS, FRAMES, score_cells, score_legend
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.text import count, printable, table
from seaclutter_cli.validation import yaml_value

_RATES = ("frames", "N_FP", "N_FN", "R_FP", "R_FN", "precision", "recall", "f1", "false_alarms", "omitted_alarms")
_BEST = "<"
_JUDGED = (FRAMES, *FRAME_ERRORS)
_Part = Mapping[str, Summary]
_MIN_RECORDINGS = 4
"""Minimum number of recordings of which whole ones are held out."""


@use_case_of(TuneOptions)
def tune(options: TuneOptions) -> "TuningResult":
    """Evaluate every combination of methods and parameter values, and find the one with the fewest bad frames.

    Examples
    --------
    >>> import seaclutter
    >>> result = seaclutter.tune("samples/sea.mcap", "samples/sea.labels.csv", {"update_weight": [0.6, 1.0]})
    >>> result.best
    'update_weight=0.6'
    """
    observer = options.watching
    note_left_out(options, observer)
    combinations = grid(options.sweeps, options)
    pairs = prepared(options, observer, [one.config for one in combinations])
    _check_plots(options, combinations, len(pairs))
    history = _ThresholdHistory(combinations, options.ring) if options.thresholds_file else None
    listeners = [history] if history else []
    works = [EvaluateWork(options.reading, *each, combinations, listeners, in_parts=True) for each in pairs]
    batch = BatchOptions() if history else options  # frames reach listeners in this process only
    outcomes = run_all(works, batch, observer, earlier=without_labels(works, observer))
    scores = _split_scores(outcomes, [one.name for one in combinations], options.hold_out)
    result = TuningResult(outcomes, options.sweeps, combinations, *scores)
    if options.output and not result.best and not result.failed:
        observer.warn(f"{options.output}: not written, because no frame is labelled")
    files: Contents = {
        options.output if result.best else None: lambda it: it.stream.write(result.best_config().encode()),
        options.csv_file: lambda it: it.stream.write(result.as_csv()),
        options.curve_file: lambda it: it.stream.write(result.curve(it.path.suffix)),
        options.thresholds_file: lambda it: it.stream.write(history.plot(it.path.suffix) if history else b""),
    }
    write_files(files, replace=options.force, outcomes=outcomes, observer=observer)
    return result


def _check_plots(options: TuneOptions, combinations: Sequence[Variant], recordings: int) -> None:
    several = len({one.method for one in combinations}) > 1
    if options.curve_file and (len(options.sweeps) != 1 or several):
        raise UsageError("--plot: needs a single --sweep of a single method")
    if options.thresholds_file and several:
        raise UsageError("--plot-thresholds: needs a single method")
    if options.thresholds_file and recordings > 1:
        raise UsageError("--plot-thresholds: needs a single recording")


class _ThresholdHistory(FrameListener):
    """Listener that stores the threshold of a range ring for each frame and variant ([Li2023], Fig. 7)."""

    def __init__(self, variants: Sequence[Variant], ring: int) -> None:
        for variant in variants:
            rings = max(len(variant.config.ring_edges) - 1, 0)
            if ring > rings:
                raise UsageError(f"--ring {ring}: {variant.name} has {count(rings, 'range ring')}")
        self._names, self._ring = [variant.name for variant in variants], ring - 1
        self._evaluation = variants[0].config.evaluation
        self._start_m, self._end_m = variants[0].config.ring_edges[ring - 1 : ring + 1]
        self._rows: list[list[float]] = []

    def add(self, scored: ScoredFrame) -> None:
        """Store the ideal threshold of a frame and those of the variants; NaN if there is none."""
        frame, ideal = scored.frame, None
        if scored.truth is not None:
            inside = frame.valid & (frame.range_m >= self._start_m) & (frame.range_m < self._end_m)
            points = point_truth(frame, scored.truth, self._evaluation)
            ideal = ideal_threshold(frame.intensity[inside], points[inside])
        rings = [None if one is None else one.rings for one in scored.results]
        used = [np.nan if one is None else float(one.thresholds[self._ring]) for one in rings]
        self._rows.append([np.nan if ideal is None else ideal, *used])

    def plot(self, suffix: str) -> bytes:
        ideal, *curves = np.array(self._rows, np.float64).reshape(-1, 1 + len(self._names)).T
        keys = {name.partition("=")[0] for name in self._names}
        title = keys.pop() if len(keys) == 1 and not any(" " in name for name in self._names) else None
        named = dict(zip((name.removeprefix(f"{title}=") for name in self._names), curves, strict=True))
        ring = f"{self._start_m:g} to {self._end_m:g} m"
        return render(lambda figure: draw_thresholds(figure, ring, named, ideal, title=title), suffix)


def _split_scores(outcomes: Sequence[Evaluated], names: Sequence[str], share: float) -> tuple[_Part, _Part, str | None]:
    """Return the scores of recordings without an error for tuning, those held out, if any, and what these are.

    Of four or more recordings, a share of whole ones is held out, evenly spaced; of fewer, the last frames of each.
    Neighbouring frames are alike, so single frames would tell nothing new.
    """
    used = [outcome for outcome in outcomes if not outcome.error and not outcome.has_nothing]
    held: list[Evaluated] = []
    if share and len(used) >= _MIN_RECORDINGS:
        number = min(max(round(share * len(used)), 1), len(used) - 1)
        held = [used[(k + 1) * len(used) // number - 1] for k in range(number)]
    tuned, held_out = ({name: Summary() for name in names} for _ in range(2))
    for outcome in used:
        parts = outcome.parts or Parts(len(names))
        before, end = parts.split(float(any(outcome is one for one in held)) if held else share)
        for name, first, last in zip(names, before, end, strict=True):
            tuned[name].update(first)
            held_out[name].update(last)
    frames = max((summary.frames for summary in held_out.values()), default=0)
    if not frames:
        return tuned, {}, None
    title = count(frames, "frame")
    if held:
        title += f" ({count(len(held), 'recording')}: {', '.join(outcome.recording for outcome in held)})"
    else:
        title += " at the end of the recording" if len(used) == 1 else " at the ends of the recordings"
    return tuned, held_out, title


@dataclass(frozen=True)
class TuningResult(RecordingsResult[Evaluated]):
    """Result of a sweep over methods and parameter values: all combinations, and their scores.

    ``tuned`` are sums for each combination over the frames used for tuning, ``judged`` over those ``held_out``, if any.
    """

    data = "combinations=rows best held_out recordings"

    sweeps: Sequence[Sweep]
    combinations: Sequence[Variant]
    tuned: _Part
    judged: _Part
    held_out: str | None

    @cached_property
    def best(self) -> str | None:
        """Name of the best combination; None if no frame is labelled."""
        return best(self.tuned)

    @cached_property
    def best_of_methods(self) -> list[str]:
        """Name of the best combination of each method, in the order of the methods."""
        methods = dict.fromkeys(one.method for one in self.combinations)
        own = [[one.name for one in self.combinations if one.method == method] for method in methods]
        found = [best({name: self.tuned[name] for name in names}) for names in own]
        return [name for name in found if name]

    def best_config(self) -> str:
        """Return the best configuration as a commented file."""
        chosen = next(one for one in self.combinations if one.name == self.best)
        recordings = ", ".join(printable(outcome.recording) for outcome in self.outcomes if not outcome.error)
        lines = [f"# Best of {count(len(self.combinations), 'combination')} on {recordings}: {chosen.name}"]
        for part, summaries in self._parts.items() if self.held_out else ():
            found = summaries[chosen.name]
            figures = ", ".join(column.figure(found) for column in FRAME_ERRORS)
            lines.append(f"# {part}: {count(found.frames, 'frame')}, {figures}")
        return "\n".join([*lines, chosen.config.to_yaml(comments=True)])

    def curve(self, suffix: str) -> bytes:
        """Return the content of a plot of the rates over a single parameter."""
        (sweep,) = self.sweeps
        chosen = list(self.tuned).index(self.best) if self.best else None
        both = ([(one.r_fp, one.r_fn) for one in part.values()] for part in (self.tuned, self.judged))
        tuned, held_out = (np.array(rates, np.float64).reshape(-1, 2).T for rates in both)  # NaN where unknown
        values = list(map(yaml_value, sweep.values))
        return render(lambda figure: draw_rates(figure, sweep.key, values, tuned, held_out, chosen), suffix)

    @property
    def _several(self) -> bool:
        return len({one.method for one in self.combinations}) > 1

    @property
    def _parts(self) -> dict[str, _Part]:
        return {"tuned": self.tuned, **({"held out": self.judged} if self.held_out else {})}

    def recordings(self) -> list[dict[str, Any]]:
        """Return each recording, without scores."""
        return [data_of(outcome, Outcome.data) for outcome in self.outcomes]

    def rows(self) -> list[dict[str, Any]]:
        """Return methods, values and scores of each combination."""
        rows = []
        for one in self.combinations:
            name = one.name
            row: dict[str, Any] = {"method": one.method} if self._several else {}
            row |= {sweep.key: one.values.get(sweep.key) for sweep in self.sweeps}
            for part, summaries in self._parts.items():
                found, prefix = summaries[name].as_dict(), "" if part == "tuned" else "held_out_"
                row |= {prefix + key: found[key] for key in _RATES}
            rows.append({**row, "best": name == self.best})
        return rows

    def as_csv(self) -> bytes:
        """Return the result as CSV, with a row for each combination."""
        rows = self.rows()
        return b"".join(map(csv_line, (rows[0], *(row.values() for row in rows))))

    def as_text(self) -> str:
        """Return the result as human-readable text: all combinations, then tuned and held-out figures of the best."""
        if not self.best:
            return f"{self._table()}\n\nno best combination: no frame is labelled"
        frames = max(summary.frames for summary in self.tuned.values())
        title = f"best on {count(frames, 'frame')}: {self.best}"
        if self.held_out:
            title += f"\nheld out: {printable(self.held_out)}"
        rows = []
        for part, summaries in self._parts.items():
            cells = score_cells({name: summaries[name] for name in self.best_of_methods}, _JUDGED)
            rows += [(name, part, *cells[name]) for name in self.best_of_methods]
        judgement = table(("best combination", "", *(one.head for one in _JUDGED)), rows)
        tables = f"{self._table()}\n\n{title}\n\n{judgement}"
        legend = score_legend(tables, _JUDGED, {_BEST: "fewest frames with an error, then fewest errors, when tuned"})
        return f"{tables}\n\n{legend}"

    def _table(self) -> str:
        cells = score_cells(self.tuned, FRAME_ERRORS)
        first = ["method"] if self._several else []
        keys = [sweep.key for sweep in self.sweeps]
        rows = []
        for one in self.combinations:
            name = one.name
            values = [*([one.method] if first else []), *(str(one.values.get(key, "")) for key in keys)]
            rows.append((*values, *cells[name], _BEST if name == self.best else ""))
        return table((*first, *keys, *(one.head for one in FRAME_ERRORS), ""), rows)
