"""Configuration from defaults, file and command line, in ascending precedence, validated as a whole.

The keys of a method are the fields of its ``Params`` dataclass. Their types, limits and defaults are declared only
there, and so are their meanings, the comments of written configurations. Unknown keys are errors.
"""

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.arrays import Floats
from seaclutter_cli.buckets import fetch, on_paths, shown
from seaclutter_cli.errors import AdaptedThresholdsWarning, ConfigError
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.filters import FILTERS, OPTIONAL
from seaclutter_cli.filters.joint import RingIntensityParams
from seaclutter_cli.filters.zones import AUTO_M, ZoneParams, ring_edges
from seaclutter_cli.given import Method, naming_method
from seaclutter_cli.interfaces import Filter
from seaclutter_cli.params import key
from seaclutter_cli.text import count, printable, shortened, suggestion
from seaclutter_cli.validation import (
    build,
    descriptions,
    find_file,
    merged,
    parse_override,
    parse_yaml,
    plain,
    raise_problems,
    read_yaml,
    sections_of,
    yaml_value,
)

DEFAULT_METHOD = "joint"
_RING_KEYS = {"filter.start_m", "filter.end_m", "filter.ring_width_m"}
_SECTIONS = ("filter", "evaluation", "sensor")
_BARE_KEY = re.compile(r"\s*\w+\s*=")
_MAX_BYTES = 64 * 2**20


@dataclass(frozen=True, kw_only=True)
class SensorParams:
    """The sensor that the thresholds are for, recorded by `calibrate` if the packets identify it."""

    model: str | None = key(None, "Name of the sensor.")
    intensity: str | None = key(None, "Intensity mode of the sensor; thresholds are valid for one mode only.")


DEFAULT_SENSOR = SensorParams(model="RS-LiDAR-32", intensity="calibrated by the sensor (mode 3)")
"""Sensor of the default thresholds. [Li2023] does not state the mode; it is that of the sensor's current firmware."""


@dataclass(frozen=True)
class Config:
    """The effective configuration.

    Parameters
    ----------
    method : str
        Name of the method, a key of `FILTERS` or a `Method`.
    filter : object
        Parameters of the method, an instance of its ``Params``.
    evaluation : EvaluationParams
        Parameters of clustering and matching.
    sensor : SensorParams
        Sensor that the thresholds are for; unknown by default.

    Examples
    --------
    >>> import seaclutter
    >>> config = seaclutter.calibrate("samples/sea.mcap", labels="samples/sea.labels.csv", keep_end=True).config
    >>> config.method, config.filter.start_m, config.filter.end_m, config.ring_edges
    ('joint', 10.0, 70.0, [10.0, 25.0, 40.0, 55.0, 70.0])
    >>> print(config.to_yaml().splitlines()[0])
    filter:
    """

    method: str
    filter: Any
    evaluation: EvaluationParams
    sensor: SensorParams = field(default_factory=SensorParams)

    def make_filter(self) -> Filter:
        """Return a new filter of the method."""
        with naming_method(self.kind, "its parameters"):
            method: Filter = self.kind(self.filter)
        return method

    @property
    def ring_edges(self) -> list[float]:
        """Edges of the range rings in metres; empty for methods without range rings."""
        return [float(edge) for edge in self.filter.edges] if isinstance(self.filter, ZoneParams) else []

    @property
    def threshold_sensor(self) -> SensorParams | None:
        """Sensor that the thresholds are for, as far as known; None if the method compares no point with them."""
        params = self.filter
        if not isinstance(params, RingIntensityParams) or not getattr(params, "use_intensity", True):
            return None
        return DEFAULT_SENSOR if self.sensor == SensorParams() and _are_default(params) else self.sensor

    @property
    def kind(self) -> Any:
        """Class of the method."""
        return FILTERS[self.method]

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return the configuration as the sections of a file."""
        sections = {"filter": {"method": str(self.method), **plain(self.filter)}, "evaluation": plain(self.evaluation)}
        return sections if self.sensor == SensorParams() else {**sections, "sensor": plain(self.sensor)}

    def to_yaml(self, *, comments: bool = False) -> str:
        """Return the configuration as YAML, optionally with a comment for every key."""
        lines: list[str] = []
        for section, values in self.as_dict().items():
            described = {"method": f"one of {', '.join(FILTERS)}" if comments else ""}
            described |= descriptions(type(getattr(self, section)))
            lines.append(f"{section}:")
            for name, value in values.items():
                nested = isinstance(value, dict)
                line = f"  {name}:" if nested else f"  {name}: {yaml_value(value)}"
                lines.append(f"{line:<40} # {described[name]}" if comments and name in described else line)
                entries = value.items() if nested else ()
                lines += [f"    {yaml_value(one)}: {yaml_value(entry)}" for one, entry in entries]
        return "\n".join(lines) + "\n"


def _are_default(params: RingIntensityParams) -> bool:
    return params.initial_thresholds == type(params).initial_thresholds


ConfigSource = Path | Mapping[str, Any] | Config
"""A configuration file or the name of a built-in one, the content of a file, or a configuration."""


class UnnamedFile(type(Path())):  # type: ignore[misc]  # the class of paths of this system
    """Configuration in the working folder, which no option names; filtered logs are still shown with their own."""


def is_named(source: "ConfigSource | None") -> bool:
    """Return whether an option names a configuration."""
    return source is not None and not isinstance(source, UnnamedFile)


@on_paths
def load_config(
    source: ConfigSource | None = None,
    *,
    method: str | None = None,
    default_method: str = DEFAULT_METHOD,
    overrides: Sequence[str] = (),
    origin: str = "command line",
    undetermined_thresholds: bool = False,
) -> Config:
    """Return the effective configuration; raise `ConfigError` with all problems if it is not valid.

    The ``source`` is a YAML file or the name of a built-in one, the content of a file, or a configuration; by default
    all defaults. Keys that a ``method`` of the command line does not have are ignored; ``default_method`` is that of a
    source that names none. ``overrides`` are ``section.key=value`` with YAML values, or ``key=value`` for keys of the
    method; if they change the number of range rings and not the thresholds, each range ring gets that of the nearest
    one before, and `AdaptedThresholdsWarning` says so. ``origin`` is where these come from, for errors. With
    ``undetermined_thresholds``, that of every range ring is 0, because it is not yet known.
    """
    prepare = _with_open_thresholds if undetermined_thresholds else dict
    where, raw = _read(source)
    section = raw.get("filter")
    section = {} if section is None else section
    if isinstance(section, Mapping):
        named = section.get("method", default_method)
        if isinstance(method, Method) and named == method:
            named = method  # a file names it, and the command line says where it is
        raw = {**raw, "filter": {**section, "method": named}}
    config = _validate(prepare(raw), where)
    if not method and not overrides:
        return config
    sections: dict[str, dict[str, Any]] = {name: dict(raw.get(name) or {}) for name in _SECTIONS}
    if method and method != config.method:
        if isinstance(method, Method) and str(method) in FILTERS:
            raise ConfigError(f"{origin}: a method is called {method} already; choose another name")
        if method not in FILTERS:
            raise ConfigError(f"{origin}: unknown method {method!r}; {_methods(method)}")
        kept = {field.name for field in fields(FILTERS[method].Params)}
        shared = {key: value for key, value in sections["filter"].items() if key in kept}
        sections["filter"] = {**shared, "method": method}
    overrides = [f"filter.{one.lstrip()}" if _BARE_KEY.match(one) else one for one in overrides]
    for override in overrides:
        sections = merged(sections, parse_override(override, _SECTIONS, "filter.KEY=VALUE or evaluation.KEY=VALUE"))
    if not undetermined_thresholds:
        sections = _with_adapted_thresholds(sections, config.filter, overrides)
    return _validate(prepare(sections), origin)


def _read(source: ConfigSource | None) -> tuple[str, Mapping[str, Any]]:
    """Return the origin of the settings, for messages, and the settings as the sections of a file."""
    if source is None:
        return "command line", {}
    if isinstance(source, Path):
        fetch(source, at_most=_MAX_BYTES)
        return shown(str(source)), read_yaml(find_file(str(source), "", "file"), _SECTIONS)
    if isinstance(source, Config):
        sections = source.as_dict()
        return "configuration", {**sections, "filter": {**sections["filter"], "method": source.method}}
    if not isinstance(source, Mapping):
        raise ConfigError(f"configuration: must be a file, a mapping or a Config, got {source!r}")
    return "configuration", source


def parse_sections(text: str, where: str) -> Any:
    """Return the settings in the text of a configuration file, not yet validated; ``where`` names it in messages."""
    return parse_yaml(text, where, _SECTIONS)


def parse_config(text: str, where: str) -> Config:
    """Return the configuration in a text written by `Config.to_yaml`; ``where`` names it in messages.

    A method that is not installed here has no parameters and does nothing.
    """
    raw = parse_sections(text, where)
    section = raw.get("filter")
    name = section.get("method") if isinstance(section, dict) else None
    if not isinstance(name, str) or name in FILTERS:
        return _validate(raw, where)
    unknown = Method(shortened(printable(name), 60), FILTERS["none"], (str, (name,)), "")
    return _validate({**raw, "filter": {"method": unknown}}, where)


def _with_open_thresholds(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with a threshold of 0 for each range ring; unchanged if not valid or without range rings."""
    section = raw.get("filter") or {}
    edges = _edges_of(section) if isinstance(section, dict) else None
    if edges is None:
        return dict(raw)
    return {**raw, "filter": {**section, "initial_thresholds": [0] * (len(edges) - 1)}}


def _edges_of(section: Mapping[str, Any]) -> Floats | None:
    """Return the edges of the range rings that a section gives; None if it is not valid, or without range rings."""
    method = section.get("method", DEFAULT_METHOD)
    kind = FILTERS.get(method) if isinstance(method, str) else None
    if kind is None or not issubclass(kind.Params, RingIntensityParams):
        return None
    limits = {key: section.get(key, getattr(kind.Params, key)) for key in ("start_m", "end_m", "ring_width_m")}
    try:
        return ring_edges(*({**limits, "start_m": AUTO_M} if limits["start_m"] == "auto" else limits).values())
    except (ArithmeticError, TypeError, ValueError):
        return None


def _with_adapted_thresholds(
    sections: dict[str, dict[str, Any]], given: Any, overrides: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Return settings with a threshold for each range ring, if the command line changes only the range rings."""
    keys = {override.partition("=")[0].strip() for override in overrides}
    if not keys & _RING_KEYS or "filter.initial_thresholds" in keys or not isinstance(given, RingIntensityParams):
        return sections
    edges = _edges_of(sections["filter"])
    if edges is None or len(edges) == len(given.edges):
        return sections
    middles = (edges[:-1] + edges[1:]) / 2
    nearest = np.searchsorted(given.edges[1:-1], middles, side="right")
    thresholds = [given.initial_thresholds[ring] for ring in nearest]
    changed = f"{count(len(thresholds), 'range ring')} from {edges[0]:g} to {edges[-1]:g} m"
    warnings.warn(
        AdaptedThresholdsWarning(
            f"filter.initial_thresholds: {changed} instead of {len(given.initial_thresholds)}; each has the threshold "
            f"of the nearest one before: {yaml_value(thresholds)}"
        ),
        stacklevel=4,
    )
    sensor = sections["sensor"] or (plain(DEFAULT_SENSOR) if _are_default(given) else {})
    return {**sections, "filter": {**sections["filter"], "initial_thresholds": thresholds}, "sensor": sensor}


def _validate(raw: Mapping[str, Any], where: str) -> Config:
    problems = [f"{key}: unknown section; allowed: {', '.join(_SECTIONS)}" for key in raw if key not in _SECTIONS]
    sections = sections_of(raw, _SECTIONS, problems)
    method = sections["filter"].pop("method", DEFAULT_METHOD)
    if not isinstance(method, str) or method not in FILTERS:
        problems.append(f"filter.method: unknown method {method!r}; {_methods(method)}")
        params = None
    else:
        section = _without_keys_of_others(method, sections["filter"], problems)
        params = build(FILTERS[method].Params, section, "filter", f"method {method}", problems)
    evaluation = build(EvaluationParams, sections["evaluation"], "evaluation", "evaluation", problems)
    sensor = build(SensorParams, sections["sensor"], "sensor", "sensor", problems)
    raise_problems(where, problems)
    return Config(method, params, evaluation, sensor)


def _without_keys_of_others(method: str, section: Mapping[str, Any], problems: list[str]) -> dict[str, Any]:
    """Return the settings without keys that only another method has; a line is appended to ``problems`` for them."""
    own = {one.name for one in fields(FILTERS[method].Params)}
    unknown = [key for key in section if key not in own]
    for other in unknown and [DEFAULT_METHOD, *FILTERS]:
        if other in OPTIONAL:
            continue
        foreign = {one.name for one in fields(FILTERS[other].Params)}.intersection(unknown)
        if len(foreign) > 1:
            names = ", ".join(key for key in unknown if key in foreign)
            problems.append(
                f"filter: {names}: keys of {other}, not of {method}; remove them, or write "
                f"method: {other} and use -m {method}"
            )
            return {key: value for key, value in section.items() if key not in foreign}
    return dict(section)


def _methods(method: object) -> str:
    file = "a file of your own is named by -m FILE.py:CLASS only; " if ".py:" in str(method) else ""
    return f"{file}{suggestion(str(method), FILTERS)}allowed: {', '.join(FILTERS)}"
