"""Table of an evaluation, with a row for each frame and method."""

import csv
import io
import tempfile
import zlib
from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from seaclutter_cli.errors import OutputError
from seaclutter_cli.evaluation.scores import ALARM_COLUMNS, POINT_COLUMNS, FrameScore
from seaclutter_cli.frame import Frame
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.storage.locations import Location

_COLUMNS = ("recording", "method", "frame", "stamp_ns", *ALARM_COLUMNS)
_UNKNOWN = b"," * len(POINT_COLUMNS) + b"\n"


@dataclass(frozen=True)
class PackedRows:
    """Rows of frames on their way from another process.

    Parameters
    ----------
    lines : bytes
        The lines, compressed.
    points_known : bool
        Whether labels of points are known for any of the frames.
    """

    lines: bytes
    points_known: bool


class FrameRows(AbstractContextManager["FrameRows"]):
    """Rows of frames in a temporary file; the rows of a recording that fails midway are removed."""

    def __init__(self) -> None:
        self._lines = tempfile.TemporaryFile()  # noqa: SIM115 - closed at the end of the context
        self._complete = 0
        self._points_known = self._points_seen = False
        self._recording = ""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Remove the temporary file."""
        self._lines.close()

    def begin(self, recording: str) -> Self:
        """Start a recording; discard the rows of an unfinished one."""
        self._discard_unfinished()
        self._recording = recording
        return self

    def write(self, method: str, frame: Frame, score: FrameScore) -> None:
        """Write a row."""
        self._points_seen |= score.points is not None
        self._add(_line((self._recording, method, frame.index, frame.stamp_ns, *score.cells())))

    def end(self) -> None:
        """End a recording and keep its rows."""
        self._complete = self._lines.tell()
        self._points_known |= self._points_seen

    def packed(self) -> PackedRows:
        """Return the rows of all complete recordings, compressed."""
        self._discard_unfinished()
        self._lines.seek(0)
        return PackedRows(zlib.compress(self._lines.read()), self._points_known)

    def append(self, rows: PackedRows) -> None:
        """Append the rows of complete recordings."""
        self._discard_unfinished()
        self._points_seen = rows.points_known
        self._add(zlib.decompress(rows.lines))
        self.end()

    def _add(self, lines: bytes) -> None:
        try:
            self._lines.write(lines)
        except OSError as error:
            raise OutputError(f"cannot buffer rows in {tempfile.gettempdir()} ({error})") from error

    def _discard_unfinished(self) -> None:
        self._lines.seek(self._complete)
        self._lines.truncate()
        self._points_seen = False


class FrameTable(FrameRows):
    """Table of the frames of all recordings of an evaluation (CSV).

    Rows are kept in a temporary file until the end, because the columns for points are only written if the labels of
    points are known for any frame of any recording. Cells are empty for frames without such labels. A frame without a
    label also has a row, with empty cells for values that need labels.

    Parameters
    ----------
    path : Path or Url
        The file; it is created when the context exits without an error.
    group : OutputGroup, optional
        Files that appear together with this one.
    """

    def __init__(self, path: Location, group: OutputGroup | None = None) -> None:
        self._file = AtomicFile(path, group)
        super().__init__()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Complete the file, or remove it after an error."""
        with self._lines:
            if kind is not None:
                self._file.__exit__(kind, error, trace)
                return
            with self._file as file:
                self._discard_unfinished()
                self._lines.seek(0)
                columns = (*_COLUMNS, *POINT_COLUMNS) if self._points_known else _COLUMNS
                file.stream.write(_line(columns))
                for line in self._lines:
                    file.stream.write(line if self._points_known else line.removesuffix(_UNKNOWN) + b"\n")


def _line(values: Iterable[object]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(values)
    return text.getvalue().encode(errors="surrogateescape")  # file names need not be UTF-8
