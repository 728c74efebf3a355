"""Program that decompresses LAZ points for `laz`; it imports nothing but the decoder, so that it starts quickly.

A request is a pickled tuple: path of the file, place of the points in it, description of the compression, size of a
point in bytes, number of points. Chunks may stand for the place, each with its offset, size and number of points. The
answer consists of blocks of points, each after its size; after a negative size follows the text of an error.
"""

import io
import pickle
import signal
import struct
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

SIZE = struct.Struct("<q")
_TABLE_AT = struct.Struct("<q")
_BLOCK_POINTS = 500_000


def main() -> None:
    """Answer requests from standard input until it closes."""
    import lazrs  # type: ignore[import-untyped]  # an extra that whoever imports this module may lack

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the first one ends this one
    requests, out = sys.stdin.buffer, sys.stdout.buffer
    with suppress(EOFError, BrokenPipeError):
        while True:
            path, *request = pickle.load(requests)  # noqa: S301 - from the process that started this one
            try:
                with Path(path).open("rb") as file:
                    for block in _read(lazrs, file, *request):
                        out.write(SIZE.pack(len(block)))
                        out.write(block)
            except BrokenPipeError:
                raise
            except Exception as error:  # noqa: BLE001 - raised again by the process that reads the points
                text = str(error).encode()
                out.write(SIZE.pack(-len(text)) + text)
            out.flush()


def _read(
    lazrs: Any, file: BinaryIO, place: int | list[tuple[int, int, int]], described: bytes, size: int, left: int
) -> Iterator[bytearray]:
    if isinstance(place, int):
        file.seek(place)
        yield from _blocks(lazrs.LasZipDecompressor(file, described), size, left)
        return
    for offset, length, points in place:
        file.seek(offset)
        alone = _alone(lazrs, file.read(length), described, points)
        yield from _blocks(lazrs.LasZipDecompressor(alone, described), size, points)


def _blocks(points: Any, size: int, left: int) -> Iterator[bytearray]:
    while left:
        block = bytearray(min(left, _BLOCK_POINTS) * size)
        points.decompress_many(block)
        yield block
        left -= len(block) // size


def _alone(lazrs: Any, chunk: bytes, described: bytes, points: int) -> BinaryIO:
    """Return a chunk as the only one of a file, because lazrs decompresses files in parts, but chunks as a whole."""
    alone = io.BytesIO()
    alone.write(_TABLE_AT.pack(_TABLE_AT.size + len(chunk)))
    alone.write(chunk)
    lazrs.write_chunk_table(alone, [(points, len(chunk))], lazrs.LazVlr(described))
    alone.seek(0)
    return alone


if __name__ == "__main__":
    main()
