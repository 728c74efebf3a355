"""Options that choose methods and their configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.options import Converted, Kind, Options, Place, option
from seaclutter_cli.urls import PathLike, is_url

if TYPE_CHECKING:
    from seaclutter_cli.config import Config, ConfigSource

MethodLike = Any
"""A method by its name, or a class, an object or a function; see `Filter`."""

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


class Settings(Kind):
    """Settings in the form of the command line, or keys and values."""

    def check_all(self, values: Any, name: str) -> Any:
        """Return settings in the form of the command line."""
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
        "Configuration file, or the name of a built-in one. "
        f"[default: {WORKING_CONFIG} in the working folder, if there is one; - is standard input]",
        default=None,
        kind=ConfigFile(),
    )
    settings: Converted[Sequence[str] | Mapping[str, Any], tuple[str, ...]] = option(
        "-s --set KEY=VALUE", "Set a key, such as filter.start_m=5; repeatable.", default=(), kind=Settings()
    )


class MethodName(Kind):
    """Methods: names, classes, objects, functions, and classes in files by ``FILE.py:CLASS``."""

    def check(self, value: Any, name: str) -> Any:  # noqa: ARG002 - errors name the method
        """Return the name of a method; raise `ConfigError` if it is none."""
        from seaclutter_cli.given import method_of

        return method_of(value)


class ConfigOptions(_Configured):
    """Sources of the configuration of a run, in ascending precedence: file, method, single keys."""

    method: Converted[MethodLike | None, str | None] = option(
        "-m --method NAME",
        "Filter method, or FILE.py:CLASS for one of your own; overrides the configuration.",
        default=None,
        kind=MethodName(),
    )


class MethodOptions(_Configured):
    """Methods that a run compares, and the sources of their configurations."""

    methods: Converted[MethodLike | Sequence[MethodLike], tuple[str, ...]] = option(
        "-m --method NAME",
        "Filter method, or FILE.py:CLASS for one of your own, by default that of the configuration; none leaves the "
        "logs unfiltered; repeatable.",
        default=(),
        kind=MethodName(),
    )
    compare: Converted[
        Literal["paper", "peers", "all"] | Sequence[Literal["paper", "peers", "all"]], tuple[str, ...]
    ] = option(
        "--compare",
        "Compare the stages of joint as in its paper; joint, confirmed and their peers; or all and none.",
        default=(),
    )
