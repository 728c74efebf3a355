"""What sources of all formats have in common, and components of several."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Damage, Message, Metadata, SensorFacts


class SourceBase:
    """A recording in ROS 2 format of which nothing is compressed, latched or known about its sensors.

    Nothing is skipped in it, and no file stays open.
    """

    profile = "ros2"
    compression: str | None = None
    metadata: Sequence[Metadata] = ()
    facts: Mapping[str, SensorFacts] = MappingProxyType({})

    def __init__(self) -> None:
        self.damage: list[Damage] = []
        self.warnings: list[str] = []

    @property
    def counts(self) -> dict[int, int]:
        """Empty mapping: messages are only known when they are read."""
        return {}

    def skipped(self, start_ns: int) -> Mapping[int, int]:  # noqa: ARG002 - the interface of all sources
        """Return an empty mapping: nothing is left out."""
        return {}

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:  # noqa: ARG002
        """Return an empty list: no topic is latched."""
        return []

    def close(self) -> None:
        """Do nothing: no file is kept open."""

    def add_damage(self, damage: Damage) -> None:
        """Add damage that is not known yet: a log may be read more than once."""
        if damage not in self.damage:
            self.damage.append(damage)

    def warn(self, *texts: str) -> None:
        """Add warnings that are not known yet."""
        self.warnings += [text for text in texts if text not in self.warnings]


class SourceWrapper(SourceBase):
    """A recording that is read through another source, and whose clouds are numbered by reading all of it."""

    def __init__(self, inner: Source) -> None:
        self._inner = inner
        self.name, self.format = inner.name, inner.format
        self.profile, self.compression = inner.profile, inner.compression
        self.metadata, self.facts = inner.metadata, inner.facts
        self.damage, self.warnings = inner.damage, inner.warnings

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message of the recording."""
        return self._inner.span_ns

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels of the recording."""
        return self._inner.latest(channels, before_ns)

    def close(self) -> None:
        """Close the recording."""
        self._inner.close()

    def _note(self, problem: str, lost_bytes: int, lost_messages: int | None = 1) -> None:
        self.add_damage(Damage(Path(self.name), None, problem, lost_bytes, lost_messages))
