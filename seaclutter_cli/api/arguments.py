"""Conversion of plain arguments to the options of `seaclutter_cli.runs`."""

import os
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seaclutter_cli.config import Config, ConfigSource
from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.records import Damage
from seaclutter_cli.runs.labels import LabelSources
from seaclutter_cli.runs.methods import ConfigOptions
from seaclutter_cli.runs.observer import Observer, Step
from seaclutter_cli.runs.recordings import PathLike
from seaclutter_cli.urls import place

Settings = PathLike | Mapping[str, Any] | Config
"""A configuration file or the name of a built-in one, the content of a file, or a configuration."""


def config_source(config: Settings | None) -> ConfigSource | None:
    """Return a configuration, with a path or name as `Path`."""
    return place(config) if isinstance(config, str | os.PathLike) else config


def config_options(method: str | None, config: Settings | None) -> ConfigOptions:
    """Return the options for a method and a configuration."""
    return ConfigOptions(file=config_source(config), method=method)


def label_sources(
    labels: PathLike | Sequence[PathLike] | None,
    clutter_ids: Sequence[int] | None = None,
    ignore_ids: Sequence[int] | None = None,
) -> LabelSources:
    """Return the options for labels."""
    paths = [labels] if isinstance(labels, str | os.PathLike) else (labels or ())
    return LabelSources(
        paths=tuple(place(path) for path in paths),
        clutter_ids=None if clutter_ids is None else tuple(clutter_ids),
        ignore_ids=None if ignore_ids is None else tuple(ignore_ids),
    )


def path_or_none(path: PathLike | None) -> Path | None:
    """Return a path as `Path`; None if it is None."""
    return None if path is None else place(path)


@dataclass(frozen=True)
class Raising:
    """Observer that raises the error of a recording instead of continuing with the others.

    Parameters
    ----------
    inner : Observer
        Receives everything else.
    """

    inner: Observer

    @property
    def log_file(self) -> Path | None:
        """File that the inner observer writes, if there is one."""
        return getattr(self.inner, "log_file", None)

    def progress(self, title: str, total: int | None, unit: str = "frame") -> AbstractContextManager[Step]:
        """Pass on progress."""
        return self.inner.progress(title, total, unit)

    def note(self, text: str, *, detail: bool = False) -> None:
        """Pass on a note."""
        self.inner.note(text, detail=detail)

    def warn(self, text: str) -> None:
        """Pass on a warning."""
        self.inner.warn(text)

    def damage(self, damage: Sequence[Damage]) -> None:
        """Pass on damage."""
        self.inner.damage(damage)

    def fail(self, error: SeaclutterError) -> None:
        """Raise the error."""
        raise error

    def done(self, line: str, damage: Sequence[Damage], error: SeaclutterError | None) -> None:
        """Pass on the end of a recording, or raise its error."""
        if error:
            raise error
        self.inner.done(line, damage, error)


def run_observer(observer: Observer, *, keep_going: bool) -> Observer:
    """Return the observer of a run that continues after the error of a recording, or raises it."""
    return observer if keep_going else Raising(observer)
