"""Log files of runs: what is shown on the terminal, and details, with times."""

import logging
import time
from pathlib import Path

from seaclutter_cli.errors import OutputError
from seaclutter_cli.text import printable

_FIRST_LINE = "# seaclutter log\n"


class LogFile:
    """A text file to which runs append lines: time in UTC, level, text.

    Parameters
    ----------
    path : Path
        New or empty file, or an earlier log file.

    Raises
    ------
    OutputError
        If it is another file, or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        try:
            known = _beginning(path)
            if known and known != _FIRST_LINE.encode():
                raise OutputError(f"{path}: is not a log file; choose another one for --log-file")
            path.parent.mkdir(exist_ok=True)  # as for other outputs: the last folder
            with path.open("a", encoding="utf-8") as file:
                file.write("" if known else _FIRST_LINE)
            handler = logging.FileHandler(path, encoding="utf-8", errors="backslashreplace")
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error.strerror})") from error
        formatter = logging.Formatter("%(asctime)s %(levelname)s %(message)s", "%Y-%m-%dT%H:%M:%SZ")
        formatter.converter = time.gmtime
        handler.setFormatter(formatter)
        self._logger = logging.Logger("seaclutter")  # noqa: LOG001 - of this file only
        self._logger.addHandler(handler)

    def add(self, text: str, level: int = logging.INFO) -> None:
        """Append a line."""
        self._logger.log(level, "%s", printable(text))


def _beginning(path: Path) -> bytes:
    if not path.is_file():
        return b""
    with path.open("rb") as file:
        return file.read(len(_FIRST_LINE))
