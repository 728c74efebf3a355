"""Packets of known lidars that are not decoded."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

ADVICE = "record the sensor_msgs/PointCloud2 of the maker's driver"
"""What to do with a sensor whose packets are not decoded."""


@dataclass(frozen=True)
class _Kind:
    """Packets of a sensor: their first bytes and their lengths (any if empty)."""

    name: str
    begins: bytes
    lengths: tuple[int, ...] = ()


_MEMS = bytes.fromhex("55aa5aa5")
_HESAI = b"\xee\xff"

_KINDS = (
    _Kind("RoboSense RS-M2", _MEMS, (1342,)),
    _Kind("RoboSense RS-M3", _MEMS, (1448,)),
    _Kind("RoboSense RS-MX", _MEMS, (1404,)),
    _Kind("RoboSense RS-EMX", _MEMS, (812,)),
    _Kind("RoboSense RS-M1 Jumbo", _MEMS, (62152,)),
    _Kind("Hesai JT128, or another with protocol 1.4 that is not a Pandar128 or OT128", _HESAI + bytes((1, 4))),
    _Kind("Hesai JT16 (protocol 1.8)", _HESAI + bytes((1, 8))),
    _Kind("Hesai PandarQT with 32 lasers (protocol 3.1)", _HESAI + bytes((3, 1, 0, 0, 32))),
    _Kind("Hesai AT128 (protocol 4.1)", _HESAI + bytes((4, 1))),
    _Kind("Hesai ATX (protocol 4.7)", _HESAI + bytes((4, 7))),
    _Kind("Hesai FT120 (protocol 7.2)", _HESAI + bytes((7, 2))),
)
"""Kinds of packets, the most particular first. Remove those that get a decoder."""


def name_unsupported(payload: NDArray[np.uint8]) -> str | None:
    """Return the name of a known sensor without a decoder that sent a UDP payload, shape (L,); None if it is unknown.

    Examples
    --------
    >>> name_unsupported(np.frombuffer(bytes((0xEE, 0xFF, 4, 7)) + bytes(1000), np.uint8))
    'Hesai ATX (protocol 4.7)'
    """
    for kind in _KINDS:
        fits = not kind.lengths or len(payload) in kind.lengths
        if fits and payload[: len(kind.begins)].tobytes() == kind.begins:
            return kind.name
    return None
