"""Results of an evaluation, as text and as data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from seaclutter_cli.evaluation.scores import Summary
from seaclutter_cli.runs.frame_table import PackedRows
from seaclutter_cli.runs.methods import Variant
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult
from seaclutter_cli.text import count, table

_ALARMS = ("method", "frames", "N_FP", "N_FN", "R_FP %", "R_FN %", "F1", "false/frame")
_POINTS = ("clutter removed", "target lost", "R_c")
_OBJECTS = ("precision %", "recall %", "F1", "noise", "unclustered", "ms p50")
_TIMES = ("ms p50", "ms p99")


@dataclass(kw_only=True)
class Evaluated(Outcome):
    """Outcome of the evaluation of one recording.

    Parameters
    ----------
    methods : mapping of str to Summary
        Sums over the frames for each variant.
    rows : PackedRows or None
        Rows of the table of frames, on their way from another process.
    """

    methods: Mapping[str, Summary] = field(default_factory=dict)
    rows: PackedRows | None = field(default=None, repr=False)

    @property
    def frames(self) -> int:
        """Number of frames that at least one method could use, labelled or not."""
        return max((summary.frames + summary.unlabelled for summary in self.methods.values()), default=0)

    def figures(self) -> str:
        """Return frames and rates of the first method, for a line about the outcome."""
        name, summary = next(iter(self.methods.items()))
        rates = f"R_FP {_shown(summary.r_fp, 100, 2, ' %')}, R_FN {_shown(summary.r_fn, 100, 2, ' %')}"
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
        first = max(totals.values(), key=lambda summary: summary.frames)
        done = sum(not outcome.error for outcome in self.outcomes)
        title = f"{count(done, 'recording')}; {count(first.frames, 'labelled frame')}, {first.unlabelled:,} unlabelled"
        title += f"; {count(first.targets, 'target')}, {first.targets - first.visible:,} not visible"
        alarms = table(_ALARMS, [(name, *_alarm_cells(summary)) for name, summary in totals.items()])
        points_known = any(summary.points for summary in totals.values())
        head = ("method", *(_POINTS if points_known else ()), *_TIMES)
        rows = [
            (name, *(_point_cells(summary) if points_known else ()), *_time_cells(summary))
            for name, summary in totals.items()
        ]
        blocks = [title, alarms, table(head, rows)]
        if self.variants[0].config.evaluation.clustering == "dbscan":
            objects = [(name, *_object_cells(summary)) for name, summary in totals.items()]
            blocks.insert(2, table(("method", *_OBJECTS), objects))
        return "\n\n".join(blocks)


def _alarm_cells(summary: Summary) -> tuple[str, ...]:
    return (
        f"{summary.frames}",
        f"{summary.n_fp}",
        f"{summary.n_fn}",
        _shown(summary.r_fp, 100, 2),
        _shown(summary.r_fn, 100, 2),
        _shown(summary.f1, 1, 3),
        _shown(summary.false_alarms_per_frame, 1, 2),
    )


def _object_cells(summary: Summary) -> tuple[str, ...]:
    return (
        _shown(summary.precision, 100, 1),
        _shown(summary.recall, 100, 1),
        _shown(summary.f1, 1, 3),
        _shown(summary.false_alarms_per_frame, 1, 2),
        _shown(summary.unclustered_per_frame, 1, 1),
        _shown(summary.milliseconds(0.5), 1, 2),
    )


def _point_cells(summary: Summary) -> tuple[str, ...]:
    points = summary.points
    rates = (None,) * 3 if points is None else (points.clutter_removal, points.target_loss, points.clutter_share)
    return tuple(_shown(rate, 100, 2, " %") for rate in rates)


def _time_cells(summary: Summary) -> tuple[str, ...]:
    return tuple(_shown(summary.milliseconds(share), 1, 2) for share in (0.5, 0.99))


def _shown(value: float | None, scale: float, digits: int, unit: str = "") -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}{unit}"
