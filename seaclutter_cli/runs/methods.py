"""Methods that an evaluation compares, each with its configuration and a unique name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

from seaclutter_cli.config import Config, ConfigSource, UnnamedFile, load_config
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters import FILTERS

_GLOBAL_INTENSITY_AT = {
    f"global_intensity@{rate}": ("filter.threshold=null", f"filter.filter_rate={rate}") for rate in ("0.80", "0.90")
}
_PAPER = (*_GLOBAL_INTENSITY_AT, "ring_intensity", "ring_intensity_outlier", "joint")
_PEERS = ("joint", "confirmed", "sor", "ror", "dror", "adaptive_radius", "dsor", "lior", "lidsor", "naive")

COMPARISONS: Mapping[str, Sequence[str]] = {
    "paper": _PAPER,
    "peers": _PEERS,
    "all": tuple(dict.fromkeys((*_PAPER, *_PEERS, "none"))),
}
"""Groups of methods: Tables 4 and 5 in [Li2023]; ``joint``, ``confirmed`` and their peers; all of them and ``none``."""


@dataclass(frozen=True)
class Variant:
    """A method with its configuration.

    Parameters
    ----------
    name : str
        Name in tables, such as ``joint``, ``global_intensity@0.80`` or ``update_weight=0.6``.
    config : Config
        Configuration of the method.
    """

    name: str
    config: Config


@dataclass(frozen=True, kw_only=True)
class ConfigOptions:
    """Sources of the configuration of a run. Precedence: defaults < file < single keys.

    Parameters
    ----------
    file : Path, mapping, Config or None
        Configuration file or the name of a built-in one, the content of a file, or a configuration.
    method : str or None
        Filter method; None: that of the file, or the default.
    overrides : tuple of str
        Settings of the form ``section.key=value``; values are YAML.
    """

    file: ConfigSource | None = None
    method: str | None = None
    overrides: tuple[str, ...] = ()

    def load(self, *additional: str, undetermined_thresholds: bool = False) -> Config:
        """Return the configuration, with additional overrides; see `load_config` for parameters and errors."""
        overrides = (*self.overrides, *additional)
        return load_config(
            self.file, method=self.method, overrides=overrides, undetermined_thresholds=undetermined_thresholds
        )

    def as_methods(self) -> "MethodOptions":
        """Return the equivalent options for a comparison of one method."""
        return MethodOptions(file=self.file, methods=(self.method,) if self.method else (), overrides=self.overrides)


@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """Methods that a run compares, and the sources of their configurations.

    Parameters
    ----------
    file : Path, mapping, Config or None
        Configuration file or the name of a built-in one, the content of a file, or a configuration.
    methods : tuple of str
        Names of methods; ``none`` leaves the logs unfiltered. Empty: the method of the configuration.
    comparisons : tuple of str
        Keys of `COMPARISONS`.
    overrides : tuple of str
        Settings of the form ``section.key=value``, for every method that has the key; values are YAML.
    """

    file: ConfigSource | None = None
    methods: tuple[str, ...] = ()
    comparisons: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()

    @property
    def is_default(self) -> bool:
        """Whether no option names a method or a configuration."""
        file = None if isinstance(self.file, UnnamedFile) else self.file
        return replace(self, file=file) == MethodOptions()

    def variants(self, *additional: str, configured_first: bool = False) -> list[Variant]:
        """Return each chosen method with its configuration, without duplicates; by default the configured method.

        Parameters
        ----------
        *additional : str
            Additional overrides.
        configured_first : bool, optional
            Put the configured method first if it is compared and no method is named.

        Raises
        ------
        ConfigError
            If a name is unknown or the configuration is not valid.
        """
        return [one.variant() for one in self.bases(*additional, configured_first=configured_first)]

    def bases(self, *additional: str, configured_first: bool = False) -> list["Base"]:
        """Return each chosen method, for variants of it; arguments and errors as for `variants`.

        A key that a method lacks is ignored for this method if another method has it.
        """
        compared = [name for comparison in self.comparisons for name in COMPARISONS[comparison]]
        names = [*compared, *self.methods]
        if configured_first:
            own = [load_config(self.file).method] if compared and not self.methods else []
            names = [*self.methods, *(name for name in own if name in compared), *compared]
        overrides = (*self.overrides, *additional)
        if not names:
            return [Base(load_config(self.file, overrides=overrides).method, None, self.file, overrides)]
        keys = {name: _keys(name) for name in names}
        return [Base(name, _method(name), self.file, _fitting(overrides, name, keys)) for name in keys]


@dataclass(frozen=True)
class Base:
    """A chosen method and the sources of its configuration.

    Parameters
    ----------
    name : str
        Name in tables, such as ``joint`` or ``global_intensity@0.80``.
    method : str or None
        The method; None: that of the configuration.
    file : Path, mapping, Config or None
        Configuration file.
    overrides : tuple of str
        Settings of the form ``section.key=value``, for keys that the method has.
    """

    name: str
    method: str | None
    file: ConfigSource | None
    overrides: tuple[str, ...]

    @property
    def keys(self) -> tuple[str, ...]:
        """Configuration keys of the method."""
        method = self.method or self.name
        return tuple(field.name for field in fields(FILTERS[method].Params))

    def variant(self, *settings: str, name: str | None = None) -> Variant:
        """Return the method with its configuration and additional overrides, under another name if one is given.

        Raises
        ------
        ConfigError
            If the configuration is not valid.
        """
        overrides = (*self.overrides, *settings, *_GLOBAL_INTENSITY_AT.get(self.name, ()))
        config = load_config(self.file, method=self.method, overrides=overrides)
        if self.method and config.method != self.method:
            raise ConfigError(f"--set filter.method={config.method}: to compare methods, name them with --method")
        return Variant(name or self.name, config)


def _method(name: str) -> str:
    return name.partition("@")[0] if name in _GLOBAL_INTENSITY_AT else name


def _keys(name: str) -> set[str]:
    method = _method(name)
    return {f"filter.{field.name}" for field in fields(FILTERS[method].Params)} if method in FILTERS else set()


def _fitting(overrides: Sequence[str], name: str, keys: Mapping[str, set[str]]) -> tuple[str, ...]:
    """Return the overrides without those that only apply to other methods."""
    others = set().union(*keys.values()) - keys[name]
    return tuple(override for override in overrides if _key(override) not in others)


def _key(override: str) -> str:
    """Return the section and key of an override, without nested keys."""
    return ".".join(override.partition("=")[0].strip().split(".")[:2])
