"""Object storage at the edge of a run: URLs become paths when it begins, and texts and results name URLs when it ends.

Within a run there are only paths. The functions here do nothing for those of local files, and nothing is imported for
them; only this module imports `seaclutter_cli.storage`.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from copy import copy
from dataclasses import fields, is_dataclass
from functools import wraps
from operator import is_
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar
from weakref import WeakValueDictionary

from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.options import Options, declared, function_of
from seaclutter_cli.urls import Url, is_url, parse_url

if TYPE_CHECKING:
    from seaclutter_cli.storage.mirrors import Mirror
    from seaclutter_cli.storage.objects import Upload

    Pending = Upload

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

_mirrors: "WeakValueDictionary[Path, Mirror]" = WeakValueDictionary()
"""Of the runs that work on objects now, by their folders."""

_current: "ContextVar[Mirror | None]" = ContextVar("current", default=None)
"""Of the run to which the caller belongs."""


def use_case_of(kind: Callable[P, T]) -> Callable[[Callable[[T], R]], Callable[P, R]]:
    """Return a decorator that makes a `function_of` options, which get paths as from `on_paths`."""
    return lambda run: function_of(kind)(on_paths(run))


def on_paths(use_case: Callable[P, R]) -> Callable[P, R]:
    """Let a use case work on paths although its arguments contain URLs; its observer, result and errors name these."""

    @wraps(use_case)
    def with_objects(*args: P.args, **kwargs: P.kwargs) -> R:
        found: list[Url] = []
        _argument([*args, *kwargs.values()], found.append)
        if not found:
            return use_case(*args, **kwargs)
        with _objects() as mirror:
            token = _current.set(mirror)
            try:
                local: Any = [_argument(value, mirror.local) for value in args]
                named: Any = {name: _argument(value, mirror.local) for name, value in kwargs.items()}
                return shown(use_case(*local, **named))
            finally:
                _current.reset(token)

    return with_objects


@contextmanager
def local_copy(place: "str | PathLike[str]") -> "Iterator[str | PathLike[str]]":
    """Yield a path, or one that stands for a URL until the context ends."""
    if not is_url(place):
        yield place
        return
    with _objects() as mirror:
        yield _argument(place, mirror.local)


@contextmanager
def _objects() -> "Iterator[Mirror]":
    """Yield a folder in which objects have paths until the context ends; errors name URLs."""
    from seaclutter_cli.storage.mirrors import Mirror

    mirror = Mirror()
    _mirrors[mirror.path] = mirror
    try:
        with naming():
            yield mirror
    finally:
        _mirrors.pop(mirror.path, None)
        mirror.close()


def _all() -> "list[Mirror]":
    """Return the mirrors; unlike their dictionary, the list does not change when another thread begins a run."""
    return [mirror for found in _mirrors.valuerefs() if (mirror := found())]


@contextmanager
def naming() -> Iterator[None]:
    """Let errors name URLs, not the paths that stand for them."""
    try:
        yield
    except BaseException as error:
        shown(error)
        raise


def _argument(value: Any, local: Callable[[Url], Any]) -> Any:
    """Return an argument with a function's values in place of URLs; an observer receives texts that name URLs."""
    if isinstance(value, str | PathLike) and is_url(value):
        path = local(parse_url(value))
        if isinstance(value, str):
            return f"{path}/" if value.endswith("/") else str(path)
        return path
    if isinstance(value, list | tuple):
        return type(value)(_argument(one, local) for one in value)
    if hasattr(value, "warn"):
        return _Naming(value)
    if isinstance(value, Options):
        other = copy(value)
        for name, one in declared(type(value)).items():
            if one.kind.is_place:
                vars(other)[name] = _argument(vars(value)[name], local)
        return other
    return _converted(value, lambda leaf: local(leaf) if isinstance(leaf, Url) else leaf)


class _Naming:
    def __init__(self, observer: Any) -> None:
        self._observer = observer

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._observer, name)
        return (lambda *args, **options: value(*shown(args), **options)) if callable(value) else value


def _converted(value: Any, leaf: Callable[[Any], Any]) -> Any:
    """Return a value with another one in place of each leaf; the value itself if nothing changes."""
    if is_dataclass(value) and not isinstance(value, type | Url):
        found = {one.name: getattr(value, one.name, None) for one in fields(value)}
        changed = {name: new for name, old in found.items() if (new := _converted(old, leaf)) is not old}
        other = copy(value) if changed else value
        for name, new in changed.items():
            object.__setattr__(other, name, new)
        return other
    if isinstance(value, list | tuple):
        items = [_converted(one, leaf) for one in value]
        return value if all(map(is_, items, value)) else type(value)(items)
    if isinstance(value, dict):
        pairs = {_converted(key, leaf): _converted(one, leaf) for key, one in value.items()}
        return value if all(map(is_, pairs.values(), value.values())) and pairs.keys() == value.keys() else pairs
    return leaf(value)


def shown(value: R) -> R:
    """Return texts, paths, and data and results that contain them, with URLs in place of paths that stand for them."""
    result: R = _converted(value, _shown) if _mirrors else value
    return result


def _shown(leaf: Any) -> Any:
    for mirror in _all():
        if isinstance(leaf, str):
            leaf = mirror.shown(leaf)
        elif isinstance(leaf, Path) and mirror.has(leaf):
            return mirror.url(leaf)
        elif isinstance(leaf, SeaclutterError):
            leaf.args = tuple(map(_shown, leaf.args))
        if isinstance(leaf, BaseException) and hasattr(leaf, "__notes__"):
            leaf.__notes__ = list(map(_shown, leaf.__notes__))
    return leaf


def local(value: R) -> R:
    """Return a value from another process with paths in place of URLs."""
    if (mirror := _current.get()) is None:
        return value
    result: R = _converted(value, lambda leaf: mirror.local(leaf) if isinstance(leaf, Url) else leaf)
    return result


def mirror_of(path: Path) -> "Mirror | None":
    """Return the folder of copies to which a path belongs; None for that of a local file."""
    return next((mirror for mirror in _all() if mirror.has(path)), None)


def look(path: Path) -> None:
    """Let a path be what there is in object storage: a file, or a folder with what is directly in it."""
    if mirror := mirror_of(path):
        mirror.look(path)


def fetch(*paths: Path, at_most: int | None = None) -> None:
    """Copy the objects that paths stand for; see `Mirror.fetch`."""
    for mirror in _all():
        if found := [path for path in paths if mirror.has(path)]:
            mirror.fetch(found, at_most)


def copies_removed() -> AbstractContextManager[None]:
    """Remove the copies that are made within the context, at its end."""
    mirror = _current.get()
    return mirror.copies_removed() if mirror else nullcontext()
