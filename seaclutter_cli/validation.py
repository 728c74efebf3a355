"""Settings in YAML files, checked against the dataclasses that declare them; used for configurations and scenes."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import yaml

from seaclutter_cli.errors import ConfigError, RenamedKeyWarning


def builtin_files(folder: str = "") -> Mapping[str, Path]:
    """Return the YAML files that come with the program by name: configurations, or those of a folder beside them."""
    package = Path(__file__).parent
    places = (package / "configs", package.parent / "configs")  # installed; in a checkout
    place = next((place for place in places if place.is_dir()), package) / folder
    return {path.stem: path for path in sorted(place.glob("*.yaml"))}


def find_file(name: str, folder: str, kind: str) -> Path:
    """Return a file by its path, or a built-in one of `builtin_files` by its name, with or without ``.yaml``.

    Raises
    ------
    ConfigError
        If there is neither; ``kind`` is what is missing.
    """
    path = Path(name)
    if path.exists():
        return path
    builtin = builtin_files(folder)
    if name.removesuffix(".yaml") in builtin:
        return builtin[name.removesuffix(".yaml")]
    raise ConfigError(f"{name}: there is no such {kind}; built in are {', '.join(builtin)}")


def read_yaml(path: Path, sections: Sequence[str]) -> dict[str, Any]:
    """Return the content of a file; `ConfigError` if it is no YAML, or not a mapping."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or 'no UTF-8 text'})") from error
    return parse_yaml(text, str(path), sections)


def parse_yaml(text: str, where: str, sections: Sequence[str]) -> dict[str, Any]:
    """Return the content of a text; `ConfigError` that names ``where`` if it is no YAML, or not a mapping."""
    try:
        raw = yaml.load(text, Loader=_StrictLoader)  # noqa: S506 - a SafeLoader
    except yaml.YAMLError as error:
        place = getattr(error, "problem_mark", None)
        line = f", line {place.line + 1}" if place else ""
        raise ConfigError(f"{where}{line}: no valid YAML ({getattr(error, 'problem', None) or error})") from error
    if raw is None:
        return {}
    if not isinstance(raw, dict):
        raise ConfigError(f"{where}: must hold the sections {' and '.join(sections)}, holds {kind_of(raw)}")
    return raw


class _StrictLoader(yaml.SafeLoader):
    """Refuses a key that occurs twice instead of taking the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:  # noqa: FBT002
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for number, key in enumerate(keys):
            if key in keys[:number]:
                raise yaml.constructor.ConstructorError(None, None, f"key {key!r} occurs twice", node.start_mark)
        return super().construct_mapping(node, deep)


def build(kind: type[Any], values: Mapping[str, Any], section: str, owner: str, problems: list[str]) -> Any:
    """Make a parameter object, or add to the problems why not.

    Parameters
    ----------
    kind : type
        Dataclass whose fields are the allowed keys; their annotations hold types and limits.
    values : mapping
        Keys and values as YAML gives them.
    section, owner : str
        Where the keys stand, and what has them, for messages.
    problems : list of str
        Grows by a line for everything that is wrong; then None is returned.
    """
    values = _with_present_names(kind, values, section)
    known = [field.name for field in fields(kind)]
    allowed = ", ".join(known) or "no keys"
    wrong = [f"{section}.{key}: unknown key; {owner} has: {allowed}" for key in values if key not in known]
    unknown = len(wrong)
    nested = {name: entry for name, hint in get_type_hints(kind).items() if (entry := _entry_kind(hint))}
    given = {key: _tuples(values[key]) for key in known if key in values and key not in nested}
    wrong += _type_problems(kind, given, section)
    for key, entry in nested.items():
        if key in values:
            default = _plain_default(kind, key)
            given[key] = _entries(entry, merged(default, values[key]), f"{section}.{key}", wrong)
    problems += wrong
    if len(wrong) > unknown:
        return None
    try:
        return kind(**given)
    except ValueError as error:  # the values do not fit together
        problems.append(f"{section}.{error}")
        return None


def renamed(default: Any, *, formerly: str) -> Any:
    """Return the dataclass field of a key that had another name, which still loads, with a warning."""
    return field(default=default, metadata={"formerly": formerly})


def _with_present_names(kind: type[Any], values: Mapping[str, Any], section: str) -> Mapping[str, Any]:
    """Return values with former names of keys replaced by present ones."""
    names = {former: one.name for one in fields(kind) if (former := one.metadata.get("formerly"))}
    for former, present in names.items():
        if former in values and present not in values:
            text = f"{section}.{former}: this key is now called {present}"
            warnings.warn(RenamedKeyWarning(text), stacklevel=2)
            values = {present if key == former else key: value for key, value in values.items()}
    return values


def build_sections(kinds: Mapping[str, type[Any]], raw: Mapping[str, Any], problems: list[str]) -> dict[str, Any]:
    """Make the parameter object of each section, with defaults for one that is not there; see `build`."""
    parts = {}
    for section, kind in kinds.items():
        values = raw.get(section) or {}
        if not isinstance(values, dict):
            problems.append(f"{section}: must be a section with keys, is {kind_of(values)}")
            values = {}
        parts[section] = build(kind, values, section, section, problems)
    return parts


def build_list(kind: type[Any], raw: Any, section: str, owner: str, problems: list[str]) -> list[Any]:
    """Make a parameter object of each entry of a list, as far as nothing is wrong with it; see `build`."""
    if not isinstance(raw, list):
        problems.append(f"{section}: must be a list, is {kind_of(raw)}")
        return []
    found = []
    for number, values in enumerate(raw):
        if isinstance(values, dict):
            found.append(build(kind, values, f"{section}.{number}", owner, problems))
        else:
            problems.append(f"{section}.{number}: must be a section with keys, is {kind_of(values)}")
    return [entry for entry in found if entry is not None]


def merged(values: Any, over: Any) -> Any:
    """Return settings with others laid over them, key by key where both are mappings.

    Examples
    --------
    >>> merged({"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"b": 4}})
    {'a': {'b': 4, 'c': 2}, 'd': 3}
    """
    if not (isinstance(values, Mapping) and isinstance(over, Mapping)):
        return over
    return {**values, **{key: merged(values.get(key), value) for key, value in over.items()}}


def _entry_kind(hint: Any) -> type[Any] | None:
    """Return the dataclass of a mapping's values, None if the type is no mapping of names to such."""
    kind = get_args(hint)[1] if get_origin(hint) is Mapping else None
    return kind if isinstance(kind, type) and is_dataclass(kind) else None


def _entries(kind: type[Any], values: Any, section: str, problems: list[str]) -> dict[str, Any]:
    """Return the values of a mapping as the dataclass that they are, or add to the problems why not."""
    if not isinstance(values, Mapping):
        problems.append(f"{section}: must be a section with keys, is {kind_of(values)}")
        return {}
    entries = {}
    for name, value in values.items():
        place = f"{section}.{name}"
        if not isinstance(name, str):
            problems.append(f"{place}: must be called by a text, is {kind_of(name)}")
        elif isinstance(value, Mapping):
            entries[name] = build(kind, value, place, "each of them", problems)
        else:
            problems.append(f"{place}: must be a section with keys, is {kind_of(value)}")
    return entries


def _default_of(field: "Field[Any]") -> Any:
    """Return a field's default; an ellipsis, as pydantic has it, if there is none."""
    if field.default_factory is not MISSING:
        return field.default_factory()
    return ... if field.default is MISSING else field.default


def _plain_default(kind: type[Any], key: str) -> Any:
    """Return the default of a key as it stands in a file."""
    return plain(next(_default_of(field) for field in fields(kind) if field.name == key))


def _type_problems(kind: type[Any], values: Mapping[str, Any], section: str) -> list[str]:
    """Tell which values are of a wrong type or beyond their limits."""
    from pydantic import ValidationError

    try:
        _model(kind).model_validate(values)  # type: ignore[arg-type] # a class is hashable
    except ValidationError as error:
        return [_explain(problem, section) for problem in error.errors()]
    return []


@cache
def _model(kind: type[Any]) -> Any:
    """Return the pydantic model of a dataclass; a scene has hundreds of one kind."""
    from pydantic import ConfigDict, create_model

    hints = get_type_hints(kind, include_extras=True)
    declared: dict[str, Any] = {
        field.name: (hints[field.name], _default_of(field))
        for field in fields(kind)
        if not _entry_kind(hints[field.name])
    }
    return create_model(kind.__name__, __config__=ConfigDict(strict=True, allow_inf_nan=False), **declared)


def _explain(problem: Any, section: str) -> str:
    place = ".".join((section, *(str(part) for part in problem["loc"])))
    if problem["type"] == "missing":
        return f"{place}: is missing"
    return f"{place}: {problem['msg'].replace('Input should', 'must')}, is {_shown(problem['input'])}"


def _tuples(value: Any) -> Any:
    """Return YAML's lists as the tuples that frozen parameters hold."""
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value


def as_lists(value: Any) -> Any:
    """Return the tuples that frozen parameters hold as YAML's lists."""
    return [as_lists(item) for item in value] if isinstance(value, tuple) else value


def plain(value: Any) -> Any:
    """Return parameters as they stand in a file: parameter objects are sections there, tuples are lists."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return as_lists(value)


def _shown(value: Any) -> str:
    text = repr(as_lists(value))
    return text if len(text) <= 60 else text[:57] + "..."


def kind_of(value: Any) -> str:
    """Return what a YAML value is, in words."""
    kinds = {list: "a list", dict: "a section", str: "text", bool: "a truth value", type(None): "empty"}
    return kinds.get(type(value), "a number")


def raise_problems(where: str, problems: Sequence[str]) -> None:
    """Raise `ConfigError` if there are problems, with all of them; a single one on one line."""
    if len(problems) == 1:
        raise ConfigError(f"{where}: {problems[0]}")
    if problems:
        raise ConfigError("\n  ".join((f"{where}: {len(problems)} problems", *problems)))
