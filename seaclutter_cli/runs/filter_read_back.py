"""Rows of skipped recordings for the table of a filter run that goes on."""

import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.config import Config
from seaclutter_cli.errors import InputError
from seaclutter_cli.messages.diagnostics import TOPIC, read_diagnostics
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.records import Message
from seaclutter_cli.runs.batch import Work
from seaclutter_cli.runs.filter_result import FilterOutcome
from seaclutter_cli.runs.filter_table import own_table
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.recordings import ReadOptions
from seaclutter_cli.sinks.csv import CsvSink
from seaclutter_cli.sources import Recording


@dataclass(frozen=True)
class ReadBackWork(Work[FilterOutcome]):
    """Reading of the rows of the table from a complete output; without them, the recording is filtered again.

    Parameters
    ----------
    work : Work
        Filtering of the recording.
    config : Config
        Effective configuration.
    outcome : FilterOutcome
        Outcome of the earlier run.
    """

    work: Work[FilterOutcome]
    config: Config
    outcome: FilterOutcome

    @property
    def recording(self) -> Recording:  # type: ignore[override]
        """The recording."""
        return self.work.recording

    @property
    def writes(self) -> Sequence[Path]:
        """The output, which may have to be written again."""
        return self.work.writes

    def run(self, observer: Observer) -> FilterOutcome:
        """Return the outcome of the earlier run with its rows."""
        with own_table(self.config) as table:
            rows = _rows_in(self.outcome.output, self.recording.name, self.outcome.topics, table)
        if rows is None:
            observer.note("filtered again; the output lacks the diagnostics that the table needs")
            return self.work.run(observer)
        self.outcome.rows = zlib.compress(rows)
        return self.outcome

    def without_result(self, reason: str) -> FilterOutcome:
        """Return an outcome without frames."""
        return self.work.without_result(reason)


def _rows_in(output: Path, recording: str, topics: Mapping[str, TopicTally], table: CsvSink) -> bytes | None:
    """Return the rows of a recording from the diagnostics in its output; None if these are not of all frames.

    ``recording`` is its name, ``topics`` are the sums over its frames; the empty ``table`` is filled.
    """
    found = Counter[str]()
    try:
        with closing(ReadOptions().open(Recording((output,)))) as source:
            for record in source.records():
                if not isinstance(record, Message) or record.channel.topic != TOPIC:
                    continue
                name = record.channel.schema.name if record.channel.schema else ""
                one = read_diagnostics(record.data, record.channel.message_encoding, name)
                place = one.topic, one.numbers["frame"], one.stamp_ns, one.numbers["points_in"]
                table.write_row(recording, place, one.counts, one.rings, one.scene, one.water)
                found[one.topic] += 1
    except InputError:
        return None
    table.end()
    return table.rows() if found == Counter({topic: tally.frames for topic, tally in topics.items()}) else None
