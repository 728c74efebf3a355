"""Options of outputs: contents of a log, and parts of limited size or duration."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.buckets import look
from seaclutter_cli.frame import FilterResult
from seaclutter_cli.messages.scene import SceneUpdate
from seaclutter_cli.records import Metadata

ROSBAG2_METADATA = "metadata.yaml"
"""File that describes a ROS 2 recording, in its folder."""

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
    """Return the limit in a text: a size with a unit of bytes, or a duration with a unit of time, or `ValueError`.

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


def part_path(path: Path, number: int) -> Path:
    """Return the name of a part of a log: ``trial_1.mcap`` for part 1 of ``trial.mcap``."""
    return path.parent / f"{path.name.removesuffix(path.suffix)}_{number}{path.suffix}"


def parts_after(path: Path, number: int) -> list[Path]:
    """Return the existing parts of a log whose numbers are greater than one, in order."""
    pattern = re.compile(re.escape(path.name.removesuffix(path.suffix)) + r"_([1-9]\d{0,8})" + re.escape(path.suffix))
    look(path.parent)
    found = ((pattern.fullmatch(one.name), one) for one in path.parent.glob("*"))
    numbers = {int(match[1]): one for match, one in found if match}
    return [numbers[one] for one in sorted(numbers) if one > number]


@dataclass(frozen=True, kw_only=True)
class McapOptions:
    """Contents of a filtered log.

    Parameters
    ----------
    keep_raw : bool
        Keep the raw cloud on its topic and write the filtered cloud to ``<topic>/filtered``.
    with_removed : bool
        Write the removed points with their reasons to ``<topic>/removed``.
    keep_organized : bool
        Preserve the shape of organised clouds; removed points become NaN.
    diagnostics : bool
        Write a message with thresholds, corrections and counts for each frame.
    compression : str or None
        ``zstd``, ``lz4`` or empty for none; None uses the compression of the input, zstd if unknown. ROS 1 bags have
        LZ4 or none, sqlite3 files none.
    split : Split, optional
        Limit of a part of the log; the parts have numbers in their names.
    include, exclude : tuple of str
        Regular expressions for the names of the other topics: those that are written, by default all, and those that
        are left out.
    latched : tuple of str
        Topics whose last message before the start of a part is written, beside those that are known as latched.
    config : str
        Effective configuration as YAML, for the metadata of the file.
    water : bool
        Whether the method estimates the water, which adds level, attitude and wave height to the diagnostics.
    scene : callable, optional
        Function that returns the boxes of a filtered frame, which are written to ``/seaclutter/scene``.
    record : callable, optional
        Function that returns a metadata record about the run when all frames are written.
    method : str
        Name of the method, for the metadata of the file.
    is_part : bool
        Whether only a part of the recording is written.

    Examples
    --------
    >>> import seaclutter
    >>> both = seaclutter.McapOptions(keep_raw=True, with_removed=True)
    >>> done = seaclutter.filter_log("samples/sea.mcap", folder / "both.mcap", written=both)
    >>> with seaclutter.open_log(folder / "both.mcap") as log:
    ...     log.topics
    ('/points', '/points/filtered', '/points/removed')
    """

    keep_raw: bool = False
    with_removed: bool = False
    keep_organized: bool = False
    diagnostics: bool = True
    compression: str | None = None
    split: Split | None = None
    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    latched: tuple[str, ...] = ()
    config: str = ""
    water: bool = False
    scene: Callable[[FilterResult], SceneUpdate] | None = None
    record: Callable[[], Metadata] | None = None
    method: str = ""
    is_part: bool = False

    def takes(self, topic: str) -> bool:
        """Return whether one of the other topics is written."""
        included = not self.include or any(re.search(pattern, topic) for pattern in self.include)
        return included and not any(re.search(pattern, topic) for pattern in self.exclude)
