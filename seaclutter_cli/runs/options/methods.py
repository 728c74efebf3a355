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

    from seaclutter_cli.validation import yaml_value

    try:
        return yaml_value(value.tolist() if hasattr(value, "tolist") else value)
    except YAMLError as error:
        raise ConfigError(f"{key}: not a value of a configuration: {value!r}") from error


class _Configured(Options):
    """Sources of configurations."""

    config: Converted[PathLike | Mapping[str, Any] | Config | None, ConfigSource | None] = option(
        "-c --config FILE",
        default=None,
        kind=ConfigFile(),
        help="Configuration file, or the name of a built-in one. "
        f"[default: {WORKING_CONFIG} in the working folder, if there is one; - is standard input]",
    )
    settings: Converted[Sequence[str] | Mapping[str, Any], tuple[str, ...]] = option(
        "-s --set KEY=VALUE",
        default=(),
        kind=_Settings(),
        help="Set a key, such as filter.start_m=5; repeatable.",
    )


class ConfigOptions(_Configured):
    """Sources of the configuration of a run, in ascending precedence: file, method, single keys."""

    method: str | None = option("-m --method NAME", default=None, help="Filter method; overrides the configuration.")


class MethodOptions(_Configured):
    """Methods that a run compares, and the sources of their configurations."""

    methods: Converted[str | Sequence[str], tuple[str, ...]] = option(
        "-m --method NAME",
        default=(),
        help="Filter method, by default that of the configuration; none leaves the logs unfiltered; repeatable.",
    )
    compare: Converted[
        Literal["paper", "peers", "all"] | Sequence[Literal["paper", "peers", "all"]], tuple[str, ...]
    ] = option(
        "--compare",
        default=(),
        kind=Choice(("paper", "peers", "all")),
        help="Compare the stages of joint as in its paper; joint, confirmed and their peers; or all and none.",
    )


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
        "--labels LABELS", default=(), kind=Place(remote=True), help=_LABELS_HELP
    )
    clutter_ids: Converted[Sequence[int] | None, tuple[int, ...] | None] = option(
        "--clutter-ids IDS",
        default=None,
        kind=_Ids(),
        help="Class ids of clutter in point labels, such as 110,111. [default: 110]",
    )
    ignore_ids: Converted[Sequence[int] | None, tuple[int, ...] | None] = option(
        "--ignore-ids IDS",
        default=None,
        kind=_Ids(),
        help="Class ids to ignore in point labels. [default: 0,99]",
    )


class OfLabelledLogs(LabelSources, OfLogs):
    """What every function for labelled logs takes."""

    labels: Converted[PathLike | Sequence[PathLike], tuple[Path, ...]] = option(
        "--labels LABELS",
        kind=Place(remote=True),
        repeatable=True,
        help=_LABELS_HELP,
        kw_only=False,
    )
