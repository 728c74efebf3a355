"""Tables of scores: of methods as text, with what the columns mean and the best values; of frames as CSV."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from seaclutter_cli.evaluation.scores import ALARM_COLUMNS, POINT_COLUMNS, FrameScore, Summary
from seaclutter_cli.frame import Frame
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.text import UNKNOWN, legend, table

BASELINE = "none"
"""Method that is never marked as the best: it loses no target and takes no time, because it does not filter."""

_MARK = "*"
_FRAME_COLUMNS = ("recording", "method", "frame", "stamp_ns", *ALARM_COLUMNS)
_UNKNOWN_POINTS = b"," * len(POINT_COLUMNS) + b"\n"


@dataclass(frozen=True)
class Column:
    """Column of a table of scores: its value is None if there is nothing to count, and ``best`` if none is good."""

    head: str
    meaning: str
    value: Callable[[Summary], float | None]
    digits: int = 0
    unit: str = ""
    best: Literal["low", "high"] | None = "low"

    def cell(self, summary: Summary) -> str:
        """Return the value of a method as text."""
        value = self.value(summary)
        return UNKNOWN if value is None else f"{value:.{self.digits}f}{self.unit}"

    def figure(self, summary: Summary) -> str:
        """Return head and value for running text, such as ``R_FP 6.63 %``."""
        head = self.head.removesuffix(" %")
        unit = self.head[len(head) :] if self.value(summary) is not None else ""
        return f"{head} {self.cell(summary)}{unit}"

    def best_in(self, summaries: Mapping[str, Summary]) -> set[str]:
        """Return the names of the best methods, as far as the digits show; empty if all methods are alike."""
        filters = {name: summary for name, summary in summaries.items() if name != BASELINE}
        known = {name: value for name, one in filters.items() if (value := self.value(one)) is not None}
        if self.best is None or len({self.cell(summaries[name]) for name in known}) < 2:
            return set()
        first = (min if self.best == "low" else max)(known, key=lambda name: known[name])
        return {name for name in known if self.cell(summaries[name]) == self.cell(summaries[first])}


def _percent(value: float | None) -> float | None:
    return None if value is None else 100 * value


def _of_points(name: str) -> Callable[[Summary], float | None]:
    return lambda summary: None if summary.points is None else _percent(getattr(summary.points, name))


_F1 = "harmonic mean of precision (detected targets among all alarms) and recall (detected among visible targets)"
FRAMES = Column("frames", "labelled frames", lambda one: one.frames, best=None)
N_FP = Column("N_FP", "frames with a false alarm, a cluster where there is no target", lambda one: one.n_fp)
N_FN = Column("N_FN", "frames with a missed target, one that is visible but not detected", lambda one: one.n_fn)
R_FP = Column("R_FP %", "N_FP in percent of the labelled frames", lambda one: _percent(one.r_fp), 2)
R_FN = Column("R_FN %", "N_FN in percent of the labelled frames", lambda one: _percent(one.r_fn), 2)
F1 = Column("F1", _F1, lambda one: one.f1, 3, best="high")
FALSE_ALARMS = Column("false/frame", "false alarms per labelled frame", lambda one: one.false_alarms_per_frame, 2)
P50 = Column("ms p50", "median time to filter a frame, in milliseconds", lambda one: one.milliseconds(0.5), 2)

FRAME_ERRORS = (N_FP, N_FN, R_FP, R_FN, F1)
ALARMS = (FRAMES, *FRAME_ERRORS, FALSE_ALARMS)
POINTS = (
    Column("clutter removed", "share of the clutter points removed", _of_points("clutter_removal"), 2, " %", "high"),
    Column("target lost", "share of the points of targets removed", _of_points("target_loss"), 2, " %"),
    Column("R_c", "share of clutter among the points that are left", _of_points("clutter_share"), 2, " %"),
)
TIMES = (P50, Column("ms p99", "99th percentile of that time", lambda one: one.milliseconds(0.99), 2))
OBJECTS = (
    Column("precision %", "detected targets among all alarms", lambda one: _percent(one.precision), 1, best="high"),
    Column("recall %", "detected among visible targets", lambda one: _percent(one.recall), 1, best="high"),
    F1,
    Column("noise", "false alarms per labelled frame", lambda one: one.false_alarms_per_frame, 2),
    Column("unclustered", "points per labelled frame in no cluster", lambda one: one.unclustered_per_frame, 1),
    P50,
)
"""Measures of [Bi] for clusters by density."""


def score_table(summaries: Mapping[str, Summary], columns: Sequence[Column]) -> str:
    """Return a table with a row for each method; an asterisk marks the best values of each column."""
    cells = score_cells(summaries, columns)
    heads = (column.head for column in columns)
    return table(("method", *heads), [(name, *cells[name]) for name in summaries])


def score_cells(summaries: Mapping[str, Summary], columns: Sequence[Column]) -> dict[str, list[str]]:
    """Return the cells of each method, with an asterisk before the best values of each column."""
    cells: dict[str, list[str]] = {name: [] for name in summaries}
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
    if _MARK in text:
        lines[_MARK] = "best of the filters in this column"
    if UNKNOWN in text:
        lines[UNKNOWN] = "nothing to count"
    return legend(lines)


@dataclass
class FrameRows:
    """Rows of the frames of one recording, one for each method, and whether the labels of points are known for any."""

    recording: str
    lines: bytearray = field(default_factory=bytearray)
    points_known: bool = False

    def write(self, method: str, frame: Frame, score: FrameScore) -> None:
        """Write a row; cells are empty for what the labels of the frame do not tell."""
        self.points_known |= score.points is not None
        self.lines += csv_line((self.recording, method, frame.index, frame.stamp_ns, *score.cells()))


def frame_table(recordings: Sequence[FrameRows]) -> Iterator[bytes]:
    """Yield the parts of a table (CSV); it has columns for points if their labels are known for any frame."""
    points_known = any(rows.points_known for rows in recordings)
    yield csv_line((*_FRAME_COLUMNS, *(POINT_COLUMNS if points_known else ())))
    for rows in recordings:
        yield bytes(rows.lines if points_known else rows.lines.replace(_UNKNOWN_POINTS, b"\n"))
