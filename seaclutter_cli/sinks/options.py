"""Options of outputs."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from seaclutter_cli.frame import FilterResult
from seaclutter_cli.messages.scene import SceneUpdate
from seaclutter_cli.records import Metadata
from seaclutter_cli.sinks.split import Split


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
