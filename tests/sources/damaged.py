"""A small log in every layout, and a reader that checks what is true for every damaged file."""

import io
import random
import time
from dataclasses import replace
from functools import cache
from typing import NamedTuple

from mcap import records as mcap_records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.stream_reader import breakup_chunk

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Message
from seaclutter_cli.sources.mcap.source import McapSource
from tests.logs import LAYOUTS, START_NS, Entry, Extra, Topic, log_bytes, records_of

TOPICS = (Topic("/notes"), Topic("/imu", "raw", None, {"rate": "20"}))
EXTRAS = (Extra("file", 4, bytes(range(60))), Extra("vessel", 7, entries={"name": "Nord"}))
MOST_SECONDS = 5


class MessageBlock(NamedTuple):
    """Messages that are lost together: the messages of a chunk, or a single one outside chunks."""

    start: int
    end: int
    messages: tuple


@cache
def small_log(name):
    """Return a log of roughly 2000 bytes."""
    noise = random.Random(4)
    entries = [
        Entry(TOPICS[number % 3 == 2].name, START_NS + 10 * number, noise.randbytes(20 + number), 5 + number, number)
        for number in range(12)
    ]
    return log_bytes(TOPICS, entries, replace(LAYOUTS[name], chunk_size=120), EXTRAS)


def stream_of(piece):
    return ReadDataStream(io.BytesIO(piece.content))


@cache
def message_blocks(name):
    """Return the message blocks of a log, according to the mcap library."""
    found = []
    for piece in records_of(small_log(name)):
        if piece.op == Opcode.CHUNK:
            records = breakup_chunk(mcap_records.Chunk.read(stream_of(piece)), validate_crc=True)
        elif piece.op == Opcode.MESSAGE:
            records = [mcap_records.Message.read(stream_of(piece), len(piece.content))]
        else:
            continue
        messages = [
            (TOPICS[m.channel_id - 1].name, m.log_time, m.publish_time, m.sequence, m.data)
            for m in records
            if isinstance(m, mcap_records.Message)
        ]
        found.append(MessageBlock(piece.offset, piece.end, tuple(messages)))
    return found


def read(path, data):
    """Return messages, extras and damage of a file; None for the messages if nothing can be read."""
    with path.open("r+b") as file:
        file.write(data)
        file.truncate()
    began = time.process_time()
    try:
        source = McapSource(path)
    except InputError as error:
        assert str(path) in str(error)  # noqa: PT017
        return None, [], []
    messages, extras = [], []
    for record in source.records():
        if isinstance(record, Message):
            values = (record.log_time_ns, record.publish_time_ns, record.sequence, bytes(record.data))
            messages.append((record.channel.topic, *values))
        else:
            extras.append(record.name)
    for damage in source.damage:
        assert damage.path == path
        assert 0 <= damage.offset <= len(data)
        assert damage.lost_bytes >= 0
        assert str(path) in str(damage)
    source.close()
    assert time.process_time() - began < MOST_SECONDS
    return messages, extras, source.damage


def flip(data, at):
    flipped = bytearray(data)
    flipped[at] ^= 0xFF
    return bytes(flipped)


def damage_texts(damage):
    """Return the texts of damage, without the path."""
    return [str(item).split("log.mcap: ", 1)[1] for item in damage]
