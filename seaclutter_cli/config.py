"""Configuration: defaults < file < command line, checked as a whole, unknown keys refused.

A method's keys are the fields of its ``Params`` dataclass: their types, limits and defaults are declared there and
nowhere else, and the comments in written configs are its docstring.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.filters.adaptive_radius import PresetParams
from seaclutter_cli.filters.ring_params import RingIntensityParams
from seaclutter_cli.filters.zones import ZoneParams, ring_edges
from seaclutter_cli.interfaces import Filter
from seaclutter_cli.validation import build, find_file, kind_of, merged, parse_yaml, plain, raise_problems, read_yaml

DEFAULT_METHOD = "joint"
_SECTIONS = ("filter", "evaluation", "sensor")


@dataclass(frozen=True, kw_only=True)
class SensorParams:
    """The sensor that the thresholds are for, as far as its packets tell; `calibrate` notes it.

    Parameters
    ----------
    model : str or None
        Name of the sensor.
    intensity : str or None
        Mode in which it gives intensities; thresholds do not carry over from one to another.
    """

    model: str | None = None
    intensity: str | None = None


@dataclass(frozen=True)
class Config:
    """The effective configuration.

    Parameters
    ----------
    method : str
        Key of `FILTERS`.
    filter : object
        The method's ``Params``.
    evaluation : EvaluationParams
        Clustering and matching.
    sensor : SensorParams
        What the thresholds are for; unknown by default.

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
        """Return a filter of the method, without state."""
        make: Any = FILTERS[self.method]
        method: Filter = make(self.filter)
        return method

    @property
    def ring_edges(self) -> list[float]:
        """Edges of the method's rings in metres; empty for methods without."""
        return [float(edge) for edge in self.filter.edges] if isinstance(self.filter, ZoneParams) else []

    @property
    def has_scenes(self) -> bool:
        """Whether the method's parameters go by the scene."""
        return isinstance(self.filter, PresetParams)

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return the configuration as it stands in a file."""
        sections = {"filter": {"method": self.method, **plain(self.filter)}, "evaluation": plain(self.evaluation)}
        return sections if self.sensor == SensorParams() else {**sections, "sensor": plain(self.sensor)}

    def to_yaml(self, *, comments: bool = False) -> str:
        """Return the configuration as a file's text, with a comment for every key if asked for."""
        lines: list[str] = []
        for section, values in self.as_dict().items():
            said = {"method": f"one of {', '.join(FILTERS)}", **_descriptions(getattr(self, section))}
            lines.append(f"{section}:")
            for key, value in values.items():
                section_of_its_own = isinstance(value, dict)
                line = f"  {key}:" if section_of_its_own else f"  {key}: {_yaml_value(value)}"
                lines.append(f"{line:<40} # {said[key]}" if comments and key in said else line)
                entries = value.items() if section_of_its_own else ()
                lines += [f"    {_yaml_value(name)}: {_yaml_value(entry)}" for name, entry in entries]
        return "\n".join(lines) + "\n"


ConfigSource = Path | Mapping[str, Any] | Config
"""A configuration file or the name of a built-in one, its content, or a configuration."""


def load_config(
    source: ConfigSource | None = None,
    *,
    method: str | None = None,
    overrides: Sequence[str] = (),
    open_thresholds: bool = False,
) -> Config:
    """Return the effective configuration.

    Parameters
    ----------
    source : Path, mapping or Config, optional
        YAML file, or the name of a built-in one; its content; or a configuration. None: defaults.
    method : str or None
        Method from the command line. Of the file's keys, it takes those that it has too.
    overrides : sequence of str
        ``section.key=value`` from the command line; values are YAML.
    open_thresholds : bool, optional
        Ring thresholds are still to be found: they are 0, as many as there are rings, whatever else is said.

    Raises
    ------
    ConfigError
        If anything is wrong, with everything that is.
    """
    prepare = _with_open_thresholds if open_thresholds else dict
    where, raw = _read(source)
    config = _validate(prepare(raw), where)
    if not method and not overrides:
        return config
    sections: dict[str, dict[str, Any]] = {name: dict(raw.get(name) or {}) for name in _SECTIONS}
    if method and method != config.method:
        _check_method(method, "command line")
        kept = {field.name for field in fields(FILTERS[method].Params)}
        shared = {key: value for key, value in sections["filter"].items() if key in kept}
        sections["filter"] = {**shared, "method": method}
    for override in overrides:
        sections = merged(sections, _parse_override(override))
    return _validate(prepare(sections), "command line")


def _read(source: ConfigSource | None) -> tuple[str, Mapping[str, Any]]:
    """Return where settings come from, for messages, and the settings as they stand in a file."""
    if source is None:
        return "command line", {}
    if isinstance(source, Path):
        return str(source), read_yaml(find_file(str(source), "", "file"), _SECTIONS)
    return "configuration", source.as_dict() if isinstance(source, Config) else source


def parse_config(text: str, where: str) -> Config:
    """Return a configuration from the text of a file, as `Config.to_yaml` writes it; ``where`` is for messages."""
    return _validate(parse_yaml(text, where, _SECTIONS), where)


def _with_open_thresholds(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with a threshold of 0 for each ring, where the method has such and there is nothing wrong."""
    section = raw.get("filter") or {}
    kind = FILTERS.get(str(section.get("method", DEFAULT_METHOD))) if isinstance(section, dict) else None
    if kind is None or not issubclass(kind.Params, RingIntensityParams):
        return dict(raw)
    limits = [section.get(key, getattr(kind.Params, key)) for key in ("start_m", "end_m", "ring_width_m")]
    try:
        rings = len(ring_edges(*limits)) - 1
    except (ArithmeticError, TypeError, ValueError):
        return dict(raw)
    return {**raw, "filter": {**section, "initial_thresholds": [0] * rings}}


def _parse_override(text: str) -> dict[str, Any]:
    """Return what ``section.key=value`` sets, as it would stand in a file; keys of keys go on with a dot."""
    name, equals, value = text.partition("=")
    section, *keys = name.strip().split(".")
    if not (equals and all(keys) and keys and section in _SECTIONS):
        raise ConfigError(f"--set {text}: write it as filter.KEY=VALUE or evaluation.KEY=VALUE")
    try:
        settings = yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise ConfigError(f"--set {text}: the value is no YAML") from error
    for key in reversed((section, *keys)):
        settings = {key: settings}
    return dict(settings)


def _validate(raw: Mapping[str, Any], where: str) -> Config:
    problems = [f"{key}: unknown section; allowed: {', '.join(_SECTIONS)}" for key in raw if key not in _SECTIONS]
    sections: dict[str, dict[str, Any]] = {}
    for name in _SECTIONS:
        value = raw.get(name)
        sections[name] = dict(value) if isinstance(value, dict) else {}
        if value is not None and not isinstance(value, dict):
            problems.append(f"{name}: must be a section with keys, is {kind_of(value)}")
    method = sections["filter"].pop("method", DEFAULT_METHOD)
    if not isinstance(method, str) or method not in FILTERS:
        problems.append(f"filter.method: unknown method {method!r}; allowed: {', '.join(FILTERS)}")
        params = None
    else:
        params = build(FILTERS[method].Params, sections["filter"], "filter", f"method {method}", problems)
    evaluation = build(EvaluationParams, sections["evaluation"], "evaluation", "evaluation", problems)
    sensor = build(SensorParams, sections["sensor"], "sensor", "sensor", problems)
    raise_problems(where, problems)
    return Config(method, params, evaluation, sensor)


def _check_method(method: str, where: str) -> None:
    if method not in FILTERS:
        raise ConfigError(f"{where}: unknown method {method!r}; allowed: {', '.join(FILTERS)}")


def _yaml_value(value: Any) -> str:
    return str(yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)).splitlines()[0]


def _descriptions(params: Any) -> dict[str, str]:
    """Return what the docstrings of a parameter class and its bases say of each key."""
    said: dict[str, str] = {}
    for base in reversed(type(params).__mro__):
        said |= _documented(base.__doc__ or "")
    return said


def _documented(docstring: str) -> Iterable[tuple[str, str]]:
    found = re.findall(r"^    (\w[\w, ]*) : .*\n((?:        .*\n)+)", docstring, re.MULTILINE)
    for names, text in found:
        plain = re.sub(r":math:`([^`]*)`|``([^`]*)``", r"\1\2", " ".join(text.split()))
        for name in names.split(", "):
            yield name, plain
