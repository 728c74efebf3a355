"""Markdown tables of scores."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scores import BINS, RANGES_M

Record = Mapping[str, Any]
Key = Callable[[Record], str]
SUMS = (
    *("frames", "N_FP", "N_FN", "targets", "not_visible", "detected", "false_alarms"),
    *("target_points_in", "target_points_out", "clutter_points_in", "clutter_points_out"),
)


def row(*cells: object) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def header(names: Sequence[str], columns: Iterable[str]) -> list[str]:
    """Return the first two lines of a table: columns of names, then columns of numbers."""
    columns = list(columns)
    return [row(*names, *columns), row(*["---"] * len(names), *["---:"] * len(columns))]


def grouped(records: Iterable[Record], key: Key) -> dict[str, list[Record]]:
    """Return the records of each value of a key, in order of appearance."""
    groups: dict[str, list[Record]] = defaultdict(list)
    for record in records:
        groups[key(record)].append(record)
    return dict(groups)


class Rates:
    """Rates in percent over the frames of some records; NaN without frames, targets or points."""

    def __init__(self, records: Iterable[Record]) -> None:
        total = dict.fromkeys(SUMS, 0)
        for record in records:
            for name in SUMS:
                total[name] += record["scores"].get(name, 0)
        self.r_fp = percent(total["N_FP"], total["frames"])
        visible = total["targets"] - total["not_visible"]
        self.r_fn = percent(total["N_FN"], total["frames"]) if visible else np.nan
        self.recall = percent(total["detected"], visible)
        self.lost = 100 - percent(total["target_points_out"], total["target_points_in"])
        self.clutter_removed = 100 - percent(total["clutter_points_out"], total["clutter_points_in"])


def percent(part: float, whole: float) -> float:
    return 100 * part / whole if whole else np.nan


def shown(value: float, digits: int = 1) -> str:
    return "-" if np.isnan(value) else f"{value:.{digits}f}"


def summary(records: Sequence[Record], parts: Key, name: str = "scene") -> str:
    """Return mean and worst of the rates of each method over the parts of the recordings: scenes, layouts, lidars."""
    lines = header(
        ["method"], ["R_FP %", "R_FN %", "object recall %", "target points lost %", f"worst {name}: R_FP %", "R_FN %"]
    )
    for method, of_method in grouped(records, by_method).items():
        rates = [Rates(group) for group in grouped(of_method, parts).values()]
        mean = {key: np.nanmean([getattr(one, key) for one in rates]) for key in ("r_fp", "r_fn", "recall", "lost")}
        worst = (np.nanmax([getattr(one, key) for one in rates]) for key in ("r_fp", "r_fn"))
        cells = (shown(value, 2) for value in (*mean.values(), *worst))
        lines.append(row(f"`{method}`", *cells))
    return "\n".join(lines)


def matrix(records: Sequence[Record], parts: Key, cell: Callable[[Rates], str]) -> str:
    """Return a table of one cell per method (row) and part of the recordings (column)."""
    columns = grouped(records, parts)
    lines = header(["method"], columns)
    for method, of_method in grouped(records, by_method).items():
        found = grouped(of_method, parts)
        lines.append(row(f"`{method}`", *(cell(Rates(found[name])) if name in found else "" for name in columns)))
    return "\n".join(lines)


def both_rates(rates: Rates) -> str:
    return f"{shown(rates.r_fp)} / {shown(rates.r_fn)}"


def recall(rates: Rates) -> str:
    return shown(rates.recall)


def lost(rates: Rates) -> str:
    return shown(rates.lost)


def over_seeds(records: Sequence[Record], floor: Sequence[Record]) -> str:
    """Return a method's rates in each scene with their range over the seeds, and what no filter could find."""
    lines = header(["scene"], ["R_FP %", "R_FN %", "R_FN, ideal %", "object recall %", "target points lost %"])
    ideal = grouped(floor, by_scene)
    for scene, group in grouped(records, by_scene).items():
        rates = [Rates([record]) for record in group]
        spread = {key: _spread([getattr(one, key) for one in rates]) for key in ("r_fp", "r_fn", "recall", "lost")}
        least = shown(Rates(ideal[scene]).r_fn)
        lines.append(row(f"`{scene}`", spread["r_fp"], spread["r_fn"], least, spread["recall"], spread["lost"]))
    return "\n".join(lines)


def _spread(values: Sequence[float]) -> str:
    """Return mean and range."""
    if np.isnan(values).any():
        return "-"
    return f"{np.mean(values):.2f} ({min(values):.2f} to {max(values):.2f})"


def by_target(records: Sequence[Record], name: str) -> str:
    """Return detected targets and lost echoes of each method by range or size, and false alarms by range."""
    methods = grouped(records, by_method)
    edges = BINS[name]
    columns = [f"`{method}`: {what}" for method in methods for what in ("detected %", "echoes lost %")]
    lines = header([name], ["targets", *columns])
    totals = [np.sum([record["by_target"][name] for record in group], axis=0) for group in methods.values()]
    for k, label in enumerate(_labels(edges)):
        cells = [text for total in totals for text in _target_cells(total[k])]
        if totals[0][k, 0]:
            lines.append(row(label, int(totals[0][k, 0]), *cells))
    return "\n".join(lines)


def _target_cells(counts: Sequence[int]) -> tuple[str, str]:
    visible, detected, before, after = counts
    return shown(percent(detected, visible), 2), shown(100 - percent(after, before), 2)


def false_alarms(records: Sequence[Record]) -> str:
    """Return the false alarms of each method in 100 frames by range."""
    methods = grouped(records, by_method)
    lines = header(["range"], (f"`{method}`" for method in methods))
    totals = [np.sum([one["by_target"]["false_alarms"] for one in group], axis=0) for group in methods.values()]
    frames = [sum(one["by_target"]["frames"] for one in group) for group in methods.values()]
    for k, label in enumerate(_labels(RANGES_M)):
        lines.append(row(label, *(shown(percent(n[k], m), 2) for n, m in zip(totals, frames, strict=True))))
    return "\n".join(lines)


def _labels(edges: Sequence[float]) -> list[str]:
    return [f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more" for low, high in pairwise(edges)]


def by_method(record: Record) -> str:
    return str(record["method"])


def by_scene(record: Record) -> str:
    return str(record["scene"])


def by_lidar(record: Record) -> str:
    return str(record["lidar"])
