"""Memory of this process."""

from functools import cache

import numpy as np

_LARGEST_BYTES = 4 * 2**20


@cache
def keep_freed_memory() -> None:
    """Let the C library keep the memory of a frame for the next one.

    By default, glibc returns it to the system after each frame and gets it back page by page, which costs as much time
    as decoding. It keeps twice as much as the largest block that was freed. An unused block needs no memory itself.
    """
    try:
        np.empty(_LARGEST_BYTES, np.uint8)
    except MemoryError:  # the address space is limited
        return
