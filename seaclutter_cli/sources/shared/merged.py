"""Several recordings of one time as one, such as those of two recorders on one vessel."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from heapq import merge

from seaclutter_cli.errors import UsageError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Channel, Damage, Message, Record
from seaclutter_cli.sources.shared.split import JoinedSource

_TRANSFORMS = "TFMessage"


class MergedSource(JoinedSource[int]):
    """The records of several sources by log time; `UsageError` if one has no times.

    A topic of more than one gets the name of its recording before its own, as in ``/port/points``; transforms do not,
    because their frames have names.
    """

    channels: Sequence[Channel] = ()

    def __init__(self, sources: Sequence[Source], name: str) -> None:
        super().__init__(name)
        self._sources = sources
        if untimed := next((source.name for source in sources if not source.has_times), None):
            raise UsageError(f"{untimed}: its frames have no times, by which --merge could put them in order")
        self.format = ", ".join(dict.fromkeys(source.format for source in sources))
        self.profile = sources[0].profile if len({source.profile for source in sources}) == 1 else ""
        self.compression = sources[0].compression
        self.metadata = [record for source in sources for record in source.metadata]
        topics = Counter(topic for source in sources for topic in {c.topic for c in source.channels})
        self._several = {topic for topic, number in topics.items() if number > 1}
        self._prefixes = _prefixes([source.name for source in sources])
        for number, source in enumerate(sources):
            self._known[number] = {}
            for channel in source.channels:
                self._add(number, channel)
        self._gather()
        spans = [span for source in sources if (span := source.span_ns)]
        if spans and max(first for first, _ in spans) > min(last for _, last in spans):
            self.warn("the merged logs have no time in common")

    def _source(self, key: int) -> Source:
        return self._sources[key]

    def _whole(self, key: int, channel: Channel) -> Channel:
        is_transform = channel.schema is not None and channel.schema.name.endswith(_TRANSFORMS)
        topic = channel.topic if is_transform else self._topic(key, channel.topic)
        metadata = tuple(pair for pair in channel.metadata if pair[0] != "topic" or topic == channel.topic)
        new = replace(channel, id=len(self.channels) + 1, topic=topic, metadata=metadata)
        self.channels = [*self.channels, new]
        return new

    def _topic(self, number: int, topic: str) -> str:
        return f"/{self._prefixes[number]}/{topic.removeprefix('/')}" if topic in self._several else topic

    def restore_damage(self, damage: Iterable[Damage]) -> None:
        """Forget all other damage than this, so that the next reading adds it."""
        known = list(damage)
        for source in self._sources:
            source.restore_damage([one for one in source.damage if one in known])
        super().restore_damage(known)

    def _gather(self) -> None:
        """Take damage, warnings and facts from the sources."""
        self.damage[:] = [damage for source in self._sources for damage in source.damage]
        facts = [(number, *item) for number, source in enumerate(self._sources) for item in source.facts.items()]
        self.facts = {self._topic(number, topic): fact for number, topic, fact in facts}
        self.warn(*(f"{source.name}: {text}" for source in self._sources for text in source.warnings))

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield the records of all sources in log time order, metadata and attachments first."""
        parts = [self._records(number, start_ns, end_ns) for number in range(len(self._sources))]
        try:
            yield from merge(*parts, key=lambda record: record.log_time_ns if isinstance(record, Message) else -1)
        finally:
            self._gather()

    def _records(self, number: int, start_ns: int | None, end_ns: int | None) -> Iterator[Record]:
        for record in self._sources[number].records(start_ns, end_ns):
            yield self._message(number, record) if isinstance(record, Message) else record

    def close(self) -> None:
        """Close all sources."""
        for source in self._sources:
            source.close()


def _prefixes(names: Sequence[str]) -> list[str]:
    """Return distinct names of recordings as parts of topics, which ROS allows.

    Examples
    --------
    >>> _prefixes(["port", "2026-05-04", "port"])
    ['port', 'log_2026_05_04', 'port_3']
    """
    found: list[str] = []
    for number, name in enumerate(names, 1):
        plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
        plain = plain if plain[:1].isalpha() else f"log_{plain}".rstrip("_")
        found.append(f"{plain}_{number}" if plain in found else plain)
    return found
