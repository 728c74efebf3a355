"""Options, each declared once: a field of a class, with its flags, limits and help.

The options of a command, the keywords of the Python function, the checks of both and the documentation are made from
the fields. Modules with such classes import nothing heavy, so that the help of a command appears at once.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import math
import numbers
import operator
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from functools import wraps
from pathlib import Path
from typing import Any, ClassVar, Generic, ParamSpec, TypeVar, dataclass_transform

from seaclutter_cli.errors import UsageError, about
from seaclutter_cli.registry import imported
from seaclutter_cli.text import named_folder
from seaclutter_cli.urls import PathLike, Url, is_url, place

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")
Given = TypeVar("Given")
Stored = TypeVar("Stored")
K = TypeVar("K", bound="Options")
_TINY = 1e-100  # the inverse of a smaller number is not finite


class Kind:
    """Values of an option; any text by default. Places are files, folders, URLs and what receives texts about them."""

    is_place = False
    output = or_folder = False
    metavar: ClassVar[str | None] = None

    def parse(self, text: str) -> Any:
        """Return the value of a text on the command line; raise `ValueError` with the problem if there is none."""
        return text

    def check(self, value: Any, name: str) -> Any:
        """Return a value as it is stored; raise `UsageError` that names the option if it is not allowed."""
        if not isinstance(value, str):
            raise UsageError(f"{name}: must be text, got {value!r}")
        return value

    def check_all(self, values: Any, name: str) -> Any:
        """Return the values of an option that can be repeated; a single one need not be in a sequence."""
        are_several = isinstance(values, Iterable) and not isinstance(values, str | os.PathLike | Url)
        return tuple(self.check(value, name) for value in (values if are_several else [values]))


@dataclass(frozen=True)
class Anything(Kind):
    """Values that are not checked."""

    is_place: bool = False

    def check(self, value: Any, name: str) -> Any:  # noqa: ARG002
        """Return the value."""
        return value


class Flag(Kind):
    """True or false."""

    def check(self, value: Any, name: str) -> Any:
        """Return a Boolean."""
        if not isinstance(value, bool):
            raise UsageError(f"{name}: must be True or False, got {value!r}")
        return value


@dataclass(frozen=True)
class Number(Kind):
    """Finite numbers within limits, which are excluded if ``above`` and ``below`` say so."""

    least: float | None = None
    most: float | None = None
    above: bool = False
    below: bool = False

    def check(self, value: Any, name: str) -> Any:
        """Return a number."""
        if isinstance(value, bool) or not isinstance(value, numbers.Real) or not math.isfinite(value):
            raise UsageError(f"{name}: must be a finite number, got {value!r}")
        return self._within(float(value) if abs(float(value)) > _TINY else 0.0, name)

    def _within(self, value: Any, name: str) -> Any:
        low, high = self.least, self.most
        too_low = low is not None and (value <= low if self.above else value < low)
        too_high = high is not None and (value >= high if self.below else value > high)
        if too_low or too_high:
            limits = [f"{'greater than' if self.above else 'at least'} {low:g}"] if low is not None else []
            limits += [f"{'less than' if self.below else 'at most'} {high:g}"] if high is not None else []
            raise UsageError(f"{name}: must be {' and '.join(limits)}, got {value:g}")
        return value


class Whole(Number):
    """Whole numbers within limits."""

    metavar = "N"

    def check(self, value: Any, name: str) -> Any:
        """Return a whole number."""
        if isinstance(value, bool) or not hasattr(value, "__index__"):
            raise UsageError(f"{name}: must be a whole number, got {value!r}")
        return self._within(operator.index(value), name)


@dataclass(frozen=True)
class Choice(Kind):
    """Names; as a mapping, names on the command line and the values that they stand for; ``more`` finds others."""

    names: Sequence[str] | Mapping[str, str]
    more: Callable[[], Iterable[str]] = tuple

    def parse(self, text: str) -> Any:
        """Return the value of a name."""
        return self.names[text] if isinstance(self.names, Mapping) else text

    def check(self, value: Any, name: str) -> Any:
        """Return one of the values."""
        allowed = tuple(self.names.values() if isinstance(self.names, Mapping) else self.names)
        if value not in allowed and value not in self.more():
            raise UsageError(f"{name}: must be one of {', '.join(map(repr, allowed))}, got {value!r}")
        return value


@dataclass(frozen=True)
class Place(Kind):
    """Files and folders here; if ``remote``, URLs of objects too.

    An ``output`` is a file, or stays as it was given if it may be a folder, which a slash at its end says.
    """

    is_place = True
    metavar = "FILE"

    remote: bool = False
    output: bool = False
    or_folder: bool = False

    def check(self, value: Any, name: str) -> Any:
        """Return a path or URL."""
        if value == "-":
            raise UsageError(f"-: {name} takes a file, not a standard stream (./- is a file of this name)")
        if self.output and not self.or_folder and named_folder(str(value)):
            raise UsageError(f"{value}: names a folder by the slash at its end; {name} takes a file")
        found = place(value)
        if is_url(found) and not self.remote:
            raise UsageError(f"{found}: {name} takes a local path")
        return value if self.or_folder else found


@dataclass(frozen=True)
class Parsed(Kind):
    """Values that a function, or one that is `imported`, makes of a text; another kind may check others."""

    of_text: Callable[[str], Any] | str
    others: Kind | None = None

    def parse(self, text: str) -> Any:
        """Return what the function makes of a text."""
        return (imported(self.of_text) if isinstance(self.of_text, str) else self.of_text)(text)

    def check(self, value: Any, name: str) -> Any:
        """Return a value that is no text, or what the function makes of a text."""
        if not isinstance(value, str):
            return self.others.check(value, name) if self.others else value
        with about(name, UsageError, ValueError):
            return self.parse(value)


class Converted(Generic[Given, Stored]):
    """Annotation of an option that is given as one type and stored as another."""

    def __get__(self, instance: object, owner: type) -> Stored:
        raise NotImplementedError

    def __set__(self, instance: object, value: Given) -> None: ...


OptionalPath = Converted[PathLike | None, Path | None]


@dataclass(eq=False)
class Option:
    """Declaration of an option; as an attribute, the value, the default for None, checked when set. See `option`."""

    text: str
    help: str
    default: Any
    kind: Any
    repeatable: bool
    required: bool
    of_command: Any
    kw_only: bool
    name: str = ""
    annotation: str = ""
    place: int = 0

    def __post_init__(self) -> None:
        words = self.text.split()
        self.flags = [word for word in words if word.startswith("-")] or words
        self.metavar = next((word for word in words if word not in self.flags), None)

    def __get__(self, instance: object | None, owner: type) -> Any:
        return self if instance is None else vars(instance)[self.name]

    def __set__(self, instance: object, value: Any) -> None:
        if value is None and self.default is not MISSING:
            value = None if self.of_command is None else self.default
        else:
            value = (self.kind.check_all if self.repeatable else self.kind.check)(value, self.name)
        vars(instance)[self.name] = value


def option(  # noqa: PLR0913 - what there is to say about an option
    text: str = "",
    help: str = "",  # noqa: A002 - as in click
    *,
    default: Any = MISSING,
    kind: Kind | None = None,
    repeatable: bool = False,
    required: bool = False,
    of_command: Any = MISSING,
    kw_only: bool = True,
) -> Any:
    """Declare an option as a field of a class of `Options`.

    ``text`` has the flags of the command line, and the name of the value in its help, or is the name of an argument;
    without it, the option is for Python only. The ``kind`` of values follows from the annotation. An option that is
    ``repeatable``, as those with the default () are, takes a value or a sequence in Python. The command line needs it
    if it is ``required``, and has the default ``of_command`` if it is another one.
    """
    return Option(text, help, default, kind, repeatable or default == (), required, of_command, kw_only)


def optional(text: str, help: str, *, kind: Kind | None = None) -> Any:  # noqa: A002
    """Declare an option with the default False if it is a flag, and None otherwise; see `option`."""
    return option(text, help, default=None, kind=kind)


def _kind_of(annotation: str, *, remote: bool) -> Kind:
    """Return the kind of values with an annotation: flags, names, files that are written, or else text."""
    if found := re.search(r"Literal(\[.*?\])", annotation):
        return Choice(ast.literal_eval(found[1]))
    if annotation.startswith("bool"):
        return Flag()
    return Place(remote=remote, output=True) if annotation in ("OptionalPath", "Converted[PathLike, Path]") else Kind()


@dataclass(frozen=True)
class UseCase:
    """What a class of options is for: a command, by its name with that of its group, and the function that it calls.

    The function is `imported` by its name when it is called; or it is one that gets the console and prints. ``plan`` is
    the one for ``--dry-run``, and ``messages`` are options of the console that the command has.
    """

    name: str
    function: str | Callable[..., Any]
    plan: str | None = None
    short_help: str | None = None
    messages: Sequence[str] = ("as_json", "quiet", "verbose", "log_file")


# They are frozen, too; said here, mypy would give inherited options the type that is given instead of the one stored.
@dataclass_transform(kw_only_default=True, field_specifiers=(option,))
class Options:
    """Base of classes of options: frozen dataclasses whose fields are made by `option` and documented by its help.

    If it ``writes_remotely``, its output files may be in object storage. With a ``use_case``, which is not inherited,
    its docstring is the help of a command. ``left_out`` are options of its bases that it does not have.
    ``words`` replace others in their help. Options of classes that others share have a ``place`` after those of these.
    """

    writes_remotely: ClassVar[bool] = False
    use_case: ClassVar[UseCase]
    left_out: ClassVar[Collection[str]] = ()
    place: ClassVar[int] = 0
    words: ClassVar[Mapping[str, str]] = {}

    def __init_subclass__(cls) -> None:
        own = {name: value for name, value in vars(cls).items() if isinstance(value, Option)}
        for name, value in own.items():
            value.name, value.annotation = name, inspect.get_annotations(cls)[name]
            value.place = vars(cls).get("place", 0)
            if value.annotation == "bool" and value.default is None:
                value.default = False
            value.kind = value.kind or _kind_of(value.annotation, remote=cls.writes_remotely)
            setattr(cls, name, field(default=value.default, kw_only=value.kw_only, metadata={Option: value}))
        dataclasses.dataclass(frozen=True)(cls)
        for name, value in own.items():
            setattr(cls, name, value)

    @property
    def outputs(self) -> dict[str, Path]:
        """Files to write, by the option that gives them; what may be a folder is left out."""
        files = [one for one in declared(type(self)).values() if one.kind.output and not one.kind.or_folder]
        return {one.flags[0]: path for one in files if (path := vars(self)[one.name])}

    def part(self, made: K, kind: type[Options] | None = None) -> K:
        """Return another object with those of its options that are of a class, by default its own, as they are here."""
        vars(made).update({name: vars(self)[name] for name in declared(kind or type(made))})
        return made


def declared(kind: type[Any]) -> dict[str, Option]:
    """Return the options of a class by name, in the order of the signature; what runs report to comes last."""
    found = [one.metadata[Option] for one in fields(kind) if one.name not in kind.left_out]
    last = ("keep_going", "observer")
    return {one.name: one for one in sorted(found, key=lambda one: (one.kw_only, one.name in last, one.place))}


def function_of(kind: Callable[P, T]) -> Callable[[Callable[[T], R]], Callable[P, R]]:
    """Return a decorator that makes a function of options take them as its parameters, and documents these."""

    def decorate(run: Callable[[T], R]) -> Callable[P, R]:
        @wraps(run)
        def function(*args: P.args, **kwargs: P.kwargs) -> R:
            if wrong := kwargs.keys() - options:
                raise TypeError(f"{run.__name__}() got an unexpected keyword argument {min(wrong)!r}")
            return run(kind(*args, **kwargs))

        signature, options = inspect.signature(kind), declared(kind)  # type: ignore[arg-type]
        shown = [signature.parameters[name].replace(annotation=_shown(one.annotation)) for name, one in options.items()]
        returned = inspect.signature(run).return_annotation
        function.options = kind  # type: ignore[attr-defined]
        function.__signature__ = inspect.Signature(shown, return_annotation=returned)  # type: ignore[attr-defined]
        function.__doc__ = documented(run.__doc__, kind, _RAISES)
        return function

    return decorate


_RAISES = "Raises\n------\nSeaclutterError\n    If a log or an option cannot be used; see its subclasses."


def documented(text: str | None, kind: Any, raises: str = "") -> str:
    """Return a docstring with the options of a class as its section of parameters, and one of errors, unless it has."""
    lines = ["Parameters", "----------"]
    names = {flag: f"``{name}``" for name, one in declared(kind).items() for flag in one.flags}
    for name, one in declared(kind).items():
        optional = "" if one.default is MISSING else ", optional"
        lines += [f"{name} : {_in_words(one)}{optional}", f"    {_in_python(one.help, names)}"]
    summary, *sections = re.split(r"\n\n(?=\w+\n-----)", inspect.cleandoc(text or ""))
    if raises and not any(section.startswith("Raises") for section in sections):
        sections.insert(len(sections) - 1, raises)
    return "\n\n".join([summary, "\n".join(lines), *sections])


def _shown(annotation: str) -> str:
    if annotation.startswith("Converted["):
        annotation = ast.unparse(ast.parse(annotation, mode="eval").body.slice.elts[0])  # type: ignore[attr-defined]
    return annotation.replace("OptionalPath", "PathLike | None")


def _in_words(one: Option) -> str:
    """Return the type of what is given for an option, for the documentation."""
    text = _shown(one.annotation).removesuffix("" if one.of_command is None else " | None")
    for pattern, words in _WORDS.items():
        text = re.sub(pattern, words, text)
    return text


_WORDS = {
    "PathLike": "path",
    "MethodLike": "str, class, object or function",
    "Moment": "float or datetime",
    r"Sequence\[(.+?\]?)\]": r"sequence of \1",
    r"Mapping\[.*?\]": "mapping",
    r"Literal\[(.*?)\]": r"{\1}",
    r" \| ": " or ",
}


def _in_python(text: str, names: Mapping[str, str]) -> str:
    """Return the help of an option with names of parameters in place of flags."""
    text = re.sub(r" *\[default: [^]]*\]|(?:;|,) repeatable(?=\.)", "", text)
    return re.sub(r"(?<![\w-])--?[a-z][a-z-]*", lambda flag: names.get(flag[0], flag[0]), text)
