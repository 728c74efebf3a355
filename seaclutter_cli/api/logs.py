"""Logs as iterators of frames."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

from seaclutter_cli.buckets import local_copy, naming, shown
from seaclutter_cli.errors import UsageError
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import find_codec
from seaclutter_cli.reading import frames
from seaclutter_cli.records import Damage, SensorFacts
from seaclutter_cli.runs.recordings import PathLike, ReadOptions, expand
from seaclutter_cli.selection import Moment, Selection


def open_log(
    path: PathLike,
    *,
    rate_hz: float = 10.0,
    calibration: PathLike | None = None,
    sensor: str | None = None,
    integrate_ms: float | None = None,
) -> "Log":
    """Open a recording in any supported format.

    Parameters
    ----------
    path : path
        MCAP file, ROS 1 or ROS 2 bag, packet capture, folder of frames, single frame, or a folder or glob that
        contains one recording of several files.
    rate_hz : float, optional
        Frames per second of recordings without time stamps.
    calibration : path, optional
        File with angles or metadata of the sensor, for packets that lack them.
    sensor : str, optional
        Sensor model, for packets that do not identify it.
    integrate_ms : float, optional
        Duration of a frame in milliseconds, for lidars whose scans do not repeat.

    Returns
    -------
    Log
        A context manager; iterate over `Log.frames`.

    Raises
    ------
    InputError
        If the recording cannot be read.
    UsageError
        If there is no such file, or the path denotes several recordings.

    Examples
    --------
    >>> import seaclutter
    >>> with seaclutter.open_log("samples/sea.mcap") as log:
    ...     print(log.name, log.format, log.topics)
    sea MCAP ('/points',)
    """
    file = Path(calibration) if calibration else None
    reading = ReadOptions(rate_hz=rate_hz, calibration=file, sensor=sensor, integrate_ms=integrate_ms)
    with ExitStack() as stack:
        local = stack.enter_context(local_copy(path))
        recordings = expand(local)
        if len(recordings) > 1:
            names = ", ".join(str(recording.paths[0]) for recording in recordings)
            raise UsageError(f"{local}: contains {len(recordings)} recordings; open one of {names}")
        return Log(reading.open(recordings[0]), stack.pop_all().close)


class Log:
    """A recording opened by `open_log`; as a context manager, it closes the recording.

    Parameters
    ----------
    source : Source
        The recording.
    release : callable, optional
        Called when it is closed.

    Examples
    --------
    >>> import seaclutter
    >>> with seaclutter.open_log("samples/sea.mcap") as log:
    ...     frame = next(log.frames())
    >>> frame.xyz.shape, frame.xyz.dtype, frame.intensity.shape
    ((2012, 3), dtype('float64'), (2012,))
    """

    def __init__(self, source: Source, release: Callable[[], object] = lambda: None) -> None:
        self._source, self._release = source, release

    def __enter__(self) -> Self:
        """Return the log."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the log."""
        self.close()

    @property
    def name(self) -> str:
        """Name of the recording in tables and file names."""
        return self._source.name

    @property
    def format(self) -> str:
        """Format of the recording, such as ``MCAP`` or ``ROS 1 bag``."""
        return self._source.format

    @property
    def topics(self) -> tuple[str, ...]:
        """Point-cloud topics that can be read, compressed clouds and laser scans included."""
        return tuple(dict.fromkeys(channel.topic for channel in self._source.channels if find_codec(channel)))

    @property
    def sensors(self) -> Mapping[str, SensorFacts]:
        """Facts about the sensor of each topic, from packets; complete once all frames have been read."""
        return self._source.facts

    @property
    def warnings(self) -> Sequence[str]:
        """Warnings about the recording; grows while frames are read."""
        return shown(self._source.warnings)

    @property
    def damage(self) -> Sequence[Damage]:
        """Parts that could not be read; grows while frames are read."""
        return shown(self._source.damage)

    def frames(
        self,
        topics: str | Sequence[str] = (),
        *,
        start_s: Moment | None = None,
        end_s: Moment | None = None,
        limit: int | None = None,
        intensity_field: str | None = None,
    ) -> Iterator[Frame]:
        """Yield frames in order of log time, with one frame in memory at a time; can be called repeatedly.

        Parameters
        ----------
        topics : str or sequence of str, optional
            Point-cloud topics; by default the only one.
        start_s, end_s : float or datetime, optional
            Limits: seconds from the start of the recording, or dates and times; the end is not included. Parts
            outside are skipped if the format allows it.
        limit : int, optional
            Maximum number of frames of each topic.
        intensity_field : str, optional
            Name of the intensity field, if it has no usual name.

        Raises
        ------
        InputError
            If the recording contains no point clouds.
        UsageError
            If a topic does not exist, or there are several and none is chosen.

        Examples
        --------
        >>> import seaclutter
        >>> with seaclutter.open_log("samples/sea.mcap") as log:
        ...     [(frame.topic, frame.index, frame.size) for frame in log.frames(start_s=1.0, limit=2)]
        [('/points', 10, 2145), ('/points', 11, 2214)]
        """
        chosen = (topics,) if isinstance(topics, str) else tuple(topics)
        selection = Selection(
            topics=chosen, start_s=start_s, end_s=end_s, frames=limit, intensity_field=intensity_field
        )
        with naming():
            yield from frames(self._source, selection)

    def close(self) -> None:
        """Close the recording; frames already read remain valid."""
        self._source.close()
        self._source.warnings[:], self._source.damage[:] = self.warnings, self.damage
        self._release()
