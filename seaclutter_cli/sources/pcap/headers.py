"""Packets of a sensor that are in a capture, but whose Ethernet or IP header is damaged."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sources.pcap.records import Records
from seaclutter_cli.sources.shared.log_file import LogFile

_MAX_OTHERS = 10_000


@dataclass
class UnreadRecords:
    """Records of a capture without a datagram, to be compared with those of sensors.

    Parameters
    ----------
    shapes : dict of int to (int, int)
        Length of a record and offset of the payload in it, by the length of the payload.
    others : list of (int, int)
        Offset and length of records without a datagram, at most 10,000.
    """

    shapes: dict[int, tuple[int, int]] = field(default_factory=dict)
    others: list[tuple[int, int]] = field(default_factory=list)

    def add(
        self, records: Records, used: NDArray[np.int64], rows: NDArray[np.int64], payloads: NDArray[np.int64]
    ) -> None:
        """Add records.

        Parameters
        ----------
        records : Records
            R records.
        used : ndarray, int64
            Those with a datagram or a part of one.
        rows : ndarray, shape (D,), int64
            Those with a complete datagram.
        payloads : ndarray, shape (2, D), int64
            Offset in the record, and length, of their payloads.
        """
        _, firsts = np.unique(payloads[1], return_index=True)
        for first in firsts.tolist():
            start, length = payloads[:, first].tolist()
            self.shapes.setdefault(length, (int(records.lengths[rows[first]]), start))
        if len(used) < len(records.offsets) and len(self.others) < _MAX_OTHERS:
            other = np.setdiff1d(np.arange(len(records.offsets)), used)
            self.others += zip(records.offsets[other].tolist(), records.lengths[other].tolist(), strict=True)
            del self.others[_MAX_OTHERS:]

    def count(self, file: LogFile, length: int, recognises: Callable[[NDArray[np.uint8]], bool]) -> int:
        """Return the number of records without a datagram that have length and payload of a sensor's records."""
        size, start = self.shapes[length]
        found = (file[offset + start : offset + start + length] for offset, other in self.others if other == size)
        return sum(recognises(np.frombuffer(payload, np.uint8)) for payload in found)
