"""Options of outputs: contents of a log, and parts of limited size or duration."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from seaclutter_cli.buckets import look
from seaclutter_cli.errors import UsageError
from seaclutter_cli.options import Anything, Choice, Converted, Options, Parsed, option
from seaclutter_cli.registry import imported
from seaclutter_cli.text import shortened

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from seaclutter_cli.frame import FilterResult
    from seaclutter_cli.messages.scene import SceneUpdate
    from seaclutter_cli.records import Metadata
    from seaclutter_cli.sinks.objects import LiveObjects

FORMAT = Choice(
    ("mcap", "bag", "rosbag2-db3", "rosbag2-mcap", "pcd", "las", "laz", "npz"),
    lambda: imported("sinks.formats.OUTPUT_FORMATS").added,
)
"""One of `OUTPUT_FORMATS`, whose import would slow down the help."""

TIMES = "times.txt"
"""File in a folder of frames with the time of each frame in seconds."""

ROSBAG2_METADATA = "metadata.yaml"
"""File that describes a ROS 2 recording, in its folder."""

_MATCH_S = 1.0
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
    >>> limit = seaclutter.Split(duration_ns=2 * 10**9)
    >>> done = seaclutter.convert_log("samples/sea.mcap", folder / "parts.mcap", split=limit)
    >>> [part.name for part in sorted(folder.glob("parts_*.mcap"))]
    ['parts_0.mcap', 'parts_1.mcap', 'parts_2.mcap']
    """

    size: int | None = None
    duration_ns: int | None = None


def parse_split(text: str) -> Split:
    """Return the limit in a text: a size with a unit of bytes, or a duration with a unit of time; or `ValueError`."""
    match = _PATTERN.fullmatch(text.strip().lower())
    number, unit = (float(match[1]), match[2]) if match else (0.0, "")
    if number and unit in _DURATIONS:
        return Split(duration_ns=round(number * _DURATIONS[unit] * 10**9))
    if number and unit.endswith("b") and unit[:-1] in _UNITS:
        return Split(size=round(number * _UNITS[unit[:-1]]))
    raise ValueError(f"{text}: expected a size such as 2GB, or a duration such as 10min")


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


def matches(pattern: str, topic: str) -> bool:
    """Return whether the name of a topic contains a match of a regular expression.

    Raise `UsageError` if that takes too long, as that of ``(a|aa)+$`` would in the library of Python.
    """
    import regex  # takes time, and is seldom needed

    try:
        return regex.search(pattern, topic, timeout=_MATCH_S) is not None
    except TimeoutError as error:
        raise UsageError(f"{pattern}: takes too long to find in {shortened(topic, 60)}; simplify it") from error


def _pattern(text: str) -> str:
    import regex

    try:
        regex.compile(text)
    except regex.error as error:
        raise ValueError(f"{text}: not a regular expression ({error})") from error
    return text


class ContentOptions(Options):
    """Contents of a filtered log."""

    place = 2

    keep_raw: bool = option(
        "--keep-raw", "Keep the raw cloud on its topic; write the filtered one to TOPIC/filtered.", default=False
    )
    with_removed: bool = option(
        "--with-removed", "Write removed points to TOPIC/removed, with the reason.", default=False
    )
    keep_organized: bool = option(
        "--keep-organized", "Keep the shape of organised clouds; set removed points to NaN.", default=False
    )
    diagnostics: bool = option(
        "--diagnostics/--no-diagnostics", "Write the topic /seaclutter/diagnostics, or leave it out.", default=True
    )
    compression: str | None = option(
        "--compression",
        "Compression of the output; by default that of the input, or the usual one of the format.",
        default=None,
        kind=Choice({"zstd": "zstd", "lz4": "lz4", "none": ""}),
    )
    split: Converted[Split | str | None, Split | None] = option(
        "--split LIMIT",
        "Write parts of at most this size before compression (500MB, 2GiB) or duration (30s, 10min, 1h).",
        default=None,
        kind=Parsed(parse_split),
    )
    include: Converted[str | Sequence[str], tuple[str, ...]] = option(
        "--include REGEX",
        "Of the other topics, write only those whose name contains a match; repeatable.",
        default=(),
        kind=Parsed(_pattern),
    )
    exclude: Converted[str | Sequence[str], tuple[str, ...]] = option(
        "--exclude REGEX",
        "Leave out other topics whose name contains a match; repeatable.",
        default=(),
        kind=Parsed(_pattern),
    )
    latched: Converted[str | Sequence[str], tuple[str, ...]] = option(
        "--latched TOPIC",
        "Keep the last message of TOPIC before --start, as of /tf_static and other latched topics; repeatable.",
        default=(),
    )

    @property
    def written(self) -> McapOptions:
        """These options alone, for a sink."""
        return self.part(McapOptions(), ContentOptions)

    def takes(self, topic: str) -> bool:
        """Return whether one of the other topics is written."""
        included = not self.include or any(matches(pattern, topic) for pattern in self.include)
        return included and not any(matches(pattern, topic) for pattern in self.exclude)


class McapOptions(ContentOptions):
    """Contents of a filtered log, and what a run fills in."""

    config: str = option("", "Effective configuration as YAML.", default="")
    water: bool = option("", "Whether the method estimates the water, for the diagnostics.", default=False)
    scene: Callable[[FilterResult], SceneUpdate] | None = option(
        "", "Function that returns the boxes of a filtered frame.", default=None, kind=Anything()
    )
    objects: LiveObjects | None = option(
        "", "Objects of filtered frames, with ids and velocities.", default=None, kind=Anything()
    )
    record: Callable[[], Metadata] | None = option(
        "", "Function that returns the record of the run when all frames are written.", default=None, kind=Anything()
    )
    method: str = option("", "Name of the method.", default="")
    is_part: bool = option("", "Whether only a part of the recording is written.", default=False)
    as_is: bool = option("", "Whether frames are written as they are, and nothing is added.", default=False)
