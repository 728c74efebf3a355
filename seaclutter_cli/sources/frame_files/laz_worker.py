"""Program that decompresses LAZ points for `laz`; it imports nothing but the decoder, so that it starts quickly.

A request is a pickled tuple: path of the file, place of the points in it, description of the compression, size of a
point in bytes, number of points. The answer consists of blocks of points, each after its size; after a negative size
follows the text of an error.
"""

import pickle
import signal
import struct
import sys
from contextlib import suppress
from pathlib import Path

SIZE = struct.Struct("<q")
_BLOCK_POINTS = 500_000


def main() -> None:
    """Answer requests from standard input until it closes."""
    import lazrs  # type: ignore[import-untyped]  # an extra that whoever imports this module may lack

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the first one ends this one
    requests, out = sys.stdin.buffer, sys.stdout.buffer
    with suppress(EOFError, BrokenPipeError):
        while True:
            path, at, described, size, left = pickle.load(requests)  # noqa: S301 - from the process that started this one
            try:
                with Path(path).open("rb") as file:
                    file.seek(at)
                    points = lazrs.LasZipDecompressor(file, described)
                    while left:
                        block = bytearray(min(left, _BLOCK_POINTS) * size)
                        points.decompress_many(block)
                        out.write(SIZE.pack(len(block)))
                        out.write(block)
                        left -= len(block) // size
            except BrokenPipeError:
                raise
            except Exception as error:  # noqa: BLE001 - raised again by the process that reads the points
                text = str(error).encode()
                out.write(SIZE.pack(-len(text)) + text)
            out.flush()


if __name__ == "__main__":
    main()
