"""Settings of the tile classification: defaults < file < command line, checked as a whole."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from seaclutter_cli.airborne.features import FeatureParams
from seaclutter_cli.airborne.forest import ForestParams
from seaclutter_cli.airborne.objects import ObjectFindingParams
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.validation import build_sections, parse_yaml, plain, raise_problems, read_yaml


@dataclass(frozen=True)
class TileSettings:
    """Settings of the tile classification.

    Parameters
    ----------
    separation : SeparationParams
        Separation into sea and non-sea points.
    features : FeatureParams
        Features of the non-sea points.
    forest : ForestParams
        Random forest and its training.
    objects : ObjectFindingParams
        Search for objects.
    """

    separation: SeparationParams = field(default_factory=SeparationParams)
    features: FeatureParams = field(default_factory=FeatureParams)
    forest: ForestParams = field(default_factory=ForestParams)
    objects: ObjectFindingParams = field(default_factory=ObjectFindingParams)

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return the settings as sections of a settings file."""
        return {section.name: plain(getattr(self, section.name)) for section in fields(self)}


def _kinds() -> dict[str, type[Any]]:
    return {section.name: type(getattr(TileSettings(), section.name)) for section in fields(TileSettings)}


def parse_settings(raw: Mapping[str, Any], where: str) -> TileSettings:
    """Return the settings from a mapping; ``where`` names its source in errors."""
    kinds = _kinds()
    problems = [f"{key}: unknown section; allowed: {', '.join(kinds)}" for key in raw if key not in kinds]
    parts = build_sections(kinds, raw, problems)
    raise_problems(where, problems)
    return TileSettings(**parts)


def load_settings(path: Path | None, overrides: Sequence[str] = (), base: TileSettings | None = None) -> TileSettings:
    """Return the effective settings.

    Parameters
    ----------
    path : Path or None
        YAML file.
    overrides : sequence of str
        ``section.key=value`` from the command line; values are YAML.
    base : TileSettings, optional
        Settings that replace the defaults.

    Raises
    ------
    ConfigError
        If anything is invalid; the message lists all problems.
    """
    raw: dict[str, Any] = base.as_dict() if base else {}
    if path:
        given = read_yaml(path, list(_kinds()))
        parse_settings(given, str(path))
        raw = {section: {**(raw.get(section) or {}), **(given.get(section) or {})} for section in {**raw, **given}}
    for text in overrides:
        section, key, value = _parse_override(text)
        raw[section] = {**(raw.get(section) or {}), key: value}
    return parse_settings(raw, "command line" if overrides or not path else str(path))


def _parse_override(text: str) -> tuple[str, str, Any]:
    name, equals, value = text.partition("=")
    section, dot, key = name.strip().partition(".")
    if not (equals and dot and section in _kinds()):
        raise ConfigError(f"--set {text}: write it as SECTION.KEY=VALUE; sections are {', '.join(_kinds())}")
    return section, key, parse_yaml(value, f"--set {text}")
