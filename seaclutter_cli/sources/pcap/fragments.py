"""Reassembly of datagrams that were sent in fragments."""

from collections import OrderedDict
from dataclasses import dataclass, field

_MAX_OPEN = 64
_MAX_BYTES = 2**17

Key = tuple[int, int, int]


@dataclass
class _Incomplete:
    """A datagram with missing fragments; pieces by their offset."""

    pieces: dict[int, bytes] = field(default_factory=dict)
    size: int = 0
    length: int | None = None

    def whole(self) -> bytes | None:
        """Return the datagram if it is complete, otherwise None."""
        if self.length is None or self.size < self.length:
            return None
        data = b""
        for offset in sorted(self.pieces):
            if offset != len(data):
                return None
            data += self.pieces[offset]
        return data


class Fragments:
    """Reassembly of up to 64 IPv4 datagrams; a new one replaces the oldest. ``lost`` counts the discarded ones."""

    def __init__(self) -> None:
        self._open: OrderedDict[Key, _Incomplete] = OrderedDict()
        self.lost = 0

    def add(self, key: Key, offset: int, more: bool, piece: bytes) -> bytes | None:
        """Return the datagram that a fragment completes; None if it is still incomplete.

        The key is sender, receiver and identification, the offset that of the fragment in the datagram in bytes.
        """
        waiting = self._open.get(key)
        if waiting is not None and offset in waiting.pieces and waiting.pieces[offset] != piece:
            self._discard(key)  # the identification is reused
            waiting = None
        if waiting is None:
            if len(self._open) >= _MAX_OPEN:
                self._discard(next(iter(self._open)))
            waiting = self._open[key] = _Incomplete()
        if offset not in waiting.pieces:
            waiting.pieces[offset] = piece
            waiting.size += len(piece)
        if not more:
            waiting.length = offset + len(piece)
        data = waiting.whole()
        if data is not None:
            del self._open[key]
        elif waiting.size > _MAX_BYTES:
            self._discard(key)
        return data

    def finish(self) -> None:
        """Count the incomplete datagrams as lost."""
        self.lost += len(self._open)
        self._open.clear()

    def _discard(self, key: Key) -> None:
        del self._open[key]
        self.lost += 1
