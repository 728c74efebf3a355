"""CSV table of a filter run, with one row for each frame."""

import csv
import io
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import astuple
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.frame import WATER_COLUMNS, FilterResult, Reason, Rings, WaterState
from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Attachment, Channel, Message, Metadata
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup

_REASONS = (Reason.INVALID, Reason.NEAR, Reason.LOW_INTENSITY, Reason.OUTLIER, Reason.FAR, Reason.EXCLUDED)
_COLUMNS = (
    "recording",
    "topic",
    "frame",
    "stamp_ns",
    "points_in",
    *(reason.name.lower() for reason in _REASONS),
    "points_out",
)


class CsvSink(AbstractContextManager["CsvSink"]):
    """Sink that writes one row for each frame of all recordings to a CSV file, which appears when the context ends.

    The rows of a recording that fails midway are removed. There are columns for the ``rings`` of the method and, if it
    distinguishes scenes, the class of scene; if it estimates the water, unconfirmed points and those of `WaterState`.
    """

    def __init__(
        self, path: Path, rings: int, *, scenes: bool = False, water: bool = False, group: OutputGroup | None = None
    ) -> None:
        self._file = AtomicFile(path, group)
        self._states, self._scenes, self._water = 2 * rings, scenes, water
        numbers = range(1, rings + 1)
        states = (*(f"threshold_{k}" for k in numbers), *(f"correction_{k}" for k in numbers))
        columns = (
            *_COLUMNS,
            *states,
            *(["scene"] if scenes else []),
            *(["unconfirmed", *WATER_COLUMNS] if water else []),
        )
        self._file.stream.write(csv_line(columns))
        self._header = self._complete = self._file.stream.tell()
        self._recording = ""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Complete the file under its name, or remove it after an error."""
        if kind is not None:
            self._file.__exit__(kind, error, trace)
            return
        with self._file:
            self._discard_incomplete()

    def begin(self, source: Source, clouds: Sequence[Channel]) -> None:  # noqa: ARG002
        """Start a recording."""
        self._discard_incomplete()
        self._recording = source.name

    def copy(self, record: Message | Attachment | Metadata) -> None:
        """Ignore records that are not filtered."""

    def write(self, result: FilterResult) -> None:
        """Write the row of a frame."""
        frame = result.frame
        place = frame.topic, frame.index, frame.stamp_ns, frame.size
        self.write_row(self._recording, place, result.counts, result.rings, result.scene, result.water)

    def write_row(
        self,
        recording: str,
        place: tuple[str, int, int, int],
        counts: NDArray[np.int64],
        rings: Rings | None,
        scene: str | None,
        water: WaterState | None,
    ) -> None:
        """Write the row of a frame, given its topic, index, stamp in nanoseconds and number of points as ``place``."""
        states = [""] * self._states if rings is None else [*rings.thresholds.tolist(), *rings.corrections.tolist()]
        scenes = [scene or ""] if self._scenes else []
        waters = [counts[Reason.UNCONFIRMED], *_numbers(water)] if self._water else []
        by_reason = (counts[reason] for reason in _REASONS)
        row = (recording, *place, *by_reason, counts[Reason.KEPT], *states, *scenes, *waters)
        self._file.stream.write(csv_line(row))

    def end(self) -> None:
        """End a recording and keep its rows."""
        self._complete = self._file.stream.tell()

    def rows(self) -> bytes:
        """Return the rows of all complete recordings, without the header."""
        self._discard_incomplete()
        self._file.stream.flush()
        return self._file.part.read_bytes()[self._header :]

    def append(self, rows: bytes) -> None:
        """Write the rows of a complete recording, from a table of its own without the header."""
        self._discard_incomplete()
        self._file.stream.write(rows)
        self.end()

    def _discard_incomplete(self) -> None:
        self._file.stream.seek(self._complete)
        self._file.stream.truncate()


def _numbers(water: WaterState | None) -> list[float | str]:
    """Return the values of the columns of the water, to a tenth of a millimetre or of a thousandth of a degree."""
    return [""] * len(WATER_COLUMNS) if water is None else [round(value, 4) for value in astuple(water)]


def csv_line(values: Iterable[object]) -> bytes:
    """Return a line of a table (CSV)."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(values)
    return text.getvalue().encode(errors="surrogateescape")  # file names need not be UTF-8
