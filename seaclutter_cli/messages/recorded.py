"""What a filtered log records about its topics, in a metadata record."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from seaclutter_cli.documents import DocumentError, load_json
from seaclutter_cli.records import Metadata

NAME = "seaclutter.topics"
"""Name of the metadata record; its entries are JSON by topic."""

FILTERED, REMOVED, RAW, DIAGNOSTICS = "filtered", "removed", "raw", "diagnostics"


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of a filtered log.

    Parameters
    ----------
    content : str
        ``filtered`` or ``removed`` points, ``raw`` clouds, or ``diagnostics``.
    clouds : str
        Topic of the raw clouds.
    methods : tuple of str
        Methods that filtered them, one for each run.
    first_frame : int
        Number of the first frame in the recording from which the log was made.
    is_part : bool
        Whether the log was made from a part of it.
    """

    content: str
    clouds: str
    methods: tuple[str, ...] = ()
    first_frame: int = 0
    is_part: bool = False


def to_metadata(topics: Mapping[str, RecordedTopic]) -> Metadata:
    """Return the metadata record about topics."""
    return Metadata(NAME, {name: json.dumps(asdict(topic), sort_keys=True) for name, topic in sorted(topics.items())})


def recorded_topics(metadata: Iterable[Metadata]) -> dict[str, RecordedTopic]:
    """Return what metadata records say about topics; the last record of several runs counts, damaged ones do not."""
    found: dict[str, RecordedTopic] = {}
    for record in metadata:
        if record.name == NAME:
            known = {name: _topic(text) for name, text in record.entries.items()}
            found |= {name: topic for name, topic in known.items() if topic}
    return found


def _topic(text: str) -> RecordedTopic | None:
    try:
        stored: dict[str, Any] = load_json(text)
        methods = tuple(map(str, stored["methods"]))
        topic = RecordedTopic(
            str(stored["content"]),
            str(stored["clouds"]),
            methods,
            int(stored["first_frame"]),
            bool(stored["is_part"]),
        )
    except (DocumentError, KeyError, TypeError, ValueError):
        return None
    return topic if topic.first_frame >= 0 else None
