"""Sending of files to object storage. Unlike the last request, which lets an object appear, it may be interrupted."""

from collections.abc import Callable
from pathlib import Path

_PIECE = 4 * 2**20


def send(file: Path, write: Callable[[bytes], object]) -> None:
    """Pass the content of a file on in pieces."""
    with file.open("rb") as stream:
        while piece := stream.read(_PIECE):
            write(piece)
