"""Methods and values of parameters that are compared, each with its configuration and a unique name."""

import itertools
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import reduce
from importlib.util import find_spec
from operator import getitem
from typing import Any

from seaclutter_cli.config import Config, ConfigSource, is_named, load_config
from seaclutter_cli.documents import DocumentError, load_yaml
from seaclutter_cli.errors import ConfigError, UsageError
from seaclutter_cli.evaluation import IDEAL
from seaclutter_cli.filters import FILTERS, OPTIONAL
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options import ConfigOptions, MethodOptions
from seaclutter_cli.validation import yaml_value

_GLOBAL_INTENSITY_AT = {
    f"global_intensity@{rate}": ("filter.threshold=null", f"filter.filter_rate={rate}") for rate in ("0.80", "0.90")
}
_PAPER = (*_GLOBAL_INTENSITY_AT, "ring_intensity", "ring_intensity_outlier", "joint")
_RANGE = re.compile(r"\s*(-?[\d.]+)\s*:\s*(-?[\d.]+)\s*:\s*([\d.]+)\s*")
_MAX_VARIANTS = 500
_PEERS = ("joint", "confirmed", "sor", "ror", "dror", "adaptive_radius", "dsor", "lior", "lidsor", "naive", "patchwork")

COMPARISONS: Mapping[str, Sequence[str]] = {
    "paper": _PAPER,
    "peers": _PEERS,
    "all": tuple(dict.fromkeys((*_PAPER, *_PEERS, "none"))),
}
"""Groups of methods: Tables 4 and 5 in [Li2023]; ``joint``, ``confirmed`` and their peers; all of them and ``none``.

Methods of installed packages are peers, too.
"""


@dataclass(frozen=True)
class Variant:
    """A method with its configuration, and its name in tables, such as ``joint`` or ``update_weight=0.6``.

    Of several methods, ``method`` names those with other values of their swept parameters, by the key of the sweep.
    """

    name: str
    config: Config
    method: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)


def configured(options: ConfigOptions, **more: Any) -> Config:
    """Return the configuration of a run; see `load_config` for parameters and errors."""
    return load_config(options.config, method=options.method, overrides=options.settings, **more)


def is_default(options: MethodOptions) -> bool:
    """Return whether no option names a method or a configuration."""
    return not (options.methods or options.compare or options.settings or is_named(options.config))


def is_installed(method: str) -> bool:
    """Return whether the package that a method may need is installed."""
    return method not in OPTIONAL or find_spec(OPTIONAL[method]) is not None


def note_left_out(options: MethodOptions, observer: Observer) -> None:
    """Name the methods that a comparison leaves out, because they are not installed."""
    if left_out := [name for name in _compared(options) if not is_installed(name) and name not in options.methods]:
        names = ", ".join(dict.fromkeys(left_out))
        observer.note(f"not compared, because it is not installed: {names} (pip install 'seaclutter[peers]')")


def _compared(options: MethodOptions) -> list[str]:
    every = [name for comparison in options.compare for name in COMPARISONS[comparison]]
    peers = set(options.compare) & {"peers", "all"}
    return [*every, *FILTERS.added] if peers else every


def with_ideal(chosen: list[Variant]) -> list[Variant]:
    """Return variants with `IDEAL` after them if one leaves logs as they are, whose errors it explains."""
    unfiltered = [one for one in chosen if one.config.method == "none"]
    return [*chosen, replace(unfiltered[0], name=IDEAL)] if unfiltered else chosen


def bases(options: MethodOptions, *additional: str, configured_first: bool = False) -> list["Base"]:
    """Return each chosen method, for variants of it, without duplicates; by default the configured method.

    ``additional`` settings apply to all. If the configured method is compared, it can be ``configured_first``. A key
    that a method lacks is ignored for this method if another method has it. Raise `ConfigError` if a name is unknown or
    a configuration is not valid.
    """
    compared = [name for name in _compared(options) if is_installed(name)]
    names = [*compared, *options.methods]
    if configured_first:
        own = [load_config(options.config).method] if compared and not options.methods else []
        names = [*options.methods, *(name for name in own if name in compared), *compared]
    settings = (*options.settings, *additional)
    if not names:
        return [Base(load_config(options.config, overrides=settings).method, None, options.config, settings)]
    for name in names:
        if any(name == other and FILTERS.get(name) is not FILTERS.get(other) for other in names):
            raise ConfigError(f"several methods are called {name}; choose other names")
    found = [Base(name, _method(name), options.config, settings) for name in dict.fromkeys(names)]
    every = {key for base in found for key in base.keys}
    return [base.fitting(every) for base in found]


@dataclass(frozen=True)
class Base:
    """A chosen method (None: that of the configuration), its name in tables, and the sources of its configuration."""

    name: str
    method: str | None
    file: ConfigSource | None
    overrides: tuple[str, ...]

    @property
    def keys(self) -> tuple[str, ...]:
        """Configuration keys of the method."""
        method = self.method or self.name
        return tuple(one.name for one in fields(FILTERS[method].Params)) if method in FILTERS else ()

    def fitting(self, every: Collection[str]) -> "Base":
        """Return the method without the overrides that only apply to others, given the keys of all methods."""
        others = {f"filter.{key}" for key in every} - {f"filter.{key}" for key in self.keys}
        return replace(self, overrides=tuple(one for one in self.overrides if _key(one) not in others))

    def variant(self, *settings: str, name: str | None = None) -> Variant:
        """Return the method with its configuration and additional overrides, under another name if one is given."""
        overrides = (*self.overrides, *settings, *_GLOBAL_INTENSITY_AT.get(self.name, ()))
        config = load_config(self.file, method=self.method, overrides=overrides)
        if self.method and config.method != self.method:
            raise ConfigError(f"--set filter.method={config.method}: to compare methods, name them with --method")
        return Variant(name or self.name, config, self.name)


def _method(name: str) -> str:
    return name.partition("@")[0] if name in _GLOBAL_INTENSITY_AT else name


def _key(override: str) -> str:
    """Return the section and key of an override, without nested keys."""
    return ".".join(override.partition("=")[0].strip().split(".")[:2])


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
        span = _RANGE.fullmatch(given)
        values = _steps(span) if span else load_yaml(f"[{given}]")
    except ValueError as error:
        reason = error if isinstance(error, DocumentError) else "not a valid range"
        raise UsageError(f"--sweep {text}: {reason}") from error
    if not isinstance(values, list) or len(values) > _MAX_VARIANTS:
        raise UsageError(f"--sweep {text}: must be a list of at most {_MAX_VARIANTS} values")
    unique = [value for number, value in enumerate(values) if value not in values[:number]]
    if not unique:
        raise UsageError(f"--sweep {text}: no values given")
    return Sweep(key, tuple(unique))


def _steps(span: re.Match[str]) -> list[float]:
    start, stop, step = map(float, span.groups())
    if step <= 0 or stop < start or (stop - start) / step > _MAX_VARIANTS:
        raise ValueError
    count = math.floor((stop - start) / step + 1e-9) + 1
    values = [round(start + number * step, 10) for number in range(count)]
    return values if "." in span[0] else [int(value) for value in values]


def grid(sweeps: Sequence[Sweep], options: MethodOptions) -> list[Variant]:
    """Return all combinations of methods and values, the last parameter changing fastest.

    A parameter is swept for every method that has it. Raise `UsageError` if no method has a key, or there are too many
    combinations, or only one; `ConfigError` if a value is not allowed.
    """
    chosen = bases(options)
    for base in chosen:
        base.variant()  # names and configurations are valid
    _check_keys(sweeps, chosen)
    several = len(chosen) > 1
    own = {base.name: [sweep for sweep in sweeps if sweep.applies_to(base)] for base in chosen}
    if (count := sum(math.prod(len(one.values) for one in own[base.name]) for base in chosen)) > _MAX_VARIANTS:
        raise UsageError(f"--sweep: {count} combinations; at most {_MAX_VARIANTS} are allowed")
    if not sweeps and not several:
        raise UsageError("nothing to compare: give --sweep KEY=VALUES, or several methods by --method or --compare")
    combinations = []
    for base in chosen:
        for values in itertools.product(*(sweep.values for sweep in own[base.name])):
            settings = [f"{one.own_key}={yaml_value(value)}" for one, value in zip(own[base.name], values, strict=True)]
            name = " ".join((base.name, *settings) if several or not settings else settings)
            variant = base.variant(*(f"filter.{setting}" for setting in settings), name=name)
            section = variant.config.as_dict()["filter"]
            used = {one.key: reduce(getitem, one.own_key.split("."), section) for one in own[base.name]}
            combinations.append(replace(variant, values=used))
    return combinations


def _check_keys(sweeps: Sequence[Sweep], bases: Sequence[Base]) -> None:
    for sweep in sweeps:
        if not any(sweep.applies_to(base) for base in bases):
            known = "; ".join(f"method {base.name} has: {', '.join(base.keys)}" for base in bases)
            raise UsageError(f"--sweep {sweep.key}: unknown key; {known}")
    for base in bases:
        keys = [sweep.own_key for sweep in sweeps if sweep.applies_to(base)]
        if len(set(keys)) < len(keys):
            raise UsageError("--sweep: the same key is given twice")
