"""Content inside containers: mutated, and packed again with valid sizes and checksums, so that readers reach it."""

import bz2
import io
import sqlite3
import struct
import zipfile
import zlib
from dataclasses import replace
from hashlib import sha256

import lz4.frame
import zstandard
from mcap import records as mcap_records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from tests.logs import MAGIC, join, records_of

_PACK = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}
_UNPACK = {
    "zstd": lambda data: zstandard.ZstdDecompressor().decompressobj().decompress(data),
    "lz4": lz4.frame.decompress,
    "": bytes,
}


def zstd(data, _, change):
    """Change the content of a file that is compressed as a whole."""
    return zstandard.compress(change(_UNPACK["zstd"](data)))


def hashed(data, _, change):
    """Change a file that ends with the SHA-256 of the rest."""
    content = change(data[:-32])
    return content + sha256(content).digest()


def mcap_chunk(data, random, change):
    """Change the records of a chunk; the index at the end remains, or is left out."""
    pieces = records_of(data)
    at = random.choice([number for number, piece in enumerate(pieces) if piece.op == Opcode.CHUNK])
    chunk = mcap_records.Chunk.read(ReadDataStream(io.BytesIO(pieces[at].content)))
    content = change(_UNPACK[chunk.compression](chunk.data))
    packed = _PACK[chunk.compression](content)
    chunk = replace(chunk, data=packed, uncompressed_size=len(content), uncompressed_crc=zlib.crc32(content))
    if random.random() < 0.3:
        return join(*pieces[:at], chunk, *pieces[at + 1 :])
    kept = (Opcode.HEADER, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA)
    before, after = ([piece for piece in part if piece.op in kept] for part in (pieces[:at], pieces[at + 1 :]))
    return join(*before, chunk, *after, mcap_records.DataEnd(0), mcap_records.Footer(0, 0, 0))


def mcap_message(data, random, change):
    """Change the content of a message in a chunk."""

    def change_one(records):
        pieces = records_of(MAGIC + records + MAGIC)
        places = [number for number, piece in enumerate(pieces) if piece.op == Opcode.MESSAGE]
        if not places:
            return records
        at = random.choice(places)
        content = pieces[at].content
        pieces[at] = pieces[at]._replace(content=content[:22] + change(content[22:]))
        return join(*pieces)[len(MAGIC) : -len(MAGIC)]

    return mcap_chunk(data, random, change_one)


def _bag_records(data):
    """Return the headers and data of the records of a bag, or of a chunk."""
    records, at = [], 0
    while at + 8 <= len(data):
        (header,) = struct.unpack_from("<I", data, at)
        (size,) = struct.unpack_from("<I", data, at + 4 + header)
        start = at + 8 + header
        records.append((data[at + 4 : at + 4 + header], data[start : start + size]))
        at = start + size
    return records


def _bag_bytes(records):
    return b"".join(struct.pack("<I", len(h)) + h + struct.pack("<I", len(d)) + d for h, d in records)


_BAG_MAGIC = b"#ROSBAG V2.0\n"


def bag_chunk(data, random, change):
    """Change the records of a chunk of a ROS 1 bag; the index remains, or is left out."""
    records = _bag_records(data[len(_BAG_MAGIC) :])
    at = random.choice([number for number, (header, _) in enumerate(records) if b"op=\x05" in header])
    header, packed = records[at]
    name = next(name for name in (b"bz2", b"lz4", b"none") if b"compression=" + name in header)
    unpack = {b"bz2": bz2.decompress, b"lz4": lz4.frame.decompress, b"none": bytes}[name]
    pack = {b"bz2": bz2.compress, b"lz4": lz4.frame.compress, b"none": bytes}[name]
    content = change(unpack(packed))
    size = header.index(b"size=") + 5
    records[at] = (header[:size] + struct.pack("<I", len(content)) + header[size + 4 :], pack(content))
    if random.random() < 0.5:
        records = [record for record in records if not any(op in record[0] for op in (b"op=\x04", b"op=\x06"))]
    return _BAG_MAGIC + _bag_bytes(records)


def bag_message(data, random, change):
    """Change the data of a message, or of a connection, in a chunk of a ROS 1 bag."""

    def change_one(content):
        records = _bag_records(content)
        at = random.randrange(len(records))
        records[at] = (records[at][0], change(records[at][1] or b"\0"))
        return _bag_bytes(records)

    return bag_chunk(data, random, change_one)


def sqlite_cell(data, random, change):
    """Change a value in a table of an sqlite3 recording."""
    database = sqlite3.connect(":memory:")
    database.deserialize(data)
    table, column = random.choice(
        [("messages", "data")] * 4
        + [("messages", "timestamp"), ("messages", "topic_id"), ("topics", "type"), ("topics", "name")]
    )
    rows = database.execute(f"SELECT rowid, {column} FROM {table}").fetchall()
    row, value = random.choice(rows)
    if isinstance(value, bytes):
        packed = value[:4] == b"\x28\xb5\x2f\xfd"
        new = zstandard.compress(change(_UNPACK["zstd"](value))) if packed else change(value)
    else:
        new = random.choice((-1, 0, 2**63 - 1, -(2**63), 1.5, "x", b"x", "", b"\xff" * 40, value, f"{value}x"))
    database.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (new, row))
    database.commit()
    return database.serialize()


def packet(data, random, change):
    """Change the payload of a packet of a classic capture of Ethernet frames; the lengths fit."""
    starts, at = [], 24
    while at + 16 <= len(data):
        starts.append(at)
        at += 16 + struct.unpack_from("<I", data, at + 8)[0]
    at = random.choice(starts)
    size = struct.unpack_from("<I", data, at + 8)[0]
    head, payload = bytearray(data[at + 16 : at + 58]), change(data[at + 58 : at + 16 + size])[:60_000]
    struct.pack_into(">H", head, 16, 28 + len(payload))
    struct.pack_into(">H", head, 38, 8 + len(payload))
    sizes = struct.pack("<II", 42 + len(payload), 42 + len(payload))
    return data[: at + 8] + sizes + head + payload + data[at + 16 + size :]


def member(data, random, change):
    """Change a member of a ZIP archive."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    name = "schema.json" if "schema.json" in content and random.random() < 0.6 else random.choice(list(content))
    content[name] = change(content[name])
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, part in content.items():
            archive.writestr(name, part)
    return file.getvalue()
