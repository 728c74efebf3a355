"""Validation of YAML settings against the dataclasses that declare them, for configurations and scenes."""

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from seaclutter_cli.documents import MAX_YAML_CHARACTERS, DocumentError, load_yaml
from seaclutter_cli.errors import ConfigError, RenamedKeyWarning
from seaclutter_cli.parameters import name_choices
from seaclutter_cli.text import count, printable, suggestion

_SHOWN_PROBLEMS = 100


def builtin_files(folder: str = "") -> Mapping[str, Path]:
    """Return the built-in YAML files by name: the configurations, or the files of a folder below them."""
    package = Path(__file__).parent
    candidates = (package / "configs", package.parent / "configs")  # installed; in a checkout
    configs = next((path for path in candidates if path.is_dir()), package)
    return {path.stem: path for path in sorted((configs / folder).glob("*.yaml"))}


def find_file(name: str, folder: str, kind: str) -> Path:
    """Return the path of a file, or of a built-in file with this name, with or without ``.yaml``.

    Raises
    ------
    ConfigError
        If there is neither; the message calls the file ``kind``.
    """
    path = Path(name)
    if path.exists():
        return path
    builtin = builtin_files(folder)
    if name.removesuffix(".yaml") in builtin:
        return builtin[name.removesuffix(".yaml")]
    raise ConfigError(f"{name}: no such {kind}; {suggestion(name, builtin)}built-in ones: {', '.join(builtin)}")


def read_yaml(path: Path, sections: Sequence[str]) -> dict[str, Any]:
    """Return the content of a file; raise `ConfigError` if it is not a YAML mapping."""
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(MAX_YAML_CHARACTERS + 1)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or 'not UTF-8 text'})") from error
    return parse_yaml(text, str(path), sections)


def parse_yaml(text: str, where: str, sections: Sequence[str]) -> dict[str, Any]:
    """Return the content of a text; raise `ConfigError` that names ``where`` if it is not a YAML mapping."""
    try:
        raw = load_yaml(text)
    except DocumentError as error:
        raise ConfigError(f"{where}: {error}") from error
    if raw is None:
        return {}
    if not isinstance(raw, dict):
        raise ConfigError(f"{where}: must contain sections ({', '.join(sections)}), got {kind_of(raw)}")
    return raw


def parse_value(text: str, option: str) -> Any:
    """Return the YAML value on the command line; raise `ConfigError` that names ``option`` if it is not valid."""
    try:
        return load_yaml(text)
    except DocumentError as error:
        raise ConfigError(f"{option}: {error}") from error


def build(kind: type[Any], values: Mapping[str, Any], section: str, owner: str, problems: list[str]) -> Any:
    """Return a parameter object, or None if the values are not valid.

    Parameters
    ----------
    kind : type
        Dataclass whose fields are the allowed keys; their annotations declare types and limits.
    values : mapping
        Keys and values as loaded from YAML.
    section, owner : str
        Path of the keys and name of their owner, for messages.
    problems : list of str
        A line is appended for every problem.
    """
    values = _with_current_names(kind, values, section)
    known = [field.name for field in fields(kind)]
    allowed = ", ".join(known) or "no keys"
    wrong = [
        f"{section}.{key}: unknown key; {suggestion(str(key), known)}allowed for {owner}: {allowed}"
        for key in values
        if key not in known
    ]
    unknown = len(wrong)
    hints = get_type_hints(kind)
    nested = {name: entry for name, hint in hints.items() if (entry := _entry_kind(hint))}
    listed = {name: entry for name, hint in hints.items() if (entry := _listed_kind(hint))}
    given = {key: _tuples(values[key]) for key in known if key in values and key not in (*nested, *listed)}
    wrong += _type_problems(kind, given, section)
    for key, entry in nested.items():
        if key in values:
            default = _plain_default(kind, key)
            given[key] = _entries(entry, merged(default, values[key]), f"{section}.{key}", wrong)
    for key, entry in listed.items():
        if key in values:
            given[key] = tuple(build_list(entry, values[key], f"{section}.{key}", "each entry", wrong))
    problems += wrong
    if len(wrong) > unknown:
        return None
    try:
        return kind(**given)
    except ValueError as error:  # values that contradict each other
        problems.append(f"{section}.{error}")
        return None


def renamed(default: Any, *, formerly: str) -> Any:
    """Return a dataclass field for a renamed key; the former name still loads, with a warning."""
    return field(default=default, metadata={"formerly": formerly})


def _with_current_names(kind: type[Any], values: Mapping[str, Any], section: str) -> Mapping[str, Any]:
    """Return values with former names of keys replaced by the current names."""
    names = {former: one.name for one in fields(kind) if (former := one.metadata.get("formerly"))}
    for former, current in names.items():
        if former in values and current not in values:
            text = f"{section}.{former}: this key is now called {current}"
            warnings.warn(RenamedKeyWarning(text), stacklevel=2)
            values = {current if key == former else key: value for key, value in values.items()}
    return values


def build_sections(kinds: Mapping[str, type[Any]], raw: Mapping[str, Any], problems: list[str]) -> dict[str, Any]:
    """Return the parameter object of each section, with defaults for missing sections; see `build`."""
    parts = {}
    for section, kind in kinds.items():
        values = raw.get(section) or {}
        if not isinstance(values, dict):
            problems.append(_not_a_section(section, values))
            values = {}
        parts[section] = build(kind, values, section, section, problems)
    return parts


def build_list(kind: type[Any], raw: Any, section: str, owner: str, problems: list[str]) -> list[Any]:
    """Return a parameter object for each valid entry of a list; see `build`."""
    if not isinstance(raw, list):
        problems.append(f"{section}: must be a list, got {kind_of(raw)}")
        return []
    found = []
    for index, values in enumerate(raw):
        if isinstance(values, dict):
            found.append(build(kind, values, f"{section}.{index}", owner, problems))
        else:
            problems.append(_not_a_section(f"{section}.{index}", values))
    return [entry for entry in found if entry is not None]


def merged(values: Any, over: Any) -> Any:
    """Return settings overridden by others, key by key where both are mappings.

    Examples
    --------
    >>> merged({"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"b": 4}})
    {'a': {'b': 4, 'c': 2}, 'd': 3}
    """
    if not (isinstance(values, Mapping) and isinstance(over, Mapping)):
        return over
    return {**values, **{key: merged(values.get(key), value) for key, value in over.items()}}


def _entry_kind(hint: Any) -> type[Any] | None:
    """Return the dataclass of the values of a mapping; None if the type is not a mapping to a dataclass."""
    kind = get_args(hint)[1] if get_origin(hint) is Mapping else None
    return kind if isinstance(kind, type) and is_dataclass(kind) else None


def _listed_kind(hint: Any) -> type[Any] | None:
    """Return the dataclass of the items of a tuple of any length; None if the type is another one."""
    kind = get_args(hint)[0] if get_origin(hint) is tuple and get_args(hint)[1:] == (...,) else None
    return kind if isinstance(kind, type) and is_dataclass(kind) else None


def _entries(kind: type[Any], values: Any, section: str, problems: list[str]) -> dict[str, Any]:
    """Return the values of a mapping as parameter objects; problems are appended."""
    if not isinstance(values, Mapping):
        problems.append(_not_a_section(section, values))
        return {}
    entries = {}
    for name, value in values.items():
        path = f"{section}.{name}"
        if not isinstance(name, str):
            problems.append(f"{path}: the name must be text, got {kind_of(name)}")
        elif isinstance(value, Mapping):
            entries[name] = build(kind, value, path, "each entry", problems)
        else:
            problems.append(_not_a_section(path, value))
    return entries


def _not_a_section(path: str, value: Any) -> str:
    return f"{path}: must be a section with keys, got {kind_of(value)}"


def _default_of(field: "Field[Any]") -> Any:
    """Return the default of a field; an ellipsis, as pydantic expects, if it has none."""
    if field.default_factory is not MISSING:
        return field.default_factory()
    return ... if field.default is MISSING else field.default


def _plain_default(kind: type[Any], key: str) -> Any:
    """Return the default of a key as a YAML value."""
    return plain(next(_default_of(field) for field in fields(kind) if field.name == key))


def _type_problems(kind: type[Any], values: Mapping[str, Any], section: str) -> list[str]:
    """Return a line for each value of the wrong type or outside its limits."""
    from pydantic import ValidationError

    try:
        _model(kind).model_validate(values)  # type: ignore[arg-type] # a class is hashable
    except ValidationError as error:
        schema = _model(kind).model_json_schema()  # type: ignore[arg-type]
        found = error.errors()
        # A list with a wrong value is also reported as too short, since pydantic counts only valid values.
        inner = {problem["loc"][:end] for problem in found for end in range(1, len(problem["loc"]))}
        primary = [problem for problem in found if problem["type"] != "too_short" or problem["loc"] not in inner]
        return list(dict.fromkeys(_explain(problem, schema, section) for problem in primary))
    return []


@cache
def _model(kind: type[Any]) -> Any:
    """Return the pydantic model of a dataclass; cached, since a scene has hundreds of one kind."""
    from pydantic import ConfigDict, create_model

    hints = get_type_hints(kind, include_extras=True)
    declared: dict[str, Any] = {
        field.name: (hints[field.name], _default_of(field))
        for field in fields(kind)
        if not (_entry_kind(hints[field.name]) or _listed_kind(hints[field.name]))
    }
    return create_model(kind.__name__, __config__=ConfigDict(strict=True, allow_inf_nan=False), **declared)


def _explain(problem: Any, schema: Any, section: str) -> str:
    """Return the message for a problem found by pydantic; the JSON schema describes the valid values."""
    place = section
    for part in problem["loc"]:
        options = [option for option in schema.get("anyOf", (schema,)) if option["type"] != "null"]
        if isinstance(part, str) and "properties" not in options[0]:
            break  # pydantic names the alternative of a union that did not match
        place = f"{place}.{part}"
        if problem["type"] != "missing":
            schema = options[0]["properties"][part] if isinstance(part, str) else _item(options[0], part)
    if problem["type"] == "missing":
        return f"{place}: is missing"
    expected = _expected(schema)
    if problem["type"] == "finite_number":
        expected = expected.replace("number", "finite number")
    return f"{place}: must be {expected}, got {_shown(problem['input'])}"


def allowed_values(kind: type[Any]) -> dict[str, str]:
    """Return the values that each parameter of a class allows, in words.

    Examples
    --------
    >>> from seaclutter_cli.evaluation import EvaluationParams
    >>> allowed_values(EvaluationParams)["min_cluster_points"]
    'a whole number greater than or equal to 1'
    """
    schema, names = _model(kind).model_json_schema(), name_choices(kind)  # type: ignore[arg-type]
    words = {key: _expected(value) for key, value in schema["properties"].items()}
    return {**words, **{key: f"one of {', '.join(choice.names)}" for key, choice in names.items()}}


def _item(schema: Any, index: int) -> Any:
    return schema["items"] if "items" in schema else schema["prefixItems"][index]


def _expected(schema: Any) -> str:
    """Return the values that a JSON schema allows, in words.

    Examples
    --------
    >>> _expected({"type": "number", "exclusiveMinimum": 0, "maximum": 1})
    'a number greater than 0 and less than or equal to 1'
    >>> _expected({"anyOf": [{"type": "integer", "minimum": 1, "maximum": 9}, {"type": "null"}]})
    'a whole number from 1 to 9 or null'
    """
    if "anyOf" in schema:
        return " or ".join(_expected(option) for option in schema["anyOf"])
    if "const" in schema:
        return json.dumps(schema["const"])
    if "enum" in schema:
        return " or ".join(json.dumps(value) for value in schema["enum"])
    kind, limits = _TYPES[schema["type"]], [f"{words} {schema[key]}" for key, words in _LIMITS.items() if key in schema]
    if "minimum" in schema and "maximum" in schema:
        limits = [f"from {schema['minimum']} to {schema['maximum']}"]
    if "minItems" in schema:
        limits = [f"of {'' if 'maxItems' in schema else 'at least '}{count(schema['minItems'], 'value')}"]
    return " ".join((kind, " and ".join(limits))).rstrip()


_TYPES = {
    "array": "a list",
    "boolean": "true or false",
    "integer": "a whole number",
    "null": "null",
    "number": "a number",
    "string": "text",
}
_LIMITS = {
    "minimum": "greater than or equal to",
    "exclusiveMinimum": "greater than",
    "maximum": "less than or equal to",
    "exclusiveMaximum": "less than",
}


def _tuples(value: Any) -> Any:
    """Return a YAML value with tuples in place of lists, as frozen parameters need it."""
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value


def as_lists(value: Any) -> Any:
    """Return a value of frozen parameters with lists in place of tuples, as YAML needs it."""
    return [as_lists(item) for item in value] if isinstance(value, tuple) else value


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
