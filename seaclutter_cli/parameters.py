"""Descriptions of parameters: their docstrings, the names that they allow, and their values in YAML."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any, get_type_hints

import yaml

from seaclutter_cli.text import suggestion


@dataclass(frozen=True)
class OneOf:
    """Annotation of a parameter that is one of several names.

    Parameters
    ----------
    noun : str
        What the names are names of, for messages.
    names : tuple of str
        Allowed names.
    """

    noun: str
    names: tuple[str, ...]


def check_names(params: Any) -> None:
    """Raise `ValueError` if a parameter annotated with `OneOf` has another name."""
    for key, choice in name_choices(type(params)).items():
        value = getattr(params, key)
        if value not in choice.names:
            meant = suggestion(value, choice.names)
            raise ValueError(f"{key}: unknown {choice.noun} {value!r}; {meant}allowed: {', '.join(choice.names)}")


def name_choices(kind: type[Any]) -> dict[str, OneOf]:
    """Return the parameters of a class that are one of several names."""
    hints = get_type_hints(kind, include_extras=True)
    found = {
        field.name: [entry for entry in getattr(hints[field.name], "__metadata__", ()) if isinstance(entry, OneOf)]
        for field in fields(kind)
    }
    return {key: choices[0] for key, choices in found.items() if choices}


def summary(kind: type[Any]) -> str:
    """Return the first sentence of a class's docstring, without its full stop."""
    return (kind.__doc__ or "").partition("\n")[0].removesuffix(".")


def descriptions(kind: type[Any]) -> dict[str, str]:
    """Return the description of each parameter from the docstrings of a class and its bases."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        found |= _documented(base.__doc__ or "")
    return found


def _documented(docstring: str) -> Iterable[tuple[str, str]]:
    found = re.findall(r"^    (\w[\w, ]*) : .*\n((?:        .*\n)+)", docstring, re.MULTILINE)
    for names, text in found:
        plain = re.sub(r":math:`([^`]*)`|``([^`]*)``", r"\1\2", " ".join(text.split()))
        for name in names.split(", "):
            yield name, plain


def yaml_value(value: Any) -> str:
    """Return a value as YAML on one line.

    Examples
    --------
    >>> yaml_value([1, None, "a: b"])
    "[1, null, 'a: b']"
    """
    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False, allow_unicode=True)
    return str(text).splitlines()[0]
