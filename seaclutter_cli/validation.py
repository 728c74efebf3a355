"""Settings in YAML against the dataclasses that declare them: types, limits, former names, words, and comments."""

import io
import json
import math
import operator
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import yaml

from seaclutter_cli.documents import MAX_DEPTH, MAX_YAML_CHARACTERS, DocumentError, load_yaml
from seaclutter_cli.errors import ConfigError, RenamedKeyWarning, about
from seaclutter_cli.params import OneOf
from seaclutter_cli.paths import open_regular
from seaclutter_cli.text import count, printable, suggestion

_SHOWN_PROBLEMS = 100
_hints: Callable[[Any], dict[str, Any]] = cache(partial(get_type_hints, include_extras=True))
"""Types of a dataclass; cached, since a scene has hundreds of one kind."""


def builtin_files(folder: str = "") -> Mapping[str, Path]:
    """Return the built-in YAML files by name: the configurations, or the files of a folder below them."""
    package = Path(__file__).parent
    candidates = (package / "configs", package.parent / "configs")  # installed; in a checkout
    configs = next((path for path in candidates if path.is_dir()), package)
    return {path.stem: path for path in sorted((configs / folder).glob("*.yaml"))}


def find_file(name: str, folder: str, kind: str) -> Path:
    """Return the path of a file, or of a built-in one of this name, with or without ``.yaml``.

    Raise `ConfigError` if there is neither; the message calls the file ``kind``.
    """
    path = Path(name)
    if path.exists():
        return path
    builtin = builtin_files(folder)
    if name.removesuffix(".yaml") in builtin:
        return builtin[name.removesuffix(".yaml")]
    raise ConfigError(f"{name}: no such {kind}; {suggestion(name, builtin)}built-in ones: {', '.join(builtin)}")


def read_yaml(path: Path, sections: Sequence[str]) -> Any:
    """Return the content of a file; raise `ConfigError` if it is not a YAML mapping."""
    try:
        with io.TextIOWrapper(open_regular(path), encoding="utf-8") as file:
            text = file.read(MAX_YAML_CHARACTERS + 1)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or 'not UTF-8 text'})") from error
    return parse_yaml(text, str(path), sections)


def parse_yaml(text: str, where: str, sections: Sequence[str] = ()) -> Any:
    """Return the content of a text, a mapping if it has ``sections``; raise `ConfigError` that names ``where``."""
    with about(where, ConfigError, DocumentError):
        raw = load_yaml(text)
    if sections and raw is not None and not isinstance(raw, dict):
        raise ConfigError(f"{where}: must contain sections ({', '.join(sections)}), got {kind_of(raw)}")
    return {} if sections and raw is None else raw


def parse_override(text: str, sections: Collection[str], form: str) -> dict[str, Any]:
    """Return ``section.key=value`` of ``--set`` as the section of a file; dots separate nested keys."""
    path, equals, value = text.partition("=")
    section, *keys = path.strip().split(".")
    if not (equals and all(keys) and 0 < len(keys) <= MAX_DEPTH and section in sections):
        raise ConfigError(f"--set {text}: write it as {form}")
    settings = parse_yaml(value, f"--set {text}")
    for name in reversed((section, *keys)):
        settings = {name: settings}
    return dict(settings)


def build(kind: type[Any], values: Mapping[str, Any], section: str, owner: str, problems: list[str]) -> Any:
    """Return a parameter object from keys and values of YAML; None if they are not valid.

    ``kind`` is a dataclass whose annotations declare types and limits. ``section`` is the path of the keys, ``owner``
    the name of their owner for messages. A line is appended to ``problems`` for each problem.
    """
    values = _with_current_names(kind, values, section)
    hints, known = _hints(kind), [one.name for one in fields(kind)]
    allowed = f"allowed for {owner}: {', '.join(known) or 'no keys'}"
    unknown = [key for key in values if key not in known]
    problems += [f"{section}.{key}: unknown key; {suggestion(str(key), known)}{allowed}" for key in unknown]
    wrong: list[str] = []
    given = {}
    for one in fields(kind):
        place, hint = f"{section}.{one.name}", hints[one.name]
        if one.name in values:
            given[one.name] = _read(hint, merged(plain(_default_of(one)), values[one.name]), place, wrong)
        elif _default_of(one) is MISSING:
            wrong.append(f"{place}: is missing")
    problems += wrong
    try:
        return None if wrong else kind(**given)
    except ValueError as error:  # values that contradict each other
        problems.append(f"{section}.{error}")
        return None


def _with_current_names(kind: type[Any], values: Mapping[str, Any], section: str) -> Mapping[str, Any]:
    names = {former: one.name for one in fields(kind) if (former := one.metadata.get("formerly"))}
    for former, current in names.items():
        if former in values and current not in values:
            text = f"{section}.{former}: this key is now called {current}"
            warnings.warn(RenamedKeyWarning(text), stacklevel=2)
            values = {current if key == former else key: value for key, value in values.items()}
    return values


def sections_of(raw: Mapping[str, Any], names: Iterable[str], problems: list[str]) -> dict[str, dict[str, Any]]:
    """Return the keys of each section of a file; a line is appended to ``problems`` for each that is none."""
    sections = {name: {} if raw.get(name) is None else raw[name] for name in names}
    problems += [_not_a_section(name, values) for name, values in sections.items() if not isinstance(values, Mapping)]
    return {name: dict(values) if isinstance(values, Mapping) else {} for name, values in sections.items()}


def build_sections(kinds: Mapping[str, type[Any]], raw: Mapping[str, Any], problems: list[str]) -> dict[str, Any]:
    """Return the parameter object of each section, with defaults for missing sections; see `build`."""
    found = sections_of(raw, kinds, problems)
    return {section: build(kind, found[section], section, section, problems) for section, kind in kinds.items()}


def build_list(kind: type[Any], raw: Any, section: str, problems: list[str]) -> list[Any]:
    """Return a parameter object for each valid entry of a list; see `build`."""
    if not isinstance(raw, list):
        problems.append(f"{section}: must be a list, got {kind_of(raw)}")
        return []
    found = [_read(kind, values, f"{section}.{index}", problems) for index, values in enumerate(raw)]
    return [entry for entry in found if entry is not None]


def merged(values: Any, over: Any) -> Any:
    """Return settings overridden by others, key by key where both are mappings."""
    if not (isinstance(values, Mapping) and isinstance(over, Mapping)):
        return over
    return {**values, **{key: merged(values.get(key), value) for key, value in over.items()}}


def _not_a_section(path: str, value: Any) -> str:
    return f"{path}: must be a section with keys, got {kind_of(value)}"


def _default_of(one: "Field[Any]") -> Any:
    return one.default if one.default_factory is MISSING else one.default_factory()


def _read(hint: Any, value: Any, place: str, problems: list[str]) -> Any:
    """Return a value of YAML as its type declares it; a line is appended to ``problems`` for each problem."""
    kinds = _alternatives(hint)
    if value is None and NoneType in kinds:
        return None
    other = next((one for one in kinds[1:] if not _problems(one, value)), kinds[0])
    kind, items, bounds, choice = _declared(other)
    before = len(problems)
    if kind is Mapping or is_dataclass(kind):
        if not isinstance(value, Mapping):
            problems.append(_not_a_section(place, value))
            return None
        if kind is not Mapping:
            return build(kind, value, place, "each entry", problems)  # type: ignore[arg-type]
        names = [name for name in value if not isinstance(name, str)]
        problems += [f"{place}.{name}: the name must be text, got {kind_of(name)}" for name in names]
        return {name: _read(items[1], one, f"{place}.{name}", problems) for name, one in value.items()}
    if kind is tuple and isinstance(value, list | tuple):
        kinds = items[:1] * len(value) if items[1:] == (...,) else items
        known = zip(kinds, value, strict=False)
        parts = (_read(one, part, f"{place}.{index}", problems) for index, (one, part) in enumerate(known))
        value = (*parts, *value[len(kinds) :])
    if len(problems) == before and not _fits(kind, items, bounds, value):
        expected = _in_words(hint)
        if isinstance(value, float) and not math.isfinite(value):
            expected = expected.replace("a number", "a finite number")
        problems.append(f"{place}: must be {expected}, got {_shown(value)}")
    elif choice and value not in choice.names:
        meant = suggestion(value, choice.names)
        problems.append(f"{place}: unknown {choice.noun} {value!r}; {meant}allowed: {', '.join(choice.names)}")
    return value


def _alternatives(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _problems(hint: Any, value: Any) -> list[str]:
    problems: list[str] = []
    _read(hint, value, "", problems)
    return problems


def _declared(hint: Any) -> tuple[Any, tuple[Any, ...], dict[str, Any], OneOf | None]:
    """Return the type in an annotation, its arguments, its limits by name, and the names that are allowed."""
    kind, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    items = get_args(kind)
    bounds = {name: limit for note in notes for name in _LIMITS if (limit := getattr(note, name, None)) is not None}
    if get_origin(kind) is tuple and items[1:] != (...,):
        bounds = {"min_length": len(items), "max_length": len(items)}
    return get_origin(kind) or kind, items, bounds, next((note for note in notes if isinstance(note, OneOf)), None)


def _fits(kind: Any, items: Sequence[Any], bounds: Mapping[str, Any], value: Any) -> bool:
    """Return whether a value has a type and is within its limits."""
    if kind is Literal:
        return any(value == one and type(value) is type(one) for one in items)
    if isinstance(value, bool) or kind is bool:
        return isinstance(value, bool) and kind is bool
    if not isinstance(value, int | float if kind is float else kind):
        return False
    if isinstance(value, float) and not math.isfinite(value):
        return False
    size: Any = len(value) if isinstance(value, tuple) else value
    return all(_LIMITS[name][0](size, limit) for name, limit in bounds.items())


def _in_words(hint: Any) -> str:
    """Return the values that a type allows, as in ``a number greater than 0 and less than or equal to 1``."""
    if hint is NoneType:
        return "null"
    if len(kinds := _alternatives(hint)) > 1:
        return " or ".join(map(_in_words, kinds))
    kind, items, bounds, choice = _declared(hint)
    if choice:
        return f"one of {', '.join(choice.names)}"
    if kind is Literal:
        return " or ".join(map(json.dumps, items))
    limits = [f"{words} {bounds[name]}" for name, (_, words) in _LIMITS.items() if name in bounds]
    if "ge" in bounds and "le" in bounds:
        limits = [f"from {bounds['ge']} to {bounds['le']}"]
    if "min_length" in bounds:
        limits = [f"of {'' if 'max_length' in bounds else 'at least '}{count(bounds['min_length'], 'value')}"]
    return " ".join((_KINDS[kind], " and ".join(limits))).rstrip()


_KINDS = {tuple: "a list", bool: "true or false", int: "a whole number", float: "a number", str: "text"}
_LIMITS: Mapping[str, tuple[Callable[[Any, Any], bool], str]] = {
    "ge": (operator.ge, "greater than or equal to"),
    "gt": (operator.gt, "greater than"),
    "le": (operator.le, "less than or equal to"),
    "lt": (operator.lt, "less than"),
    "min_length": (operator.ge, "of at least"),
    "max_length": (operator.le, "of at most"),
}


def name_choices(kind: type[Any]) -> dict[str, OneOf]:
    """Return the parameters of a class that are one of several names."""
    return {name: choice for name, hint in _hints(kind).items() if (choice := _declared(hint)[3])}


def plain(value: Any) -> Any:
    """Return parameters as YAML values: parameter objects become sections, tuples become lists."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return [plain(item) for item in value] if isinstance(value, tuple) else value


def _shown(value: Any) -> str:
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except (TypeError, ValueError):  # a key that JSON does not allow, or a circular reference
        text = repr(value)
    text = printable(text[:61])
    return text if len(text) <= 60 else text[:57] + "..."


def kind_of(value: Any) -> str:
    """Return the type of a YAML value in words."""
    kinds = {list: "a list", dict: "a section", str: "text", bool: "a Boolean", type(None): "nothing"}
    return "a number" if type(value) in (int, float) else kinds.get(type(value), f"a {type(value).__name__}")


def raise_problems(where: str, problems: Sequence[str], advice: str = "") -> None:
    """Raise `ConfigError` with all problems, if there are any, and advice; a single problem on one line."""
    if len(problems) == 1:
        raise ConfigError(f"{where}: {problems[0]}" + (f" ({advice})" if advice else ""))
    if problems:
        more = [f"and {len(problems) - _SHOWN_PROBLEMS} more"] if len(problems) > _SHOWN_PROBLEMS else []
        shown = (f"{where}: {len(problems)} problems", *problems[:_SHOWN_PROBLEMS], *more, advice)
        raise ConfigError("\n  ".join(filter(None, shown)))


def summary(kind: type[Any]) -> str:
    """Return the first sentence of a class's docstring, without its full stop."""
    return (kind.__doc__ or "").partition("\n")[0].removesuffix(".")


def descriptions(kind: type[Any]) -> dict[str, str]:
    """Return the meaning of each parameter; one that a subclass declares again may keep that of its base."""
    declared = [one for base in reversed(kind.__mro__) if is_dataclass(base) for one in fields(base)]
    return {one.name: meaning for one in declared if (meaning := one.metadata.get("meaning"))}


def yaml_value(value: Any) -> str:
    """Return a value as YAML on one line, such as ``[1, null, 'a: b']``."""
    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False, allow_unicode=True)
    return str(text).splitlines()[0]
