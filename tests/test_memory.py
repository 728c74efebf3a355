"""Memory that is kept from frame to frame."""

import numpy as np
import pytest

from seaclutter_cli.memory import keep_freed_memory


@pytest.mark.parametrize("error", [None, MemoryError])
def test_a_limited_address_space_is_no_error(error, monkeypatch):
    asked = []

    def empty(size, dtype):
        asked.append(size * np.dtype(dtype).itemsize)
        if error:
            raise error

    monkeypatch.setattr(np, "empty", empty)
    keep_freed_memory.cache_clear()
    keep_freed_memory()
    keep_freed_memory()
    (size,) = asked
    assert size >= 2**20
