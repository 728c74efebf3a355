"""Settings in YAML files, checked against the dataclasses that declare them; used for configurations and scenes."""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, get_type_hints

import yaml

from seaclutter_cli.errors import ConfigError


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
    known = [field.name for field in fields(kind)]
    allowed = ", ".join(known) or "no keys"
    problems += [f"{section}.{key}: unknown key; {owner} has: {allowed}" for key in values if key not in known]
    given = {key: _tuples(values[key]) for key in known if key in values}
    wrong = _type_problems(kind, given, section)
    problems += wrong
    if wrong:
        return None
    try:
        return kind(**given)
    except ValueError as error:  # the values do not fit together
        problems.append(f"{section}.{error}")
        return None


def _type_problems(kind: type[Any], values: Mapping[str, Any], section: str) -> list[str]:
    """Tell which values are of a wrong type or beyond their limits."""
    from pydantic import ConfigDict, ValidationError, create_model

    hints = get_type_hints(kind, include_extras=True)
    declared: dict[str, Any] = {
        field.name: (hints[field.name], ... if field.default is MISSING else field.default) for field in fields(kind)
    }
    config = ConfigDict(strict=True, allow_inf_nan=False)
    try:
        create_model(kind.__name__, __config__=config, **declared).model_validate(values)
    except ValidationError as error:
        return [_explain(problem, section) for problem in error.errors()]
    return []


def _explain(problem: Any, section: str) -> str:
    place = ".".join((section, *(str(part) for part in problem["loc"])))
    return f"{place}: {problem['msg'].replace('Input should', 'must')}, is {_shown(problem['input'])}"


def _tuples(value: Any) -> Any:
    """Return YAML's lists as the tuples that frozen parameters hold."""
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value


def as_lists(value: Any) -> Any:
    """Return the tuples that frozen parameters hold as YAML's lists."""
    return [as_lists(item) for item in value] if isinstance(value, tuple) else value


def _shown(value: Any) -> str:
    text = repr(as_lists(value))
    return text if len(text) <= 60 else text[:57] + "..."


def kind_of(value: Any) -> str:
    """Return what a YAML value is, in words."""
    return {list: "a list", dict: "a section", str: "text", bool: "a truth value"}.get(type(value), "a number")


def refuse(where: str, problems: Sequence[str]) -> None:
    """Raise `ConfigError` if there are problems, with all of them; a single one on one line."""
    if len(problems) == 1:
        raise ConfigError(f"{where}: {problems[0]}")
    if problems:
        raise ConfigError("\n  ".join((f"{where}: {len(problems)} problems", *problems)))
