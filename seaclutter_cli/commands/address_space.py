"""Imports in a limited address space."""

import sys
from collections.abc import Mapping

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

NEEDED_MB: Mapping[str, int] = {"numpy": 100, "scipy": 140}
"""Address space that packages take with one thread; each has an OpenBLAS of its own."""


def check_imports() -> None:
    """Make imports of `NEEDED_MB` fail with `MemoryError` where the address space of the process is too small.

    OpenBLAS tries for ever to get its memory when it is loaded.
    """
    if resource is not None and resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY:
        sys.meta_path.insert(0, _RoomFinder())


class _RoomFinder:
    """Finder that finds nothing, and checks the address space instead."""

    def find_spec(self, name: str, *_: object) -> None:
        """Return None; raise `MemoryError` if there is no room for a package."""
        if name in NEEDED_MB:
            import mmap  # only needed here

            try:
                mmap.mmap(-1, NEEDED_MB[name] * 2**20).close()
            except OSError as error:
                raise MemoryError(f"no room for {name}") from error
