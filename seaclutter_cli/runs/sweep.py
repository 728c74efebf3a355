"""Grids of parameter values from the command line."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import reduce
from typing import Any

import yaml

from seaclutter_cli.documents import DocumentError, load_yaml
from seaclutter_cli.errors import UsageError
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.runs.methods import ConfigOptions, Variant

_RANGE = re.compile(r"\s*(-?[\d.]+)\s*:\s*(-?[\d.]+)\s*:\s*([\d.]+)\s*")
_MAX_VARIANTS = 500


@dataclass(frozen=True)
class Sweep:
    """A parameter and the values to try.

    Parameters
    ----------
    key : str
        Configuration key of the filter, without its section; nested keys are separated by dots.
    values : tuple
        Values as parsed from YAML.
    """

    key: str
    values: tuple[Any, ...]

    @property
    def shown(self) -> list[str]:
        """Values as text."""
        return [shown(value) for value in self.values]

    def value_in(self, settings: Mapping[str, Any]) -> Any:
        """Return the parameter's value in a section of a configuration.

        Examples
        --------
        >>> Sweep("presets.open.min_neighbors", (3, 4)).value_in({"presets": {"open": {"min_neighbors": 4}}})
        4
        """
        return reduce(lambda values, key: values[key], self.key.split("."), settings)


def shown(value: Any) -> str:
    """Return a value as YAML on one line."""
    return str(yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)).splitlines()[0]


def parse_sweep(text: str) -> Sweep:
    """Return the sweep that ``KEY=V1,V2,…`` or ``KEY=START:STOP:STEP`` describes.

    Raises
    ------
    UsageError
        If the text has another form.

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


def grid(sweeps: Sequence[Sweep], options: ConfigOptions) -> list[Variant]:
    """Return a variant for each combination of values, the last parameter changing fastest.

    Raises
    ------
    UsageError
        If the method has no such key, or there are too many combinations.
    ConfigError
        If a value is not allowed.
    """
    base = options.load()
    known = [field.name for field in fields(FILTERS[base.method].Params)]
    keys = [sweep.key for sweep in sweeps]
    for key in keys:
        if key.partition(".")[0] not in known:
            raise UsageError(f"--sweep {key}: unknown key; method {base.method} has: {', '.join(known)}")
    if len(set(keys)) < len(keys):
        raise UsageError("--sweep: the same key is given twice")
    if (count := math.prod(len(sweep.values) for sweep in sweeps)) > _MAX_VARIANTS:
        raise UsageError(f"--sweep: {count} combinations; at most {_MAX_VARIANTS} are allowed")
    variants = []
    for values in itertools.product(*(sweep.values for sweep in sweeps)):
        settings = [f"{key}={shown(value)}" for key, value in zip(keys, values, strict=True)]
        config = options.load(*(f"filter.{setting}" for setting in settings))
        variants.append(Variant(" ".join(settings), config))
    return variants
