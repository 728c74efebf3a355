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


class SeaclutterError(Exception):
    """An error in the data or the run; its text is shown to the user as it is."""

    exit_code = 1


class InputError(SeaclutterError):
    """The input cannot be read at all, or holds nothing to work on."""


class CloudError(InputError):
    """One message is no valid point cloud; the rest of the log may be sound."""


class FieldError(InputError):
    """A point cloud lacks a field that is needed, or has it in a wrong type."""


class LabelError(SeaclutterError):
    """Labels cannot be read, or belong to another recording."""


class ModelError(SeaclutterError):
    """A trained model cannot be read, or is made for something else."""


class OutputError(SeaclutterError):
    """The output cannot be written."""


class MissingExtraError(SeaclutterError):
    """An optional dependency is needed and not installed."""

    def __init__(self, what: str, extra: str) -> None:
        """Name what is needed and the extra that brings it."""
        super().__init__(f"{what} needs an optional part: pip install 'seaclutter[{extra}]'")


class UsageError(SeaclutterError):
    """The command line asks for something impossible."""

    exit_code = 2


class ConfigError(UsageError):
    """A config file or value is not valid."""
