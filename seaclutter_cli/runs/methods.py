"""The methods that one evaluation compares: each a method with its configuration, under a name of its own."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

from seaclutter_cli.config import Config, ConfigSource, load_config
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


@dataclass(frozen=True, kw_only=True)
class ConfigOptions:
    """What the configuration of a run is made of: defaults < file < single keys.

    Parameters
    ----------
    file : Path, mapping, Config or None
        Configuration file, or the name of a built-in one; its content; or a configuration.
    method : str or None
        Filter method; None: that of the file, else the default.
    overrides : tuple of str
        ``section.key=value``; values are YAML.
    """

    file: ConfigSource | None = None
    method: str | None = None
    overrides: tuple[str, ...] = ()

    def load(self, *further: str, open_thresholds: bool = False) -> Config:
        """Return the configuration, with further overrides; see `load_config`, also for its errors."""
        overrides = (*self.overrides, *further)
        return load_config(self.file, method=self.method, overrides=overrides, open_thresholds=open_thresholds)

    def as_methods(self) -> "MethodOptions":
        """Return the same choice of one method as a comparison of one."""
        return MethodOptions(file=self.file, methods=(self.method,) if self.method else (), overrides=self.overrides)


@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """Which methods a run compares, and what their configurations are made of.

    Parameters
    ----------
    file : Path, mapping, Config or None
        Configuration file, or the name of a built-in one; its content; or a configuration.
    methods : tuple of str
        Names of methods, ``none`` among them for the logs as they are; empty: that of the configuration.
    comparisons : tuple of str
        Keys of `COMPARISONS`.
    overrides : tuple of str
        ``section.key=value`` for every method that has the key; values are YAML.
    """

    file: ConfigSource | None = None
    methods: tuple[str, ...] = ()
    comparisons: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()

    @property
    def is_default(self) -> bool:
        """Whether nothing was chosen."""
        return self == MethodOptions()

    def variants(self, *further: str, configured_first: bool = False) -> list[Variant]:
        """Return the methods with their configurations, each once; without any, the method of the configuration.

        Parameters
        ----------
        *further : str
            Further overrides.
        configured_first : bool, optional
            Start with the configuration's own method if it is compared and none was named.

        Raises
        ------
        ConfigError
            If a name is unknown or anything is wrong with the configuration.
        """
        compared = [name for comparison in self.comparisons for name in COMPARISONS[comparison]]
        names = [*compared, *self.methods]
        if configured_first:
            own = [load_config(self.file).method] if compared and not self.methods else []
            names = [*self.methods, *(name for name in own if name in compared), *compared]
        return choose_variants(names, self.file, (*self.overrides, *further))


def choose_variants(names: Iterable[str], file: ConfigSource | None, overrides: Sequence[str]) -> list[Variant]:
    """Return the variants of these names, each once; without any, the method of the configuration.

    Keys that a method lacks do not reach it, as long as another one has them.

    Raises
    ------
    ConfigError
        If a name is unknown or anything is wrong with the configuration.
    """
    chosen = list(dict.fromkeys(names))
    if not chosen:
        config = load_config(file, overrides=overrides)
        return [Variant(config.method, config)]
    keys = {name: _keys(name) for name in chosen}
    return [_variant(name, file, _fitting(overrides, name, keys)) for name in chosen]


def _variant(name: str, file: ConfigSource | None, overrides: Sequence[str]) -> Variant:
    method = _method(name)
    config = load_config(file, method=method, overrides=(*overrides, *_GLOBAL_INTENSITY_AT.get(name, ())))
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
