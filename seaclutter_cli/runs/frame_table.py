"""Table of an evaluation, with a row for each frame and method."""

import csv
import io
import tempfile
from collections.abc import Iterable
from contextlib import AbstractContextManager, ExitStack
from types import TracebackType
from typing import Self

from seaclutter_cli.errors import OutputError
from seaclutter_cli.evaluation.scores import ALARM_COLUMNS, POINT_COLUMNS, FrameScore
from seaclutter_cli.frame import Frame
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.storage.locations import Location

_COLUMNS = ("recording", "method", "frame", "stamp_ns", *ALARM_COLUMNS)
_UNKNOWN = b"," * len(POINT_COLUMNS) + b"\n"


class FrameTable(AbstractContextManager["FrameTable"]):
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
        self._path = path
        with ExitStack() as stack:
            self._file = stack.enter_context(AtomicFile(path, group))
            self._lines = stack.enter_context(tempfile.TemporaryFile())
            self._stack = stack.pop_all()
        self._complete = 0
        self._points_known = self._points_seen = False
        self._recording = ""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Complete the file, or remove it after an error."""
        with self._stack as stack:
            if kind is not None:
                stack.__exit__(kind, error, trace)
                return
            self._discard_unfinished()
            self._lines.seek(0)
            columns = (*_COLUMNS, *POINT_COLUMNS) if self._points_known else _COLUMNS
            self._file.stream.write(_line(columns))
            for line in self._lines:
                self._file.stream.write(line if self._points_known else line.removesuffix(_UNKNOWN) + b"\n")

    def begin(self, recording: str) -> Self:
        """Start a recording; discard the rows of an unfinished one."""
        self._discard_unfinished()
        self._recording = recording
        return self

    def write(self, method: str, frame: Frame, score: FrameScore) -> None:
        """Write a row."""
        self._points_seen |= score.points is not None
        line = _line((self._recording, method, frame.index, frame.stamp_ns, *score.cells()))
        try:
            self._lines.write(line)
        except OSError as error:
            raise OutputError(f"{self._path}: cannot buffer rows in {tempfile.gettempdir()} ({error})") from error

    def end(self) -> None:
        """End a recording and keep its rows."""
        self._complete = self._lines.tell()
        self._points_known |= self._points_seen

    def _discard_unfinished(self) -> None:
        self._lines.seek(self._complete)
        self._lines.truncate()
        self._points_seen = False


def _line(values: Iterable[object]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(values)
    return text.getvalue().encode(errors="surrogateescape")  # file names need not be UTF-8
