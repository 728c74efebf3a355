"""CSV table of a filter run, with one row for each frame."""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple

from seaclutter_cli.frame import WATER_COLUMNS, WATER_REASONS, FilterResult, Reason
from seaclutter_cli.interfaces import Sink, Source
from seaclutter_cli.messages.diagnostics import Diagnostics
from seaclutter_cli.records import Channel
from seaclutter_cli.text import harmless

_REASONS = (Reason.INVALID, Reason.NEAR, Reason.LOW_INTENSITY, Reason.OUTLIER, Reason.FAR, Reason.EXCLUDED)
_COLUMNS = (
    *("recording", "topic", "frame", "stamp_ns", "points_in"),
    *(reason.name.lower() for reason in _REASONS),
    "points_out",
)


class FrameTable(Sink):
    """Sink that passes one line for each frame of a recording to a function.

    There are columns for the ``rings`` of the method and, if it distinguishes scenes, the class of scene; if it
    estimates the water, `WATER_REASONS` and those of `WaterState`.
    """

    def __init__(
        self, write: Callable[[bytes], object], rings: int, *, scenes: bool = False, water: bool = False
    ) -> None:
        self._write, self._rings, self._scenes, self._water = write, rings, scenes, water

    def write_header(self) -> None:
        """Write the names of the columns."""
        states = [f"{name}_{k}" for name in ("threshold", "correction") for k in range(1, self._rings + 1)]
        waters = [*(reason.name.lower() for reason in WATER_REASONS), *WATER_COLUMNS] if self._water else []
        self._write(csv_line((*_COLUMNS, *states, *(["scene"] if self._scenes else []), *waters)))

    def begin(self, source: Source, clouds: Sequence[Channel]) -> None:  # noqa: ARG002
        """Start a recording."""
        self._recording = source.name

    def write(self, result: FilterResult) -> None:
        """Write the row of a frame."""
        self.write_row(self._recording, Diagnostics.of(result))

    def write_row(self, recording: str, one: Diagnostics) -> None:
        """Write the row of a frame."""
        rings, counts = one.rings, one.counts
        states = [""] * 2 * self._rings if rings is None else [*rings.thresholds.tolist(), *rings.corrections.tolist()]
        scenes = [one.scene or ""] if self._scenes else []
        # To a tenth of a millimetre or of a thousandth of a degree.
        values = [round(value, 4) for value in astuple(one.water)] if one.water else [""] * len(WATER_COLUMNS)
        waters = [*(counts[reason] for reason in WATER_REASONS), *values] if self._water else []
        numbers = one.frame, one.stamp_ns, one.points_in, *(counts[reason] for reason in (*_REASONS, Reason.KEPT))
        self._write(csv_line((recording, one.topic, *numbers, *states, *scenes, *waters)))


def csv_line(values: Iterable[object]) -> bytes:
    """Return a line of a table (CSV)."""
    return csv_lines([values])


def csv_lines(rows: Iterable[Iterable[object]]) -> bytes:
    """Return lines of a table (CSV); many at once take half the time."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(map(harmless, values) for values in rows)
    return text.getvalue().encode(errors="surrogateescape")  # file names need not be UTF-8
