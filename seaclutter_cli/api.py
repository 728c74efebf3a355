"""Names of the API that are no use cases: logs as iterators of frames, and filters for points in memory."""

from __future__ import annotations

from collections import defaultdict
from contextlib import AbstractContextManager, ExitStack
from typing import TYPE_CHECKING, Any

from seaclutter_cli.buckets import local_copy, naming, shown
from seaclutter_cli.config import load_config
from seaclutter_cli.errors import FieldError, UsageError
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.messages import find_codec
from seaclutter_cli.options import function_of, option
from seaclutter_cli.pipeline import HeldRecord, RecordHolder
from seaclutter_cli.reading import read, with_attitudes
from seaclutter_cli.runs.options import ConfigOptions, Decoding, OfLogs, Places, ReadOptions
from seaclutter_cli.runs.recordings import expand, open_recording
from seaclutter_cli.selection import cloud_channels

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from seaclutter_cli.config import Config
    from seaclutter_cli.interfaces import Filter, Source
    from seaclutter_cli.records import Damage, SensorFacts
    from seaclutter_cli.runs.options import MethodLike
    from seaclutter_cli.selection import Moment
    from seaclutter_cli.urls import PathLike

    Settings = PathLike | Mapping[str, Any] | Config


class OpenOptions(Decoding):
    """Options for opening a recording."""

    path: PathLike = option(
        "LOG",
        "MCAP file, ROS 1 or ROS 2 bag, packet capture, folder of frames, single frame, or a folder or glob that "
        "contains one recording of several files.",
        kind=Places(),
        kw_only=False,
    )


@function_of(OpenOptions)
def open_log(options: OpenOptions) -> Log:
    """Open a recording in any supported format.

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
    with ExitStack() as stack:
        local = stack.enter_context(local_copy(options.path))
        recordings = expand(OfLogs(logs=local))
        if len(recordings) > 1:
            names = ", ".join(str(recording.paths[0]) for recording in recordings)
            raise UsageError(f"{local}: contains {len(recordings)} recordings; open one of {names}")
        return Log(open_recording(recordings[0], options), stack.pop_all().close)


class Log(AbstractContextManager["Log"]):
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

    def __exit__(self, *error: object) -> None:
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
        chosen = ReadOptions(topics=topics, start_s=start_s, end_s=end_s, frames=limit, intensity_field=intensity_field)
        source, selection = self._source, chosen.selection
        with naming():
            records = read(source, cloud_channels(source, selection.topics), selection)
            for _, frame in with_attitudes(records, source.channels):
                if frame is not None:
                    yield frame

    def close(self) -> None:
        """Close the recording; frames already read remain valid."""
        self._source.close()
        self._source.warnings[:], self._source.damage[:] = self.warnings, self.damage
        self._release()


def filter_frames(
    frames: Iterable[Frame], method: MethodLike | None = None, config: Settings | None = None, **parameters: Any
) -> Iterator[FilterResult]:
    """Filter the frames of one recording, with the results of the command line.

    A result is yielded when it is complete, which may be some frames later if the method looks ahead; those of a topic
    in the order of its frames.

    Parameters
    ----------
    frames : iterable of Frame
        Frames in order, such as `Log.frames`. For a method with a first pass, something that can be iterated over
        twice, such as a list.
    method : str, class, object or function, optional
        Filter method; by default that of the configuration, or ``joint``.
    config : path, mapping or Config, optional
        Configuration file or the name of a built-in one, the content of a file, or a configuration.
    **parameters : optional
        Parameters of the method by their configuration keys; they override the configuration.

    Raises
    ------
    ConfigError
        If a method or parameter is unknown, or a value is not allowed.
    FieldError
        If a frame lacks a field that the method needs.

    Examples
    --------
    >>> import seaclutter
    >>> with seaclutter.open_log("samples/sea.mcap") as log:
    ...     results = list(seaclutter.filter_frames(log.frames(limit=2), "joint"))
    >>> [(result.frame.index, int(result.keep.sum())) for result in results]
    [(0, 266), (1, 195)]
    """
    chosen = _configured(method, config, parameters)
    filters: dict[str, Filter] = defaultdict(chosen.make_filter)
    if chosen.make_filter().needs_first_pass:
        if iter(frames) is frames:
            raise UsageError(f"{chosen.method} needs all frames before the first result: give a list of them")
        for frame in frames:
            filters[frame.topic].observe(frame)
    holders: dict[str, RecordHolder] = {}
    for frame in frames:
        if frame.topic not in holders:
            holders[frame.topic] = RecordHolder({frame.topic: [filters[frame.topic]]})
        yield from _results(holders[frame.topic].add(frame.message, frame))
    for holder in holders.values():
        yield from _results(holder.finish())


def _results(complete: Iterable[HeldRecord]) -> Iterator[FilterResult]:
    for held in complete:
        [result] = held.results
        if isinstance(result, FieldError):
            raise result
        if result:
            yield result


def filter_points(
    xyz: NDArray[np.floating],
    intensity: NDArray[Any] | None = None,
    *,
    method: MethodLike | None = None,
    config: Settings | None = None,
) -> FilterResult:
    """Filter one point cloud.

    Methods that learn from frame to frame, such as ``joint``, treat it as the first frame of a recording; for the
    frames of a recording, use `filter_frames`.

    Parameters
    ----------
    xyz : ndarray, shape (N, 3), float32 or float64
        Coordinates in metres in the frame of the lidar. Points at the origin or with a coordinate that is not finite
        are invalid.
    intensity : ndarray, shape (N,), optional
        Intensity in the sensor's unit.
    method : str, class, object or function, optional
        Filter method; by default that of the configuration, or ``joint``.
    config : path, mapping or Config, optional
        Configuration file or the name of a built-in one, the content of a file, or a configuration.

    Returns
    -------
    FilterResult
        ``keep``, shape (N,), bool, and ``reason``, shape (N,), uint8: a `Reason` for every point.

    Raises
    ------
    ValueError
        If the shapes do not match.
    ConfigError
        If the configuration is not valid.
    FieldError
        If the method needs intensities and ``intensity`` is None.

    Examples
    --------
    >>> import numpy as np
    >>> import seaclutter
    >>> xyz = np.array([[20.0, 0, 0], [20, 1, 0], [30, 0, 0], [5, 0, 0]])
    >>> result = seaclutter.filter_points(xyz, np.array([90, 80, 3, 70]))
    >>> result.keep
    array([ True,  True, False, False])
    >>> [seaclutter.Reason(code).name for code in result.reason.tolist()]
    ['KEPT', 'KEPT', 'LOW_INTENSITY', 'NEAR']
    """
    chosen = make_filter(method, config)
    frame = Frame.of_arrays(xyz, intensity)
    if chosen.needs_first_pass:
        chosen.observe(frame)
    return chosen.step(frame)


def make_filter(method: MethodLike | None = None, config: Settings | None = None, **parameters: Any) -> Filter:
    """Return a new filter for the frames of one topic of one recording, if `filter_frames` is not enough.

    Parameters
    ----------
    method : str, class, object or function, optional
        Filter method; by default that of the configuration, or ``joint``.
    config : path, mapping or Config, optional
        Configuration file or the name of a built-in one, the content of a file, or a configuration.
    **parameters : optional
        Parameters of the method by their configuration keys; they override the configuration.

    Returns
    -------
    Filter
        Call ``step(frame)`` for each frame in order, and ``reset()`` before another recording. Where
        ``needs_first_pass``, pass all frames to ``observe(frame)`` first. ``step`` decides at once; a method that looks
        ahead decides better with ``process(frame)``, which returns the results that are complete, and ``flush()``.

    Raises
    ------
    ConfigError
        If a method or parameter is unknown, or a value is not allowed.

    Examples
    --------
    >>> import numpy as np
    >>> import seaclutter
    >>> sor = seaclutter.make_filter("sor", neighbors=2, std_ratio=0.5)
    >>> xyz = np.array([[0.0, 0, 1], [0.1, 0, 1], [0.2, 0, 1], [9, 0, 1]])
    >>> sor.step(seaclutter.Frame.of_arrays(xyz)).keep
    array([ True,  True,  True, False])
    """
    return _configured(method, config, parameters).make_filter()


def _configured(method: MethodLike | None, config: Settings | None, parameters: Mapping[str, Any]) -> Config:
    settings = {f"filter.{key}": value for key, value in parameters.items()}
    options = ConfigOptions(config=config, method=method, settings=settings)
    return load_config(options.config, method=options.method, overrides=options.settings, origin="configuration")
