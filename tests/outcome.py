"""Runs of ``filter`` on possibly damaged logs, with assertions that are valid for every run."""

import csv
import io
import re

from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader

from tests.logs import LAYOUTS, PERIOD_NS, START_NS, Entry, cloud_topic, records_of, write_log
from tests.running import execute

DAMAGED = re.compile(r"Damaged: (?P<position>.+?): (?P<problem>.+?)(; left out: (?P<amount>.*\d (messages?|bytes?)))?")


class Outcome:
    """The outcome of a run of ``filter``, after assertions that are valid for every run."""

    def __init__(self, folder, data, *options):
        self.log, out, table = folder / "log.mcap", folder / "out.mcap", folder / "frames.csv"
        if data is not None:
            self.log.write_bytes(data)
        arguments = ["filter", self.log, "-o", out, "--csv", table, "--force", "-v", *options]
        result = execute(*arguments)
        self.code, self.stderr = result.exit_code, result.stderr
        assert "Traceback" not in result.output
        assert self.code in (0, 1, 3), result.output
        assert [path.name for path in folder.iterdir() if path.name.endswith(".part")] == []
        assert out.exists() == (self.code != 1)
        assert len([line for line in self.stderr.splitlines() if line.startswith("Error: ")]) == (self.code == 1)
        self.damage = [line for line in self.stderr.splitlines() if line.startswith("Damaged: ")]
        assert self.damage or self.code != 3
        assert not self.damage or self.code != 0
        for line in self.damage:
            assert DAMAGED.fullmatch(line), line
        self.rows, self.messages = [], {}
        if self.code != 1:
            with table.open() as stream:
                self.rows = list(csv.DictReader(stream))
            self.messages = read_whole(out)
            out.unlink()
        table.unlink(missing_ok=True)
        assert len(self.messages.get("/points", ())) == len(self.rows)

    @property
    def frames(self):
        """Indices of the filtered frames."""
        return [int(row["frame"]) for row in self.rows]

    @property
    def points(self):
        """Number of input points of each frame."""
        return [int(row["points_in"]) for row in self.rows]

    @property
    def sequences(self):
        """Sequence numbers of the filtered frames, from 0."""
        return [message.sequence - 100 for message in self.messages["/points"]]


def read_whole(path):
    """Return the messages of each topic, read sequentially and by the index, with checksums verified."""
    data = path.read_bytes()
    front = list(NonSeekingReader(io.BytesIO(data), validate_crcs=True).iter_messages())
    indexed = list(make_reader(io.BytesIO(data), validate_crcs=True).iter_messages())
    assert [message for *_, message in front] == [message for *_, message in indexed]
    topics = {}
    for _, channel, message in front:
        topics.setdefault(channel.topic, []).append(message)
    return topics


def chunks(data):
    """Return the chunks that contain a frame."""
    return [piece for piece in records_of(data) if piece.op == Opcode.CHUNK and len(piece.content) > 3000]


def flip(data, at):
    return data[:at] + bytes((data[at] ^ 0xFF,)) + data[at + 1 :]


def all_broken(data):
    for chunk in chunks(data):
        data = flip(data, chunk.end - 1000)
    return data


def log_of(path, messages, *, topic=None, layout=LAYOUTS["zstd"]):
    topic = topic or cloud_topic("/points")
    entries = [Entry(topic.name, START_NS + n * PERIOD_NS, data, sequence=100 + n) for n, data in enumerate(messages)]
    return write_log(path, [topic], entries, layout).read_bytes()
