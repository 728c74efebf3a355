"""Methods that an evaluation compares, each with its configuration and a unique name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

from seaclutter_cli.config import Config, ConfigSource, UnnamedFile, load_config
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.runs.options import ConfigOptions, MethodOptions

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
    """A method with its configuration, and its name in tables, such as ``joint`` or ``update_weight=0.6``."""

    name: str
    config: Config


def configured(options: ConfigOptions, *additional: str, undetermined_thresholds: bool = False) -> Config:
    """Return the configuration of a run, with additional settings; see `load_config` for parameters and errors."""
    return load_config(
        options.config,
        method=options.method,
        overrides=(*options.settings, *additional),
        undetermined_thresholds=undetermined_thresholds,
    )


def is_default(options: MethodOptions) -> bool:
    """Return whether no option names a method or a configuration."""
    named = options.methods or options.compare or options.settings
    return not named and (options.config is None or isinstance(options.config, UnnamedFile))


def variants(options: MethodOptions, *additional: str, configured_first: bool = False) -> list[Variant]:
    """Return each chosen method with its configuration, without duplicates; by default the configured method.

    ``additional`` settings apply to all. If the configured method is compared, it can be ``configured_first``. Raise
    `ConfigError` if a name is unknown or a configuration is not valid.
    """
    return [one.variant() for one in bases(options, *additional, configured_first=configured_first)]


def bases(options: MethodOptions, *additional: str, configured_first: bool = False) -> list["Base"]:
    """Return each chosen method, for variants of it; arguments and errors as for `variants`.

    A key that a method lacks is ignored for this method if another method has it.
    """
    compared = [name for comparison in options.compare for name in COMPARISONS[comparison]]
    names = [*compared, *options.methods]
    if configured_first:
        own = [load_config(options.config).method] if compared and not options.methods else []
        names = [*options.methods, *(name for name in own if name in compared), *compared]
    settings = (*options.settings, *additional)
    if not names:
        return [Base(load_config(options.config, overrides=settings).method, None, options.config, settings)]
    keys = {name: _keys(name) for name in names}
    return [Base(name, _method(name), options.config, _fitting(settings, name, keys)) for name in keys]


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
        return tuple(field.name for field in fields(FILTERS[method].Params))

    def variant(self, *settings: str, name: str | None = None) -> Variant:
        """Return the method with its configuration and additional overrides, under another name if one is given."""
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
