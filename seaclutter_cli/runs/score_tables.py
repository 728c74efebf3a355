"""Tables of scores, and of indications without labels: their columns, what these mean, and the best method in each."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from operator import attrgetter, itemgetter, methodcaller
from typing import Any, Literal, TypeVar

from seaclutter_cli.evaluation import IDEAL
from seaclutter_cli.evaluation.scores import ALARM_COLUMNS, POINT_COLUMNS, Summary
from seaclutter_cli.runs.outputs import PackedRows
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.text import UNKNOWN, legend, table

K = TypeVar("K")
BASELINES = ("none", IDEAL)
"""Methods that are never marked as the best: one does not filter, the other knows the labels."""

_MARK = "*"
_UNKNOWN_POINTS = b"," * len(POINT_COLUMNS) + b"\n"


@dataclass(frozen=True)
class Column:
    """Column of a table of scores: its score is None if there is nothing to count, and ``best`` if none is good."""

    head: str
    meaning: str
    score: Callable[[Any], float | None]
    digits: int = 0
    unit: str = ""
    best: Literal["low", "high"] | None = "low"

    def value(self, summary: Any) -> float | None:
        """Return the value of a method, in percent if the column says so."""
        found = self.score(summary)
        return 100 * found if found is not None and "%" in self.head + self.unit else found

    def cell(self, summary: Any) -> str:
        """Return the value of a method as text."""
        value = self.value(summary)
        return UNKNOWN if value is None else f"{value:.{self.digits}f}{self.unit}"

    def figure(self, summary: Summary) -> str:
        """Return head and value for running text, such as ``R_FP 6.63 %``."""
        head = self.head.removesuffix(" %")
        unit = self.head[len(head) :] if self.value(summary) is not None else ""
        return f"{head} {self.cell(summary)}{unit}"

    def best_in(self, summaries: Mapping[K, Summary]) -> set[K]:
        """Return the names of the best methods, as far as the digits show; empty if all methods are alike."""
        filters = {name: summary for name, summary in summaries.items() if name not in BASELINES}
        known = {name: value for name, one in filters.items() if (value := self.value(one)) is not None}
        if self.best is None or len({self.cell(summaries[name]) for name in known}) < 2:
            return set()
        best = self.cell(summaries[(min if self.best == "low" else max)(known, key=lambda name: known[name])])
        return {name for name in known if self.cell(summaries[name]) == best}


def _of_points(name: str) -> Callable[[Summary], float | None]:
    return lambda summary: None if summary.points is None else getattr(summary.points, name)


_F1 = "harmonic mean of precision (detected targets among all alarms) and recall (detected among visible targets)"
FRAMES = Column("frames", "labelled frames", attrgetter("frames"), best=None)
N_FP = Column("N_FP", "frames with a false alarm, a cluster where there is no target", attrgetter("n_fp"))
N_FN = Column("N_FN", "frames with a missed target, one that is visible but not detected", attrgetter("n_fn"))
R_FP = Column("R_FP %", "N_FP in percent of the labelled frames", attrgetter("r_fp"), 2)
R_FN = Column("R_FN %", "N_FN in percent of the labelled frames", attrgetter("r_fn"), 2)
F1 = Column("F1", _F1, attrgetter("f1"), 3, best="high")
FALSE_ALARMS = Column("false/frame", "false alarms per labelled frame", attrgetter("false_alarms_per_frame"), 2)
P50 = Column("ms p50", "median time to filter a frame, in milliseconds", methodcaller("milliseconds", 0.5), 2)

FRAME_ERRORS = (N_FP, N_FN, R_FP, R_FN, F1)
ALARMS = (FRAMES, *FRAME_ERRORS, FALSE_ALARMS)
POINTS = (
    Column("clutter removed", "share of the clutter points removed", _of_points("clutter_removal"), 2, " %", "high"),
    Column("target lost", "share of the points of targets removed", _of_points("target_loss"), 2, " %"),
    Column("R_c", "share of clutter among the points that are left", _of_points("clutter_share"), 2, " %"),
)
TIMES = (P50, Column("ms p99", "99th percentile of that time", methodcaller("milliseconds", 0.99), 2))
OBJECTS = (
    Column("precision %", "detected targets among all alarms", attrgetter("precision"), 1, best="high"),
    Column("recall %", "detected among visible targets", attrgetter("recall"), 1, best="high"),
    F1,
    Column("noise", "false alarms per labelled frame", attrgetter("false_alarms_per_frame"), 2),
    Column("unclustered", "points per labelled frame in no cluster", attrgetter("unclustered_per_frame"), 1),
    P50,
)
"""Measures of [Bi] for clusters by density."""


_LOST = "share of the looks at likely targets in which they are removed"
_ERRORS = (
    Column("targets lost", _LOST, itemgetter("targets_lost"), 1, " %"),
    Column("doubtful/frame", "kept clusters per frame that are unlike targets", itemgetter("doubtful_per_frame"), 2),
    Column("F1", "of these two, as if likely targets were labelled", itemgetter("f1"), 3),
    Column("flicker/min", "how often a likely target comes or goes in a minute", itemgetter("changes_per_minute"), 1),
)
_MEANS = (
    Column("kept", "mean likeness to targets of what is kept, from 0 to 1", itemgetter("score_of_kept"), 2),
    Column("removed", "the same of what is removed", itemgetter("score_of_removed"), 2),
    Column("water", "share of the points near the water that are kept", itemgetter("water_kept"), 2, " %"),
    Column("agrees", "share of the points that are treated as other methods do", itemgetter("agreement"), 1, " %"),
)
_NOTE = "Indications, not rates: likely targets stand out, stay, and move steadily."


def score_table(summaries: Mapping[str, Summary], columns: Sequence[Column]) -> str:
    """Return a table with a row for each method; an asterisk marks the best values of each column."""
    rows = [(name, *cells) for name, cells in score_cells(summaries, columns).items()]
    return table(("method", *(column.head for column in columns)), rows)


def score_cells(summaries: Mapping[K, Summary], columns: Sequence[Column]) -> dict[K, list[str]]:
    """Return the cells of each method, with an asterisk before the best values of each column."""
    cells: dict[K, list[str]] = {name: [] for name in summaries}
    for column in columns:
        best = column.best_in(summaries)
        for name, summary in summaries.items():
            cells[name].append(f"{_MARK if name in best else ''}{column.cell(summary)}")
    return cells


def score_legend(text: str, columns: Iterable[Column], others: Mapping[str, str] | None = None) -> str:
    """Return what the columns of tables, which are given as text, mean; with their marks if there are any."""
    lines = {column.head: column.meaning for column in columns} | dict(others or {})
    if "@" in text:
        lines["@0.80"] = "a threshold that removes 80 % of the points of a recording"
    if f"\n{IDEAL} " in text:
        lines[IDEAL] = "keeps exactly the points of targets: what it misses, no filter could find"
    if _MARK in text:
        lines[_MARK] = "best of the filters in this column"
    if UNKNOWN in text:
        lines[UNKNOWN] = "nothing to count"
    return legend(lines)


def indications_text(found: Mapping[str, Any], title: str) -> str:
    """Return what indicates the quality of methods as human-readable text."""
    tables = [score_table(found, [replace(one, best=None) for one in columns]) for columns in (_ERRORS, _MEANS)]
    text = "\n\n".join((title, *tables, _NOTE))
    return f"{text}\n\n{score_legend(UNKNOWN * (UNKNOWN in text), (*_ERRORS, *_MEANS))}"


def frame_table(rows: Iterable[PackedRows], *, points_known: bool) -> Iterator[bytes]:
    """Yield the lines of a table (CSV) of frames; it has columns for points if their labels are known for any."""
    columns = (*ALARM_COLUMNS, *(POINT_COLUMNS if points_known else ()))
    yield csv_line(("recording", "method", "frame", "stamp_ns", *columns))
    for line in chain.from_iterable(rows):
        yield line if points_known else line.replace(_UNKNOWN_POINTS, b"\n")
