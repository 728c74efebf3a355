"""Results of an evaluation, as text and as data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from seaclutter_cli.evaluation.scores import Summary
from seaclutter_cli.evaluation.tuning import Parts
from seaclutter_cli.runs.frame_table import PackedRows
from seaclutter_cli.runs.methods import Variant
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult
from seaclutter_cli.runs.score_table import ALARMS, OBJECTS, POINTS, R_FN, R_FP, TIMES, score_legend, score_table
from seaclutter_cli.text import count


@dataclass(kw_only=True)
class Evaluated(Outcome):
    """Outcome of the evaluation of one recording.

    Parameters
    ----------
    methods : mapping of str to Summary
        Sums over the frames for each variant.
    rows : PackedRows or None
        Rows of the table of frames, on their way from another process.
    parts : Parts or None
        Scores of consecutive parts of the recording, where some may be held out.
    """

    methods: Mapping[str, Summary] = field(default_factory=dict)
    rows: PackedRows | None = field(default=None, repr=False)
    parts: Parts | None = field(default=None, repr=False)

    @property
    def frames(self) -> int:
        """Number of frames that at least one method could use, labelled or not."""
        return max((summary.frames + summary.unlabelled for summary in self.methods.values()), default=0)

    def figures(self) -> str:
        """Return frames and rates of the first method, for a line about the outcome."""
        name, summary = next(iter(self.methods.items()))
        rates = ", ".join(column.figure(summary) for column in (R_FP, R_FN))
        return f"{count(summary.frames, 'labelled frame')}, {name}: {rates}, {self.seconds:.1f} s"

    def counts(self) -> dict[str, Any]:
        """Return further columns of the manifest of a run, with the alarms of the first method."""
        first = next(iter(self.methods.values()))
        return {
            "frames": first.frames,
            "false_alarms": first.false_alarms,
            "missed_targets": first.visible - first.detected,
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome as JSON-compatible data."""
        return {
            "recording": self.recording,
            "error": self.error,
            "damage": [str(item) for item in self.damage],
            "seconds": round(self.seconds, 3),
            "methods": {} if self.error else {name: summary.as_dict() for name, summary in self.methods.items()},
        }


@dataclass(frozen=True)
class Comparison(RecordingsResult):
    """Result of the evaluation of several recordings.

    Parameters
    ----------
    variants : sequence of Variant
        Methods that were compared.
    outcomes : sequence of Evaluated
        Outcome of each recording.
    """

    variants: Sequence[Variant]
    outcomes: Sequence[Evaluated]

    def totals(self) -> dict[str, Summary]:
        """Return the sums over all recordings without an error."""
        totals = {variant.name: Summary() for variant in self.variants}
        for outcome in self.outcomes:
            for name, summary in outcome.methods.items() if not outcome.error else ():
                totals[name].update(summary)
        return totals

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as JSON-compatible data."""
        return {
            "methods": {name: summary.as_dict() for name, summary in self.totals().items()},
            "recordings": [outcome.as_dict() for outcome in self.outcomes],
            "configs": {variant.name: variant.config.as_dict() for variant in self.variants},
        }

    def as_text(self) -> str:
        """Return the comparison as human-readable text; for DBSCAN clusters, include the measures of [Bi]."""
        if all(outcome.error for outcome in self.outcomes):
            return ""
        totals = self.totals()
        points_known = any(summary.points for summary in totals.values())
        groups = [ALARMS, (*(POINTS if points_known else ()), *TIMES)]
        if self.variants[0].config.evaluation.clustering == "dbscan":
            groups.insert(1, OBJECTS)
        tables = "\n\n".join(score_table(totals, columns) for columns in groups)
        foot = score_legend(tables, (column for columns in groups for column in columns))
        return f"{self._title(totals)}\n\n{tables}\n\n{foot}"

    def _title(self, totals: Mapping[str, Summary]) -> str:
        """Return what was compared: recordings, frames, targets and, where they are labelled, points."""
        done = sum(not outcome.error for outcome in self.outcomes)
        first = max(totals.values(), key=lambda summary: summary.frames)
        least = self.variants[0].config.evaluation.min_visible_points
        frames = f"{count(first.frames, 'labelled frame')}, {first.unlabelled:,} unlabelled"
        visible = f"{first.visible:,} visible (at least {count(least, 'point')})"
        part = "" if done == len(self.outcomes) else f"{done:,} of "
        lines = [
            f"{part}{count(len(self.outcomes), 'recording')}; {frames}",
            f"{count(first.targets, 'target')}, {visible}",
        ]
        if points := first.points:
            lines.append(f"{count(points.target_in, 'target point')}, {count(points.clutter_in, 'clutter point')}")
        return "\n".join(lines)
