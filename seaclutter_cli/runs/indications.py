"""Indications of the quality of methods, where nobody labelled: their table, and when they are shown."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from seaclutter_cli.errors import UsageError
from seaclutter_cli.pipeline import Filtered
from seaclutter_cli.runs.methods import Variant
from seaclutter_cli.runs.options.logs import EvaluateOptions
from seaclutter_cli.text import UNKNOWN, legend, table

if TYPE_CHECKING:
    from seaclutter_cli.suspects.indications import Indications

_COLUMNS = (
    ("targets lost", "targets_lost", 100, 1, " %", "share of the looks at likely targets in which they are removed"),
    ("doubtful/frame", "doubtful_per_frame", 1, 2, "", "kept clusters per frame that are unlike targets"),
    ("F1", "f1", 1, 3, "", "of these two, as if likely targets were labelled"),
    ("flicker/min", "changes_per_minute", 1, 1, "", "how often a likely target comes or goes in a minute"),
    ("kept", "score_of_kept", 1, 2, "", "mean likeness to targets of what is kept, from 0 to 1"),
    ("removed", "score_of_removed", 1, 2, "", "the same of what is removed"),
    ("water", "water_kept", 100, 2, " %", "share of the points near the water that are kept"),
    ("agrees", "agreement", 100, 1, " %", "share of the points that are treated as other methods do"),
)
_NOTE = "Indications, not rates: likely targets are bodies that stand out, stay, and move steadily."


def check_labelled(options: EvaluateOptions) -> None:
    """Raise `UsageError` unless there are labels or indications are wanted, and not both."""
    if not options.labels and not options.without_labels:
        raise UsageError("Missing option '--labels'; --without-labels shows indications that need none")
    if options.labels and options.without_labels:
        raise UsageError("--without-labels: leave out --labels")


class Indicated(Protocol):
    """Outcome that receives indications."""

    indications: "Indications | None"


def indicated(every: Iterable[Filtered], variants: Sequence[Variant], outcome: Indicated) -> Iterator[Filtered]:
    """Yield filtered frames, and store what they indicate at the end."""
    from seaclutter_cli.runs.suspects import mounting_of  # not needed with labels
    from seaclutter_cli.suspects.indications import Indicator

    indicator = Indicator(len(variants), mounting_of(variants[0].config))
    for frame, results, seconds in every:
        indicator.add(frame, results)
        yield frame, results, seconds
    outcome.indications = indicator.finish()


def sums_of(found: "Sequence[Indications]", names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return what the sums over several recordings indicate for each method."""
    from seaclutter_cli.suspects.indications import Indications

    total = Indications()
    for one in found:
        total.update(one)
    return {name: total.of_method(m) for m, name in enumerate(names)}


def indications_text(found: Mapping[str, Mapping[str, Any]], title: str) -> str:
    """Return indications as human-readable text."""
    rows = []
    for name, values in found.items():
        cells = (_cell(values[key], factor, digits, unit) for _, key, factor, digits, unit, _ in _COLUMNS)
        rows.append((name, *cells))
    heads = [head for head, *_ in _COLUMNS]
    meanings = {head: meaning for head, *_, meaning in _COLUMNS}
    if any(UNKNOWN in row for row in rows):
        meanings[UNKNOWN] = "nothing to count"
    return f"{title}\n\n{table(('method', *heads), rows)}\n\n{_NOTE}\n\n{legend(meanings)}"


def _cell(value: float | None, factor: int, digits: int, unit: str) -> str:
    return UNKNOWN if value is None else f"{factor * value:.{digits}f}{unit}"
