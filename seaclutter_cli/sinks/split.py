"""Parts of a log of limited size or duration."""

import re
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.storage.locations import Location
from seaclutter_cli.storage.objects import list_folder

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "ki": 2**10, "mi": 2**20, "gi": 2**30}
_DURATIONS = {"s": 1, "sec": 1, "min": 60, "h": 3600}
_PATTERN = re.compile(r"(\d+(?:\.\d+)?)\s*([a-z]*)", re.ASCII)


@dataclass(frozen=True)
class Split:
    """Limit of a part of a log: a size or a duration.

    Parameters
    ----------
    size : int, optional
        Bytes of the messages before compression.
    duration_ns : int, optional
        Nanoseconds of log time.

    Examples
    --------
    >>> import seaclutter
    >>> parts = seaclutter.McapOptions(split=seaclutter.Split(duration_ns=2 * 10**9))
    >>> done = seaclutter.convert_log("samples/sea.mcap", folder / "parts.mcap", written=parts)
    >>> [part.name for part in sorted(folder.glob("parts_*.mcap"))]
    ['parts_0.mcap', 'parts_1.mcap', 'parts_2.mcap']
    """

    size: int | None = None
    duration_ns: int | None = None


def parse_split(text: str) -> Split:
    """Return the limit in a text: a size with a unit of bytes, or a duration with a unit of time.

    Raises
    ------
    ValueError
        If it is something else, or not positive.

    Examples
    --------
    >>> parse_split("2GB"), parse_split("1.5 min")
    (Split(size=2000000000, duration_ns=None), Split(size=None, duration_ns=90000000000))
    """
    match = _PATTERN.fullmatch(text.strip().lower())
    if match is None or not float(match[1]):
        raise ValueError(text)
    number, unit = float(match[1]), match[2]
    if unit in _DURATIONS:
        return Split(duration_ns=round(number * _DURATIONS[unit] * 10**9))
    if not unit.endswith("b") or unit[:-1] not in _UNITS:
        raise ValueError(text)
    return Split(size=round(number * _UNITS[unit[:-1]]))


class Parts:
    """Counter that decides where a part ends; parts by duration begin at multiples of it after the first message."""

    def __init__(self, limit: Split | None) -> None:
        self._limit = limit
        self._size = 0
        self._end_ns: int | None = None

    def is_next(self, log_time_ns: int, size: int) -> bool:
        """Return whether a message begins another part, and count it."""
        if self._limit is None:
            return False
        if self._limit.size is not None:
            full = self._size > 0 and self._size + size > self._limit.size
            self._size = size if full else self._size + size
            return full
        duration = self._limit.duration_ns or 1
        if self._end_ns is None:
            self._end_ns = log_time_ns + duration
        full = log_time_ns >= self._end_ns
        if full:
            self._end_ns += ((log_time_ns - self._end_ns) // duration + 1) * duration
        return full


def part_path(path: Location, number: int) -> Location:
    """Return the name of a part of a log.

    Examples
    --------
    >>> from pathlib import Path
    >>> part_path(Path("trial.mcap"), 1).name
    'trial_1.mcap'
    """
    return path.parent / f"{path.name.removesuffix(path.suffix)}_{number}{path.suffix}"


def parts_after(path: Location, number: int) -> list[Location]:
    """Return the existing parts of a log whose numbers are greater than one, in order."""
    pattern = re.compile(re.escape(path.name.removesuffix(path.suffix)) + r"_([1-9]\d{0,8})" + re.escape(path.suffix))
    beside = path.parent.glob("*") if isinstance(path, Path) else list_folder(path.parent)[0]
    found = ((pattern.fullmatch(one.name), one) for one in beside)
    numbers = {int(match[1]): one for match, one in found if match}
    return [numbers[one] for one in sorted(numbers) if one > number]
