"""YAML and JSON from outside, with bounded size, depth and numbers, so that no text costs more than it should."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from seaclutter_cli.errors import opening
from seaclutter_cli.paths import open_regular

MAX_YAML_CHARACTERS = 4 * 2**20
MAX_YAML_NODES = 250_000
MAX_JSON_BYTES = 16 * 2**20
MAX_DEPTH = 50
MAX_NUMBER_CHARACTERS = 100
"""Limits; a few hundred times what configurations, scenes, labels and metadata of recordings need."""

_CORE = "tag:yaml.org,2002:"
_SCALARS = dict.fromkeys((_CORE + kind for kind in ("null", "bool", "int", "float", "str")), yaml.ScalarNode)
_TYPES = {**_SCALARS, _CORE + "seq": yaml.SequenceNode, _CORE + "map": yaml.MappingNode}
_Base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # some builds of PyYAML lack the fast one


class DocumentError(ValueError):
    """A text is not valid YAML or JSON, or exceeds a limit; says what is wrong and where, both from 1, on one line."""

    def __init__(self, problem: str, line: int = 0, column: int = 0) -> None:
        super().__init__(f"line {line}, column {column}: {problem}" if line else problem)


def read_document(path: Path) -> bytes:
    """Return the content of a file, cut above the limit of JSON; `InputError` if it is not readable."""
    with opening(path), open_regular(path) as file:
        return file.read(MAX_JSON_BYTES + 1)


def load_yaml(text: str) -> Any:
    """Return the content of a YAML document; None if it is empty.

    Nulls, Booleans, numbers, text, lists and mappings are known; dates are text. Duplicate keys, aliases and other
    types are refused. Raise `DocumentError` if the text is not such a document, or exceeds a limit.
    """
    if len(text) > MAX_YAML_CHARACTERS:
        raise DocumentError(f"more than {MAX_YAML_CHARACTERS:,} characters")
    if found := yaml.reader.Reader.NON_PRINTABLE.search(text):
        before = text[: found.start()]
        line, column = before.count("\n") + 1, found.start() - before.rfind("\n")
        raise DocumentError(f"not valid YAML (the character {found[0]!a} is not allowed)", line, column)
    try:
        _check_events(yaml.parse(text, Loader=_Base))
        return yaml.load(text, Loader=_Loader)  # noqa: S506 - a SafeLoader
    except yaml.YAMLError as error:
        problem = str(getattr(error, "problem", None) or error)
        context = f"{getattr(error, 'context', '')} " if problem.startswith("but ") else ""
        raise DocumentError(f"not valid YAML ({context}{problem})", *_place(error, text.splitlines())) from error


def _place(error: yaml.YAMLError, lines: Sequence[str]) -> tuple[int, int]:
    """Return line and column of an error, both from 1; 0 if unknown."""
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    if mark is None or not lines:
        return 0, 0
    at_end = mark.line >= len(lines)  # the fast loader places the end of a text in a line after it
    return (len(lines), len(lines[-1]) + 1) if at_end else (mark.line + 1, mark.column + 1)


def _check_events(events: Iterable[Any]) -> None:
    depth = nodes = 0
    for event in events:
        nodes += isinstance(event, yaml.NodeEvent)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if isinstance(event, yaml.AliasEvent):
            raise _error("aliases are not supported; repeat the value", event)
        if depth > MAX_DEPTH:
            raise _error(f"more than {MAX_DEPTH} levels", event)
        if nodes > MAX_YAML_NODES:
            raise _error(f"more than {MAX_YAML_NODES:,} values", event)


def _error(problem: str, place: Any) -> yaml.MarkedYAMLError:
    return yaml.constructor.ConstructorError(None, None, problem, place.start_mark)


def _wrong_type(node: yaml.Node) -> yaml.MarkedYAMLError:
    return _error(f"the value is not of type {node.tag.removeprefix(_CORE)}", node)


class _Loader(_Base):  # type: ignore[misc]
    """Loader of the core types that rejects duplicate keys instead of using the last."""

    yaml_implicit_resolvers: Mapping[str, Any] = {
        first: [(tag, pattern) for tag, pattern in resolvers if tag in _TYPES]
        for first, resolvers in _Base.yaml_implicit_resolvers.items()
    }

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:  # noqa: FBT002
        if node.tag not in _TYPES:
            raise _error(f"the type {node.tag} is not supported", node)
        if not isinstance(node, _TYPES[node.tag]):
            raise _wrong_type(node)
        if node.tag in (f"{_CORE}int", f"{_CORE}float") and len(node.value) > MAX_NUMBER_CHARACTERS:
            raise _error(f"a number of more than {MAX_NUMBER_CHARACTERS} characters", node)
        try:
            value = super().construct_object(node, deep)
        except (ValueError, LookupError) as error:
            raise _wrong_type(node) from error
        if type(value) is int and not -(2**63) <= value < 2**63:
            raise _error("a whole number of more than 64 bits", node)
        return value

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:  # noqa: FBT002
        known: set[Any] = set()
        for item, _ in node.value:
            if not isinstance(item, yaml.ScalarNode):
                raise _error("a key must be a single value", item)
            key = self.construct_object(item)
            if key in known:
                raise _error(f"duplicate key {key!r}", item)
            known.add(key)
        return dict(super().construct_mapping(node, deep))


def load_json(data: bytes | str, *, max_bytes: int = MAX_JSON_BYTES) -> Any:
    """Return the content of a JSON document; bytes are in UTF-8, UTF-16 or UTF-32.

    Raise `DocumentError` if the data are not valid JSON, or exceed a limit.
    """
    if len(data) > max_bytes:
        raise DocumentError(f"more than {max_bytes:,} bytes")
    try:
        document = json.loads(data, parse_int=_whole_number)
    except json.JSONDecodeError as error:
        raise DocumentError(f"not valid JSON ({error.msg})", error.lineno, error.colno) from error
    except UnicodeDecodeError as error:
        raise DocumentError("not valid JSON (not UTF-8 text)") from error
    except RecursionError as error:
        raise _too_deep() from error
    _check_depth(document)
    return document


def _whole_number(text: str) -> int:
    if len(text) > MAX_NUMBER_CHARACTERS:
        raise DocumentError(f"a number of more than {MAX_NUMBER_CHARACTERS} characters")
    return int(text)


def _check_depth(document: Any) -> None:
    level = [document]
    for _ in range(MAX_DEPTH + 1):
        containers = [item.values() if isinstance(item, dict) else item for item in level if type(item) in (dict, list)]
        level = [item for container in containers for item in container]
        if not containers:
            return
    raise _too_deep()


def _too_deep() -> DocumentError:
    return DocumentError(f"more than {MAX_DEPTH} levels")
