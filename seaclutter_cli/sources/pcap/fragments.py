"""Datagrams put together again that were sent in fragments."""

from collections import OrderedDict
from dataclasses import dataclass, field

_MOST_OPEN = 64
_MOST_BYTES = 2**17

Key = tuple[int, int, int]


@dataclass
class _Open:
    """A datagram of which not all fragments have come; pieces by their place."""

    pieces: dict[int, bytes] = field(default_factory=dict)
    size: int = 0
    length: int | None = None

    def whole(self) -> bytes | None:
        """Return the datagram if it is complete."""
        if self.length is None or self.size < self.length:
            return None
        data = b""
        for place in sorted(self.pieces):
            if place != len(data):
                return None
            data += self.pieces[place]
        return data


class Fragments:
    """Puts fragments of IPv4 datagrams together.

    Notes
    -----
    State: up to 64 datagrams that are not complete; the oldest is given up for a new one. ``lost`` counts those.
    """

    def __init__(self) -> None:
        self._open: OrderedDict[Key, _Open] = OrderedDict()
        self.lost = 0

    def add(self, key: Key, place: int, more: bool, piece: bytes) -> bytes | None:
        """Return the datagram that a fragment completes, if it does.

        Parameters
        ----------
        key : tuple of int
            Sender, receiver and identification.
        place : int
            Where the fragment belongs, in bytes.
        more : bool
            Whether others follow.
        piece : bytes
            What it holds.
        """
        waiting = self._open.get(key)
        if waiting is not None and place in waiting.pieces and waiting.pieces[place] != piece:
            self._give_up(key)  # the number is used again
            waiting = None
        if waiting is None:
            if len(self._open) >= _MOST_OPEN:
                self._give_up(next(iter(self._open)))
            waiting = self._open[key] = _Open()
        if place not in waiting.pieces:
            waiting.pieces[place] = piece
            waiting.size += len(piece)
        if not more:
            waiting.length = place + len(piece)
        data = waiting.whole()
        if data is not None:
            del self._open[key]
        elif waiting.size > _MOST_BYTES:
            self._give_up(key)
        return data

    def finish(self) -> None:
        """Count what is still not complete as lost."""
        self.lost += len(self._open)
        self._open.clear()

    def _give_up(self, key: Key) -> None:
        del self._open[key]
        self.lost += 1
