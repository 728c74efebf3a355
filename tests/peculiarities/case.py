"""A peculiarity that someone reported of real files, as a tiny input with the right result."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, kw_only=True)
class Case:
    """A peculiarity: what is written, and what every command must make of it.

    Either it is read, and ``frames`` are the right points of each frame of the only topic, or of ``topic``: rows of
    x, y, z and, where there is one, intensity, without invalid points. Or it is ``refused``. These and ``says`` are
    regular expressions, of the error and of anything that must be in the output of `info`, `filter` or `convert`.
    """

    name: str
    source: str
    """Where it was seen: a public address, or a sentence."""
    build: Callable[[Path], Path]
    """Writes the input into an empty folder, and returns its path."""
    frames: Sequence[ArrayLike] = ()
    raw: Sequence[ArrayLike] = ()
    """Points that are in the input, if outputs cannot have all of them."""
    invalid: int = 0
    """Number of points of each frame that have no return."""
    stamps_ns: Sequence[int] | None = None
    topic: str | None = None
    refused: str | None = None
    refused_by: Sequence[str] = ("info", "filter", "convert")
    says: Mapping[str, str] = field(default_factory=dict)
    """Regular expression by command."""
    words: Sequence[str] = ()
    """Options of all commands."""
    to: Sequence[str] = ("mcap",)
    """Formats that it is converted and filtered to."""
    code: int = 0
    """Exit status of commands that read it: 3 if some of it is damaged."""
    atol: float = 0.0
    also: Callable[[Path], None] | None = None
    """Further assertions about an output."""

    @property
    def content(self) -> Sequence[ArrayLike]:
        """Points that are in the input."""
        return self.raw or self.frames

    def __str__(self) -> str:
        return self.name


def sea(frame: int = 0, size: int = 40) -> np.ndarray:
    """Return points of a frame, rows of x, y, z, intensity that fit into float32, and most of them into LAS."""
    random = np.random.default_rng(frame)
    places = random.normal([12, 0, 0], [20, 20, 2], (size, 3))
    return np.column_stack((np.round(places * 16) / 16, random.integers(1, 200, size))).astype("<f4")
