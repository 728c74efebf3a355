"""What the program has by name, and what installed packages add to it by entry points.

An entry point of the group ``seaclutter.KIND`` names an object of a package. Packages are looked through once, when
something is not built in. Nothing in a log, in labels or in a configuration can name code: only a package that is
installed is imported.
"""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

from seaclutter_cli.errors import PluginWarning

KINDS = ("filters", "sources", "sensors", "clouds", "labels", "sinks")
"""Ends of the names of the groups of entry points."""

_REGISTRIES: "list[Registry[Any, Any]]" = []

K = TypeVar("K")
V = TypeVar("V")


@cache
def plugins() -> Mapping[str, Sequence[EntryPoint]]:
    """Return the entry points of the installed packages by kind, in the order of packages and names."""
    found = entry_points()
    return {
        kind: sorted(found.select(group=f"seaclutter.{kind}"), key=lambda one: (package(one), one.name))
        for kind in KINDS
    }


def package(point: EntryPoint) -> str:
    """Return name and version of the package of an entry point."""
    return f"{point.dist.name} {point.dist.version}" if point.dist else "unknown"


def packages() -> list[str]:
    """Return names and versions of the packages that add something."""
    return sorted({package(point) for points in plugins().values() for point in points})


def warn_here() -> None:
    """Load what packages add, so that warnings about them come from this process, once, and not from others."""
    if packages():
        for one in _REGISTRIES:
            one.added  # noqa: B018 - what it warns of


def imported(name: str) -> Any:
    """Return an object of the program by its module and name, such as ``sinks.log.LogSink``; the start stays fast."""
    module, _, own = name.rpartition(".")
    return getattr(import_module(f"seaclutter_cli.{module}"), own)


class Registry(Mapping[K, V]):
    """Built-in items, and after them those of plug-ins of a kind; built-in ones may be named, in their package.

    ``adapt`` returns the items that the object of an entry point adds under its name, or raises an error with what is
    wrong with it. A plug-in that cannot be used, or whose name is taken, is a warning.
    """

    def __init__(self, kind: str, built_in: Mapping[K, V | str], adapt: Callable[[str, Any], Mapping[K, V]]) -> None:
        self._kind, self.built_in, self._adapt = kind, built_in, adapt
        _REGISTRIES.append(self)

    def __getitem__(self, name: K) -> V:
        found = self.built_in[name] if name in self.built_in else self.added[name]
        return imported(f"{self._kind}.{found}") if isinstance(found, str) else found

    def __contains__(self, name: object) -> bool:
        return name in self.built_in or name in self.added

    def __iter__(self) -> Iterator[K]:
        yield from self.built_in
        yield from self.added

    def __len__(self) -> int:
        return len(self.built_in) + len(self.added)

    @cached_property
    def added(self) -> Mapping[K, V]:
        """Items of plug-ins."""
        added: dict[K, V] = {}
        for point in plugins()[self._kind]:
            try:
                items = self._adapt(point.name, point.load())
                if taken := next((name for name in items if name in self.built_in or name in added), None):
                    raise ValueError(f"{taken} is taken")  # noqa: TRY301 - one report for all that can be wrong
            except (Exception, SystemExit) as error:  # noqa: BLE001 - a package may do anything
                text = f"{package(point)}: {point.name} ({self._kind}) is not used: {error or type(error).__name__}"
                warnings.warn(PluginWarning(text), stacklevel=2)
            else:
                added |= items
        return added
