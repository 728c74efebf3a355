"""Methods that are not registered: classes, objects and functions that a caller gives, or that a file contains."""

import copy
import hashlib
import inspect
import pickle
import sys
import traceback
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Self

import numpy as np

from seaclutter_cli.errors import ArrayError, ConfigError, FieldError, MethodError, opening
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.interfaces import Filter, NoParams
from seaclutter_cli.paths import read_whole

_IN_FILE = ".py:"
_PACKAGE = Path(__file__).parent.name


class Method(str):  # noqa: SLOT000 - it has a dictionary
    """The name of a method that is not registered, with its class, what it was made by, and a digest of its code."""

    kind: Any
    made_by: tuple[Callable[..., Any], tuple[Any, ...]]
    code: str

    def __new__(cls, name: str, kind: Any, made_by: tuple[Callable[..., Any], tuple[Any, ...]], code: str) -> Self:
        """Return a name."""
        method = super().__new__(cls, name)
        method.kind, method.made_by, method.code = kind, made_by, code
        return method

    def __reduce__(self) -> Any:
        return self.made_by


def method_of(given: Any) -> str:
    """Return a method as options store it: a name, or the `Method` of a class, an object, a function or a file.

    A file and its class are ``FILE.py:CLASS``. Raise `ConfigError` if it is no method.
    """
    if not isinstance(given, str):
        name = getattr(given, "__name__", type(given).__name__)
        return Method(name, class_of(given, name), (method_of, (given,)), _code_of(given))
    if isinstance(given, Method) or _IN_FILE not in given:
        return given
    path, _, name = given.rpartition(":")
    with opening(path, ConfigError, "cannot be read"):
        source = read_whole(Path(path))
    return _of_source(path, source, name)


def class_of(given: Any, name: str) -> Any:
    """Return what makes filters from parameters, as the class of a method does, for a class, an object or a function.

    Copies of an object are filters without its state. A function gets a frame of N points and returns which of them are
    kept: a mask, shape (N,), bool. Raise `ConfigError` with what is missing.
    """
    if not isinstance(given, type) and callable(given) and not hasattr(given, "step"):
        return _Copies(_FunctionFilter(given, name))
    _check_protocol(given, name)
    if not isinstance(given, type):
        return _Copies(given)
    if not is_dataclass(given.Params):  # type: ignore[attr-defined] # checked
        raise ConfigError(f"{name}: Params must be a dataclass")
    return given


def _check_protocol(given: Any, name: str) -> None:
    expected = [one for one in (*vars(Filter), *Filter.__annotations__) if not one.startswith("_")]
    kind = given if isinstance(given, type) else type(given)
    lacking = {one for one in expected if not hasattr(given, one)} | set(getattr(kind, "__abstractmethods__", ()))
    if lacking:
        raise ConfigError(
            f"{name} is no method: it lacks {', '.join(sorted(lacking))}; derive it from seaclutter.Filter, which has "
            "all but step(frame), or give a function of a frame that returns a mask"
        )


class _Copies:
    """Stands for the class of an object, of which it makes copies."""

    Params = NoParams

    def __init__(self, original: Filter) -> None:
        self._original, self.__doc__ = original, original.__doc__

    def __call__(self, _: Any) -> Filter:
        made = copy.deepcopy(self._original)
        made.reset()
        return made

    def __getattr__(self, name: str) -> Any:
        return getattr(self._original, name)


class _FunctionFilter(Filter):
    """The method of a function that returns a mask."""

    def __init__(self, function: Callable[[Frame], Any], name: str) -> None:
        super().__init__()
        self._function, self.name, self.__doc__ = function, name, function.__doc__

    def step(self, frame: Frame) -> FilterResult:
        mask = np.asarray(self._function(frame))
        if mask.shape != (frame.size,) or mask.dtype != np.bool_:
            found = f"{mask.dtype} of shape {mask.shape}"
            raise ArrayError(f"must return a mask, bool of shape ({frame.size},), not {found}")
        reason = np.where(frame.valid, np.where(mask, Reason.KEPT, Reason.OUTLIER), Reason.INVALID)
        return FilterResult(frame, reason.astype(np.uint8))


@contextmanager
def naming_method(method: Any, where: str) -> Iterator[None]:
    """Raise `MethodError` for an error of a method, or its class, that is not built in."""
    try:
        yield
    except (FieldError, MemoryError):  # they have meanings of their own
        raise
    except Exception as error:
        kind = method if isinstance(method, type) else type(method)
        if kind.__module__.startswith(f"{_PACKAGE}.filters"):
            raise
        name = getattr(method, "name", kind.__name__)
        outside = [at for at in traceback.extract_tb(error.__traceback__) if _PACKAGE not in Path(at.filename).parts]
        at = f" ({Path(outside[-1].filename).name}, line {outside[-1].lineno})" if outside else ""
        raise MethodError(f"{name} failed on {where}: {type(error).__name__}: {error}{at}") from error


def _of_source(path: str, source: bytes, name: str) -> Method:
    """Return a method from the content of a file, which is run; also in other processes, which need no file."""
    digest = hashlib.sha256(source).hexdigest()
    module = sys.modules.get(f"seaclutter_file_{digest}")
    if module is None:
        module = ModuleType(f"seaclutter_file_{digest}")
        module.__file__ = path
        sys.modules[module.__name__] = module  # where pickle looks for its classes
        try:
            exec(compile(source, path, "exec"), vars(module))  # noqa: S102 - named on the command line
        except (Exception, SystemExit) as error:
            del sys.modules[module.__name__]
            raise ConfigError(f"{path}: {type(error).__name__}: {error}") from error
    if not callable(found := getattr(module, name, None)):
        known = [key for key, one in vars(module).items() if getattr(one, "__module__", "") == module.__name__]
        raise ConfigError(f"{path}: has no class or function {name!r}; it has: {', '.join(known) or 'none'}")
    shown = f"{Path(path).name}:{name}"
    return Method(shown, class_of(found, shown), (_of_source, (path, source, name)), f"sha256 {digest}")


def _code_of(given: Any) -> str:
    """Return a digest of the code of an object and of what it contains; another one each time if it is not known."""
    kind = given if isinstance(given, type) or inspect.isroutine(given) else type(given)
    with suppress(OSError, TypeError, ValueError, AttributeError, pickle.PickleError):
        source = Path(inspect.getsourcefile(kind) or "").read_bytes()
        return f"sha256 {hashlib.sha256(source + pickle.dumps(given)).hexdigest()}"
    return f"unknown {uuid.uuid4()}"
