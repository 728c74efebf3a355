"""Every error that the program raises on purpose.

::

    SeaclutterError            exit status 1, one line for the user
    ├── InputError             nothing readable, no cloud, not a log
    │   ├── CloudError         one message is no valid point cloud
    │   └── FieldError         the cloud has no such field, or of a wrong type
    ├── LabelError             labels cannot be read, or do not fit the recording
    ├── ModelError             a trained model cannot be read, or is none for this
    ├── OutputError            the target cannot be written
    ├── MissingExtraError      an optional dependency is not installed
    └── UsageError             exit status 2
        └── ConfigError        a config file or value is not valid

A message says what was found and what to do about it.
"""


class RenamedKeyWarning(FutureWarning):
    """A configuration or scene has a key by its former name; a later major release will not know it any more."""


class SeaclutterError(Exception):
    """An error in the data or the run; its text is shown to the user as it is.

    Examples
    --------
    >>> import seaclutter
    >>> try:
    ...     seaclutter.open_log("samples/README.md")
    ... except seaclutter.SeaclutterError as error:
    ...     print(error)
    samples/README.md: the format is not known ...
    """

    exit_code = 1


class InputError(SeaclutterError):
    """The input cannot be read at all, or holds nothing to work on.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.open_log("samples/README.md")
    Traceback (most recent call last):
    seaclutter_cli.errors.InputError: samples/README.md: the format is not known ...
    """


class CloudError(InputError):
    """One message is no valid point cloud; the rest of the log may be sound.

    Examples
    --------
    >>> import seaclutter
    >>> issubclass(seaclutter.CloudError, seaclutter.InputError)
    True
    """


class FieldError(InputError):
    """A point cloud lacks a field that is needed, or has it in a wrong type.

    Examples
    --------
    >>> import numpy as np
    >>> import seaclutter
    >>> seaclutter.filter_points(np.ones((2, 3)), method="joint")
    Traceback (most recent call last):
    seaclutter_cli.errors.FieldError: no intensity field; ...
    """


class LabelError(SeaclutterError):
    """Labels cannot be read, or belong to another recording.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.evaluate("samples/sea.mcap", "samples/README.md")
    Traceback (most recent call last):
    seaclutter_cli.errors.LabelError: samples/README.md: ...
    """


class ModelError(SeaclutterError):
    """A trained model cannot be read, or is made for something else.

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
    seaclutter_cli.errors.OutputError: samples/README.md/filtered.mcap: cannot be written ...
    """


class MissingExtraError(SeaclutterError):
    """An optional dependency is needed and not installed.

    Examples
    --------
    >>> import seaclutter
    >>> print(seaclutter.MissingExtraError("the viewer", "view"))
    the viewer needs an optional part: pip install 'seaclutter[view]'
    """

    def __init__(self, what: str, extra: str) -> None:
        """Name what is needed and the extra that brings it."""
        super().__init__(f"{what} needs an optional part: pip install 'seaclutter[{extra}]'")


class UsageError(SeaclutterError):
    """The command line asks for something impossible.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.open_log("samples")
    Traceback (most recent call last):
    seaclutter_cli.errors.UsageError: samples: stands for ...
    """

    exit_code = 2


class ConfigError(UsageError):
    """A config file or value is not valid.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.make_filter("joint", star_m=5)
    Traceback (most recent call last):
    seaclutter_cli.errors.ConfigError: configuration: filter.star_m: unknown key; ...
    """
