"""Real paths of many files."""

import os
from pathlib import Path


class RealPaths:
    """Real paths of files, with one look at each folder: on a network, each look at a name takes a while.

    **State**: the real path of each folder of a file so far; valid as long as no folder becomes a link.

    Examples
    --------
    >>> real = RealPaths()
    >>> real(Path("samples/../samples/sea.mcap")) == Path("samples/sea.mcap").resolve()
    True
    """

    def __init__(self) -> None:
        self._folders: dict[str, str] = {}

    def __call__(self, path: Path) -> Path:
        """Return the absolute path of a file without links, as `Path.resolve` does."""
        folder, name = os.path.split(path)
        if name in ("", ".", ".."):
            return Path(os.path.realpath(path))
        if folder not in self._folders:
            self._folders[folder] = os.path.realpath(folder)
        full = os.path.join(self._folders[folder], name)  # noqa: PTH118 - faster, for thousands of paths
        return Path(os.path.realpath(full) if os.path.islink(full) else full)  # noqa: PTH114
