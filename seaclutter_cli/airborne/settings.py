"""Settings of the tile classification: defaults < file < command line, checked as a whole."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from seaclutter_cli.airborne.features import FeatureParams
from seaclutter_cli.airborne.forest import ForestParams
from seaclutter_cli.airborne.objects import ObjectFindingParams
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.validation import build_sections, merged, parse_override, plain, raise_problems, read_yaml


@dataclass(frozen=True)
class TileSettings:
    """Settings of the tile classification."""

    separation: SeparationParams = field(default_factory=SeparationParams)
    features: FeatureParams = field(default_factory=FeatureParams)
    forest: ForestParams = field(default_factory=ForestParams)
    objects: ObjectFindingParams = field(default_factory=ObjectFindingParams)

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return the settings as sections of a settings file."""
        return dict(plain(self))


_KINDS: Mapping[str, Any] = {section.name: section.default_factory for section in fields(TileSettings)}


def parse_settings(raw: Mapping[str, Any], where: str) -> TileSettings:
    """Return the settings from a mapping; ``where`` names its source in errors."""
    problems = [f"{key}: unknown section; allowed: {', '.join(_KINDS)}" for key in raw if key not in _KINDS]
    parts = build_sections(_KINDS, raw, problems)
    raise_problems(where, problems)
    return TileSettings(**parts)


def load_settings(path: Path | None, overrides: Sequence[str] = (), base: TileSettings | None = None) -> TileSettings:
    """Return the effective settings: those of a file, and ``section.key=value`` of the command line, over a base.

    By default, the base are the defaults. Raise `ConfigError` if anything is invalid; the message lists all problems.
    """
    raw: dict[str, Any] = base.as_dict() if base else {}
    if path:
        given = read_yaml(path, list(_KINDS))
        parse_settings(given, str(path))
        raw = {section: {**(raw.get(section) or {}), **(given.get(section) or {})} for section in {**raw, **given}}
    for text in overrides:
        raw = merged(raw, parse_override(text, _KINDS, f"SECTION.KEY=VALUE; sections are {', '.join(_KINDS)}"))
    return parse_settings(raw, "command line" if overrides or not path else str(path))
