"""What sources of several formats have in common."""

from collections.abc import Collection
from pathlib import Path

from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Damage, Message


class SourceWrapper(Source):
    """A recording that is read through another source, and whose clouds are numbered by reading all of it."""

    def __init__(self, inner: Source) -> None:
        super().__init__()
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
