"""Options for the configuration of methods, and for labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.options import (
    Choice,
    Converted,
    Kind,
    Options,
    Place,
    Whole,
    option,
)

if TYPE_CHECKING:
    from seaclutter_cli.config import Config, ConfigSource
    from seaclutter_cli.urls import PathLike

from seaclutter_cli.runs.options import OfLogs
from seaclutter_cli.urls import is_url

WORKING_CONFIG = "seaclutter.yaml"
"""Configuration that the command line uses if it is in the working folder."""


class ConfigFile(Kind):
    """Configurations: files, names of built-in ones, contents of files, and objects of class `Config`."""

    is_place = True

    def check(self, value: Any, name: str) -> Any:
        """Return a configuration, with a path or name as a location; a path of a class of its own stays one."""
        if not (isinstance(value, str) or hasattr(value, "__fspath__")):
            return value
        found = Place(remote=True).check(value, name)
        return value if isinstance(value, Path) and not is_url(found) else found


class _Settings(Kind):
    """Settings in the form of the command line, or keys and values."""

    def check_all(self, values: Any, name: str) -> Any:
        if not isinstance(values, Mapping):
            return super().check_all(values, name)
        return tuple(f"{key}={_as_yaml(value, key)}" for key, value in values.items())


def _as_yaml(value: Any, key: str) -> str:
    """Return a value as on the command line; raise `ConfigError` if it can be none in a configuration."""
    from yaml import YAMLError

    from seaclutter_cli.parameters import yaml_value

    try:
        return yaml_value(value.tolist() if hasattr(value, "tolist") else value)
    except YAMLError as error:
        raise ConfigError(f"{key}: not a value of a configuration: {value!r}") from error


if TYPE_CHECKING:
    OptionalConfig = Converted[PathLike | Mapping[str, Any] | Config | None, ConfigSource | None]
    Settings = Converted[Sequence[str] | Mapping[str, Any], tuple[str, ...]]


def _config_option() -> Any:
    return option(
        "-c",
        "--config",
        default=None,
        kind=ConfigFile(),
        metavar="FILE",
        help="Configuration file, or the name of a built-in one. "
        f"[default: {WORKING_CONFIG} in the working folder, if there is one; - is standard input]",
        type="path, mapping or Config",
    )


def _settings_option(subject: str) -> Any:
    return option(
        "-s",
        "--set",
        default=(),
        kind=_Settings(),
        metavar="KEY=VALUE",
        repeatable=True,
        help=f"Set {subject}, such as filter.start_m=5; repeatable.",
        type="mapping or sequence of str",
    )


class ConfigOptions(Options):
    """Sources of the configuration of a run, in ascending precedence: file, method, single keys."""

    config: OptionalConfig = _config_option()
    method: str | None = option(
        "-m", "--method", default=None, metavar="NAME", help="Filter method; overrides the configuration."
    )
    settings: Settings = _settings_option("a key")


class MethodOptions(Options):
    """Methods that a run compares, and the sources of their configurations."""

    config: OptionalConfig = _config_option()
    methods: Converted[str | Sequence[str], tuple[str, ...]] = option(
        "-m",
        "--method",
        default=(),
        metavar="NAME",
        repeatable=True,
        help="Filter method, by default that of the configuration; none leaves the logs unfiltered; repeatable.",
    )
    compare: Converted[
        Literal["paper", "peers", "all"] | Sequence[Literal["paper", "peers", "all"]], tuple[str, ...]
    ] = option(
        "--compare",
        default=(),
        kind=Choice(("paper", "peers", "all")),
        repeatable=True,
        help="Compare the stages of joint as in its paper; joint, confirmed and their peers; or all and none.",
        type='{"paper", "peers", "all"}, or sequence of these',
    )
    settings: Settings = _settings_option("a key for every method that has it")


class _Ids(Kind):
    """Whole numbers, on the command line separated by commas."""

    def parse(self, text: str) -> Any:
        try:
            return tuple(int(number) for number in text.split(",") if number.strip())
        except ValueError as error:
            raise ValueError("expected whole numbers separated by commas, such as 0,99") from error

    def check(self, value: Any, name: str) -> Any:
        return Whole().check_all(value, name)


_LABELS_HELP = "Labels of LOGS in the same order, or a folder with RECORDING.labels.csv for each; repeatable."


class LabelSources(Options):
    """Labels of recordings, and how to read them."""

    labels: Converted[PathLike | Sequence[PathLike] | None, tuple[Path, ...]] = option(
        "--labels",
        default=(),
        kind=Place(remote=True),
        metavar="LABELS",
        repeatable=True,
        help=_LABELS_HELP,
        type="path, or sequence of paths",
    )
    clutter_ids: Converted[Sequence[int] | None, tuple[int, ...] | None] = option(
        "--clutter-ids",
        default=None,
        kind=_Ids(),
        metavar="IDS",
        group="Input",
        help="Class ids of clutter in point labels, such as 110,111. [default: 110]",
        type="sequence of int",
    )
    ignore_ids: Converted[Sequence[int] | None, tuple[int, ...] | None] = option(
        "--ignore-ids",
        default=None,
        kind=_Ids(),
        metavar="IDS",
        group="Input",
        help="Class ids to ignore in point labels. [default: 0,99]",
        type="sequence of int",
    )


class OfLabelledLogs(LabelSources, OfLogs):
    """What every function for labelled logs takes."""

    labels: Converted[PathLike | Sequence[PathLike], tuple[Path, ...]] = option(
        "--labels",
        kind=Place(remote=True),
        metavar="LABELS",
        repeatable=True,
        help=_LABELS_HELP,
        type="path, or sequence of paths",
        kw_only=False,
    )
