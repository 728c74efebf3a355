"""Limits of what a log may expand to, whatever it declares. They bound the memory and the time that a log can cost.

A part of a log that exceeds a limit is damage: it is left out and reported. Real logs stay far below the defaults.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Literal, Self

from seaclutter_cli.errors import UsageError

Part = Literal["chunk", "message"]
CHANNEL_BYTES = 1024
"""Memory of a channel or schema besides its text, approximately."""

_PREFIX = "SEACLUTTER_MAX_"
_MIB, _GIB = 2**20, 2**30
_ALWAYS_BYTES = 16 * _MIB
_OF_FILE = {"chunk": (2, 2 * _ALWAYS_BYTES), "message": (8, _ALWAYS_BYTES // 2)}
"""Part of the ratio of its file that a chunk or message may have, and its size to which no ratio is too large."""
_UNITS = {
    "chunk_mib": "MiB",
    "chunk_messages": "messages",
    "message_mib": "MiB",
    "file_gib": "GiB",
    "file_ratio": "times the size of the file",
}


@dataclass(frozen=True)
class Limits:
    """Limits that the environment can change: ``SEACLUTTER_MAX_`` and the name of a field in capitals.

    Chunks are limited packed and unpacked, ``message_mib`` limits all declarations of topics and types of a log, too.
    ``file_gib`` and ``file_ratio``, the ratio to the size of the file, are of the content of a file that is compressed
    as a whole; up to 16 MiB, no ratio is too large. A chunk may have half of this ratio to its file, or 32 MiB; a
    message an eighth, or 8 MiB; the content of a message that is compressed by itself this ratio to it, or 8 MiB.
    ``whole_mib`` is the size of a file that is read at once, such as that of a frame, or a model.
    """

    chunk_mib: int = 80
    chunk_messages: int = 150_000
    message_mib: int = 48
    file_gib: int = 64
    file_ratio: int = 64
    whole_mib: int = 512

    @classmethod
    def read(cls, environment: Mapping[str, str]) -> Self:
        """Return the limits of an environment; `UsageError` if one of them is not a positive whole number."""
        given = {}
        for name in (field.name for field in fields(cls)):
            if (text := environment.get(variable(name))) is not None:
                if not (text.isascii() and text.isdigit() and len(text) <= 9 and int(text)):
                    raise UsageError(f"{variable(name)}: expected a positive whole number, got {text[:20]!r}")
                given[name] = int(text)
        return cls(**given)

    @property
    def chunk_bytes(self) -> int:
        """Limit of a chunk in bytes."""
        return self.chunk_mib * _MIB

    @property
    def message_bytes(self) -> int:
        """Limit of a message in bytes."""
        return self.message_mib * _MIB

    def bytes_of(self, part: Part, file: int) -> int:
        """Return the limit in bytes of a part of a file of ``file`` bytes; a small file has no large parts."""
        share, always = _OF_FILE[part]
        most = self.chunk_bytes if part == "chunk" else self.message_bytes
        return min(most, max(self.file_ratio * file // share, always))

    def packed_message_bytes(self, packed: int) -> int:
        """Return the limit in bytes of the content of a message that is compressed by itself to ``packed`` bytes."""
        return min(self.message_bytes, max(self.file_ratio * packed, _ALWAYS_BYTES // 2))

    def file_bytes(self, packed: int) -> int:
        """Return the limit in bytes of the content of a compressed file of ``packed`` bytes."""
        return min(self.file_gib * _GIB, max(self.file_ratio * packed, _ALWAYS_BYTES))


def variable(name: str) -> str:
    """Return the name of the environment variable that changes a limit."""
    return _PREFIX + name.upper()


def above(amount: str, name: str) -> str:
    """Return a description of a part that exceeds a limit, for messages."""
    return f"{amount}, above the limit of {getattr(limits(), name):,} {_UNITS[name]} ({variable(name)})"


def above_in_file(amount: str, part: Part, file: int) -> str:
    """Return a description of a chunk or message that exceeds the limit for a file of ``file`` bytes, for messages."""
    most = limits().bytes_of(part, file)
    if most == getattr(limits(), f"{part}_bytes"):
        return above(amount, f"{part}_mib")
    size = f"{most // _MIB} MiB in a file of {file:,} bytes"
    return f"{amount}, above the limit of {size} ({variable('file_ratio')})"


def limits() -> Limits:
    """Return the limits that the environment of this process sets."""
    return _limits_of(tuple(map(os.environ.get, _VARIABLES)))


_VARIABLES = tuple(variable(field.name) for field in fields(Limits))


@lru_cache(maxsize=8)
def _limits_of(texts: tuple[str | None, ...]) -> Limits:
    return Limits.read({name: text for name, text in zip(_VARIABLES, texts, strict=True) if text is not None})
