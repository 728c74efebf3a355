"""Errors that the program raises deliberately.

    SeaclutterError        exit status 1, one line for the user
    ├── InputError         the input cannot be read or contains no data
    │   ├── CloudError     a message is not a valid point cloud
    │   ├── UnsupportedCloudError  clouds are stored in a form that cannot be read
    │   └── FieldError     a field is missing or has the wrong type
    ├── LabelError         labels cannot be read or do not match the recording
    ├── MethodError        a method that is not built in failed
    ├── ModelError         a trained model cannot be read or does not match the task
    ├── OutputError        the output cannot be written
    ├── ClusterError       a cluster cannot be used, or is gone
    ├── MissingExtraError  an optional dependency is not installed
    └── UsageError         exit status 2
        ├── ConfigError    a config file or value is not valid
        ├── TopicError     a recording lacks a selected topic, or one of its topics has to be selected
        └── SelectionError no frame is in the selected part of a recording

A message says what is wrong, where, and what to do.
"""

from collections.abc import Iterator
from contextlib import contextmanager


class RenamedKeyWarning(FutureWarning):
    """A configuration or scene uses the former name of a key; a later major release will reject it."""


class AdaptedThresholdsWarning(UserWarning):
    """Range rings were changed without their thresholds, which are then those of the nearest range rings before."""


class PluginWarning(UserWarning):
    """Something that an installed package adds is not used."""


OWN_WARNINGS = (RenamedKeyWarning, AdaptedThresholdsWarning, PluginWarning)


class SeaclutterError(Exception):
    """An error in the data or during the run; its text is shown to the user unchanged.

    Examples
    --------
    >>> import seaclutter
    >>> try:
    ...     seaclutter.open_log("samples/README.md")
    ... except seaclutter.SeaclutterError as error:
    ...     print(error)
    samples/README.md: ...
    """

    exit_code = 1


class InputError(SeaclutterError):
    """The input cannot be read or contains no data to process.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.open_log("samples/README.md")
    Traceback (most recent call last):
    seaclutter_cli.errors.InputError: samples/README.md: ...
    """


class CloudError(InputError):
    """A message is not a valid point cloud; the rest of the log may be intact.

    Examples
    --------
    >>> import seaclutter
    >>> issubclass(seaclutter.CloudError, seaclutter.InputError)
    True
    """


class UnsupportedCloudError(InputError):
    """Clouds are stored in a form that cannot be read, for example with an unknown compression.

    Examples
    --------
    >>> import seaclutter
    >>> issubclass(seaclutter.UnsupportedCloudError, seaclutter.InputError)
    True
    """


class FieldError(InputError):
    """A point cloud lacks a required field, or the field has the wrong type.

    Examples
    --------
    >>> import numpy as np
    >>> import seaclutter
    >>> seaclutter.filter_points(np.ones((2, 3)), method="joint")
    Traceback (most recent call last):
    seaclutter_cli.errors.FieldError: no intensity field; ...
    """


class LabelError(SeaclutterError):
    """Labels cannot be read or belong to another recording.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.evaluate("samples/sea.mcap", "samples/README.md")
    Traceback (most recent call last):
    seaclutter_cli.errors.LabelError: samples/README.md: ...
    """


class MethodError(SeaclutterError):
    """A method that is not built in failed, or returned what no method may return.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.filter_log("samples/sea.mcap", folder / "x.mcap", method=lambda frame: frame.no_such_name)
    Traceback (most recent call last):
    seaclutter_cli.errors.MethodError: <lambda> failed on frame 0 of /points: AttributeError: ...
    """


class ModelError(SeaclutterError):
    """A trained model cannot be read or was made for another task.

    Examples
    --------
    >>> import seaclutter
    >>> issubclass(seaclutter.ModelError, seaclutter.SeaclutterError)
    True
    """


class OutputError(SeaclutterError):
    """The output cannot be written.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.filter_log("samples/sea.mcap", "samples/README.md/filtered.mcap")
    Traceback (most recent call last):
    seaclutter_cli.errors.OutputError: samples/README.md/filtered.mcap: ...
    """


class ClusterError(SeaclutterError):
    """A cluster, its scheduler or its workers cannot be used.

    Examples
    --------
    >>> import seaclutter
    >>> issubclass(seaclutter.ClusterError, seaclutter.SeaclutterError)
    True
    """


class MissingExtraError(SeaclutterError):
    """A required optional dependency is not installed.

    Examples
    --------
    >>> import seaclutter
    >>> print(seaclutter.MissingExtraError("the viewer", "view"))
    the viewer requires an optional dependency: pip install 'seaclutter[view]'
    """

    def __init__(self, feature: str, extra: str) -> None:
        super().__init__(feature, extra)  # pickle makes copies of these

    def __str__(self) -> str:
        return "{} requires an optional dependency: pip install 'seaclutter[{}]'".format(*self.args)


@contextmanager
def requiring(feature: str, extra: str) -> Iterator[None]:
    """Raise `MissingExtraError` if an import in the context fails."""
    try:
        yield
    except ImportError as error:
        raise MissingExtraError(feature, extra) from error


@contextmanager
def about(subject: object, kind: type[Exception], caught: type[Exception] | None = None) -> Iterator[None]:
    """Raise errors of a kind again with what they are about before their text; or others, as errors of this kind."""
    others = caught or kind
    try:
        yield
    except others as error:
        raise kind(f"{subject}: {error}") from error


@contextmanager
def opening(path: object, kind: type[SeaclutterError] = InputError, problem: str = "") -> Iterator[None]:
    """Raise an error of a kind that names a file, and a problem, if the system cannot do what the context does with it.

    That a file is not a valid cloud is an error of this kind, too.
    """
    try:
        yield
    except CloudError as error:
        raise kind(f"{path}: {error}") from error
    except OSError as error:
        raise kind(f"{path}: {problem} ({error.strerror})" if problem else f"{path}: {error.strerror}") from error


class UsageError(SeaclutterError):
    """The command line or call asks for something impossible.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.open_log("samples")
    Traceback (most recent call last):
    seaclutter_cli.errors.UsageError: samples: ...
    """

    exit_code = 2


class ArrayError(UsageError, ValueError):
    """An array has the wrong shape or type.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.filter_points([[1.0, 2.0]])
    Traceback (most recent call last):
    seaclutter_cli.errors.ArrayError: xyz must have the shape (N, 3), got (1, 2)
    """


class ConfigError(UsageError):
    """A config file or value is not valid.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.make_filter("joint", star_m=5)
    Traceback (most recent call last):
    seaclutter_cli.errors.ConfigError: configuration: filter.star_m: unknown key; ...
    """


class TopicError(UsageError):
    """A recording lacks a selected topic, or has several of which one must be selected.

    Examples
    --------
    >>> import seaclutter
    >>> issubclass(seaclutter.TopicError, seaclutter.UsageError)
    True
    """


class SelectionError(UsageError):
    """No frame is in the selected part of a recording.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.filter_log("samples/sea.mcap", folder / "none.mcap", start_s=10.0)
    Traceback (most recent call last):
    seaclutter_cli.errors.SelectionError: sea: no frames from 10 s on; ...
    """
