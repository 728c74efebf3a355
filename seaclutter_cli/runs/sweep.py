"""Grids of parameter values from the command line."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from typing import Any

import yaml

from seaclutter_cli.documents import DocumentError, load_yaml
from seaclutter_cli.errors import UsageError
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.runs.methods import Base, Variant
from seaclutter_cli.runs.methods import bases as bases_of
from seaclutter_cli.runs.options import MethodOptions

_RANGE = re.compile(r"\s*(-?[\d.]+)\s*:\s*(-?[\d.]+)\s*:\s*([\d.]+)\s*")
_MAX_VARIANTS = 500


@dataclass(frozen=True)
class Sweep:
    """A parameter and the values to try, as parsed from YAML.

    The key is that of the filter's section; nested keys are separated by dots. The name of a method may come first, if
    other methods have the key, too: ``ror.min_neighbors``.
    """

    key: str
    values: tuple[Any, ...]

    @property
    def method(self) -> str | None:
        """The method that the key names; None if it names none.

        Examples
        --------
        >>> Sweep("ror.min_neighbors", (3, 4)).method, Sweep("ror.min_neighbors", (3, 4)).own_key
        ('ror', 'min_neighbors')
        """
        first, dot, _ = self.key.partition(".")
        return first if dot and first in FILTERS else None

    @property
    def own_key(self) -> str:
        """The key without the name of a method."""
        return self.key.partition(".")[2] if self.method else self.key

    def applies_to(self, base: Base) -> bool:
        """Return whether a method has the parameter and is one that the key may name."""
        named = self.method in (None, base.method or base.name)
        return named and self.own_key.partition(".")[0] in base.keys


@dataclass(frozen=True)
class Combination:
    """A method with one value for each of its swept parameters, by the key of the sweep."""

    variant: Variant
    method: str
    values: Mapping[str, Any]


def shown(value: Any) -> str:
    """Return a value as YAML on one line."""
    return str(yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)).splitlines()[0]


def parse_sweep(text: str) -> Sweep:
    """Return the sweep that ``KEY=V1,V2,…`` or ``KEY=START:STOP:STEP`` describes; raise `UsageError` for other texts.

    Examples
    --------
    >>> parse_sweep("update_weight=0.2:0.8:0.2").values
    (0.2, 0.4, 0.6, 0.8)
    >>> parse_sweep("filter.near=drop,keep").values
    ('drop', 'keep')
    >>> parse_sweep("initial_thresholds=[30, 16],[20, 9]").values
    ([30, 16], [20, 9])
    >>> parse_sweep("presets.open.min_neighbors=2:4:1")
    Sweep(key='presets.open.min_neighbors', values=(2, 3, 4))
    """
    name, equals, given = text.partition("=")
    key = name.strip().removeprefix("filter.")
    if not equals or not all(key.split(".")) or key.startswith(("evaluation.", "sensor.")):
        raise UsageError(f"--sweep {text}: write it as KEY=V1,V2,... or KEY=START:STOP:STEP, with a key of the filter")
    try:
        values = _steps(given) if _RANGE.fullmatch(given) else load_yaml(f"[{given}]")
    except ValueError as error:
        reason = error if isinstance(error, DocumentError) else "not a valid range"
        raise UsageError(f"--sweep {text}: {reason}") from error
    if not isinstance(values, list) or len(values) > _MAX_VARIANTS:
        raise UsageError(f"--sweep {text}: must be a list of at most {_MAX_VARIANTS} values")
    unique = [value for number, value in enumerate(values) if value not in values[:number]]
    if not unique:
        raise UsageError(f"--sweep {text}: no values given")
    return Sweep(key, tuple(unique))


def _steps(given: str) -> list[float]:
    found = _RANGE.fullmatch(given)
    start, stop, step = (float(number) for number in found.groups()) if found else (0.0, 0.0, 0.0)
    if step <= 0 or stop < start or (stop - start) / step > _MAX_VARIANTS:
        raise ValueError(given)
    count = math.floor((stop - start) / step + 1e-9) + 1
    values = [round(start + number * step, 10) for number in range(count)]
    whole = "." not in given
    return [int(value) for value in values] if whole else values


def grid(sweeps: Sequence[Sweep], options: MethodOptions) -> list[Combination]:
    """Return all combinations of methods and values, the last parameter changing fastest.

    A parameter is swept for every method that has it. Raise `UsageError` if no method has a key, or there are too many
    combinations, or only one; `ConfigError` if a value is not allowed.
    """
    bases = bases_of(options)
    plain = {base.name: base.variant() for base in bases}  # names and configurations are valid
    _check_keys(sweeps, bases)
    several = len(bases) > 1
    own = {base.name: [sweep for sweep in sweeps if sweep.applies_to(base)] for base in bases}
    if (count := sum(math.prod(len(one.values) for one in own[base.name]) for base in bases)) > _MAX_VARIANTS:
        raise UsageError(f"--sweep: {count} combinations; at most {_MAX_VARIANTS} are allowed")
    if not sweeps and not several:
        raise UsageError("nothing to compare: give --sweep KEY=VALUES, or several methods by --method or --compare")
    combinations = []
    for base in bases:
        if not own[base.name]:
            combinations.append(Combination(plain[base.name], base.name, {}))
            continue
        for values in itertools.product(*(sweep.values for sweep in own[base.name])):
            settings = [f"{one.own_key}={shown(value)}" for one, value in zip(own[base.name], values, strict=True)]
            name = " ".join((base.name, *settings) if several else settings)
            variant = base.variant(*(f"filter.{setting}" for setting in settings), name=name)
            section = variant.config.as_dict()["filter"]
            used = {one.key: reduce(getitem, one.own_key.split("."), section) for one in own[base.name]}
            combinations.append(Combination(variant, base.name, used))
    return combinations


def _check_keys(sweeps: Sequence[Sweep], bases: Sequence[Base]) -> None:
    """Raise `UsageError` for a key that no method has, or that is given twice."""
    for sweep in sweeps:
        if not any(sweep.applies_to(base) for base in bases):
            known = "; ".join(f"method {base.name} has: {', '.join(base.keys)}" for base in bases)
            raise UsageError(f"--sweep {sweep.key}: unknown key; {known}")
    for base in bases:
        keys = [sweep.own_key for sweep in sweeps if sweep.applies_to(base)]
        if len(set(keys)) < len(keys):
            raise UsageError("--sweep: the same key is given twice")
