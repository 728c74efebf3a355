"""Filtering of points in memory."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.api.arguments import Settings, config_options
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.interfaces import Filter
from seaclutter_cli.validation import merged


def filter_points(
    xyz: NDArray[np.floating],
    intensity: NDArray[Any] | None = None,
    *,
    method: str | None = None,
    config: Settings | None = None,
) -> FilterResult:
    """Filter one point cloud.

    Methods that learn from frame to frame, such as ``joint``, treat it as the first frame of a recording; for the
    frames of a recording, use `make_filter`.

    Parameters
    ----------
    xyz : ndarray, shape (N, 3), float32 or float64
        Coordinates in metres in the frame of the lidar. Points at the origin or with a coordinate that is not finite
        are invalid.
    intensity : ndarray, shape (N,), optional
        Intensity in the sensor's unit.
    method : str, optional
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


def make_filter(method: str | None = None, config: Settings | None = None, **parameters: Any) -> Filter:
    """Return a new filter for the frames of one topic of one recording.

    Parameters
    ----------
    method : str, optional
        Filter method; by default that of the configuration, or ``joint``.
    config : path, mapping or Config, optional
        Configuration file or the name of a built-in one, the content of a file, or a configuration.
    **parameters : optional
        Parameters of the method by their configuration keys; they override the configuration.

    Returns
    -------
    Filter
        Call ``step(frame)`` for each frame in order, and ``reset()`` before another recording. Where
        ``needs_first_pass``, pass all frames to ``observe(frame)`` first.

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
    effective = config_options(method, config).load()
    if parameters:
        effective = config_options(None, merged(effective.as_dict(), {"filter": parameters})).load()
    return effective.make_filter()
