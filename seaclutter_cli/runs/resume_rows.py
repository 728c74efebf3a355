"""Rows of the table of frames, read back from filtered logs."""

from collections import Counter
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

from seaclutter_cli.errors import InputError
from seaclutter_cli.messages.diagnostics import TOPIC, read_diagnostics
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.records import Message
from seaclutter_cli.runs.recordings import ReadOptions
from seaclutter_cli.sinks.csv import CsvSink
from seaclutter_cli.sources import Recording


def rows_in(output: Path, recording: str, topics: Mapping[str, TopicTally], table: CsvSink) -> bytes | None:
    """Return the rows of a recording from the diagnostics in its output; None if these are not of all frames.

    Parameters
    ----------
    output : Path
        Filtered log.
    recording : str
        Name of the recording.
    topics : mapping of str to TopicTally
        Sums over its frames.
    table : CsvSink
        Empty table, which is filled.
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
