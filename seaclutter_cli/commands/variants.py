"""The methods that one evaluation compares: each a method with its configuration, under a name of its own."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from seaclutter_cli.config import Config, load_config
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters import FILTERS

_GLOBAL_INTENSITY_AT = {
    f"global_intensity@{rate}": ("filter.threshold=null", f"filter.filter_rate={rate}") for rate in ("0.80", "0.90")
}
_PAPER = (*_GLOBAL_INTENSITY_AT, "ring_intensity", "ring_intensity_outlier", "joint")
_PEERS = ("joint", "sor", "ror", "dror", "adaptive_radius", "dsor", "lior", "lidsor", "naive")

COMPARISONS: Mapping[str, Sequence[str]] = {
    "paper": _PAPER,
    "peers": _PEERS,
    "all": tuple(dict.fromkeys((*_PAPER, *_PEERS, "none"))),
}
"""Variants to compare: those of S0's Tables 4 and 5; the joint method and its peers; all of them and no filter."""


@dataclass(frozen=True)
class Variant:
    """A method as it is configured.

    Parameters
    ----------
    name : str
        What it is called in tables: the method, with what tells it from others of the same method behind an ``@``.
    config : Config
        Its configuration.
    """

    name: str
    config: Config


def choose_variants(names: Iterable[str], config_file: Path | None, overrides: Sequence[str]) -> list[Variant]:
    """Return the variants of these names, each once; without any, the method of the configuration.

    Keys that a method lacks do not reach it, as long as another one has them.

    Raises
    ------
    ConfigError
        If a name is unknown or anything is wrong with the configuration.
    """
    chosen = list(dict.fromkeys(names))
    if not chosen:
        config = load_config(config_file, overrides=overrides)
        return [Variant(config.method, config)]
    keys = {name: _keys(name) for name in chosen}
    return [_variant(name, config_file, _fitting(overrides, name, keys)) for name in chosen]


def _variant(name: str, config_file: Path | None, overrides: Sequence[str]) -> Variant:
    method = _method(name)
    config = load_config(config_file, method=method, overrides=(*overrides, *_GLOBAL_INTENSITY_AT.get(name, ())))
    if config.method != method:
        raise ConfigError(f"--set filter.method={config.method}: where methods are compared, name them with --method")
    return Variant(name, config)


def _method(name: str) -> str:
    return name.partition("@")[0] if name in _GLOBAL_INTENSITY_AT else name


def _keys(name: str) -> set[str]:
    method = _method(name)
    return {f"filter.{field.name}" for field in fields(FILTERS[method].Params)} if method in FILTERS else set()


def _fitting(overrides: Sequence[str], name: str, keys: Mapping[str, set[str]]) -> list[str]:
    """Return the overrides without those that are for other methods only."""
    others = set().union(*keys.values()) - keys[name]
    return [override for override in overrides if _key(override) not in others]


def _key(override: str) -> str:
    """Return the key that an override sets, or sets a part of."""
    return ".".join(override.partition("=")[0].strip().split(".")[:2])
