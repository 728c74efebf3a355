"""Tiles of an airborne survey: one file each, found by name and read in parts."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from glob import glob, has_magic
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError, InputError, UsageError
from seaclutter_cli.frame import INTENSITY_NAMES
from seaclutter_cli.sources.crs import Crs, read_crs
from seaclutter_cli.sources.frame_files import FRAME_READERS
from seaclutter_cli.sources.frame_files.las import CHUNK_POINTS, open_las, parts_of, with_records
from seaclutter_cli.sources.frame_files.reading import reading
from seaclutter_cli.urls import is_url

if TYPE_CHECKING:
    from seaclutter_cli.cloud import Cloud

Columns = dict[str, NDArray[Any]]
PathLike = str | os.PathLike[str]

_KEPT_BYTES = 1 << 28
_PIECE_POINTS = 1 << 17
_EPT = "ept.json"
"""File that describes a set of Entwine point tiles, in their folder."""


class Tile(ABC):
    """The points of one file, in a fixed order: `seaclutter_cli.interfaces.TilePoints`."""

    path: Path
    size: int
    crs = Crs()

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the points' fields."""

    @abstractmethod
    def parts(self) -> Iterator[Any]:
        """Yield the points in parts; can be called again."""

    def xyz(self, part: Any) -> NDArray[np.float64]:
        """Return coordinates of a part's points in metres, shape (3, n), with the units of the file's CRS applied."""
        xyz = np.stack([np.asarray(part[axis], np.float64) for axis in "xyz"])
        if (self.crs.unit_m, self.crs.height_unit_m) != (1.0, 1.0):
            xyz *= np.array([[self.crs.unit_m], [self.crs.unit_m], [self.crs.height_unit_m]])
        return xyz

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Yield coordinates in metres, shape (3, n), of pieces that are small enough for a processor's cache."""
        for part in self.parts():
            for start in range(0, len(part), _PIECE_POINTS):
                yield self.xyz(part[start : start + _PIECE_POINTS])

    def columns(self, names: Iterable[str]) -> Columns:
        """Return whole fields, shape (N,) each; missing names are left out."""
        wanted = [name for name in names if name in self.names]
        parts = [[np.asarray(part[name]) for name in wanted] for part in self.parts()]
        return {name: np.concatenate([part[index] for part in parts]) for index, name in enumerate(wanted) if parts}

    def column(self, name: str) -> NDArray[Any] | None:
        """Return an attribute of all points by its LAS name, shape (N,); None if the tile does not have it."""
        own = self.intensity_name if name == "intensity" else name
        return self.columns([own]).get(own) if own else None

    @property
    def intensity_name(self) -> str | None:
        """Name of the intensity field; None without."""
        folded = {name.lower(): name for name in reversed(self.names)}
        return next((folded[usual] for usual in INTENSITY_NAMES if usual in folded), None)


class LasTile(Tile):
    """A LAS or LAZ file; `CloudError` if it cannot be read.

    Packed points of up to 256 MiB are kept in memory; those of larger files are read at every pass.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with reading("LAS"), open_las(path) as reader:
            self.header = with_records(reader.header, path)
            self.size = int(reader.header.point_count)
        self.crs = read_crs([*self.header.vlrs, *(self.header.evlrs or ())])
        self._small = self.size * self.header.point_format.size <= _KEPT_BYTES
        self._kept: list[Any] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return tuple(self.header.point_format.dimension_names)

    def parts(self) -> Iterator[Any]:
        """Yield the points in parts, as laspy point records."""
        if self._kept is None and self._small:
            self._kept = list(self.read())
        yield from self.read() if self._kept is None else self._kept

    def read(self) -> Iterator[Any]:
        """Yield the points in parts, without keeping them in memory."""
        with reading("LAS"), open_las(self.path) as reader:
            yield from parts_of(reader)


class CloudTile(Tile):
    """A file that contains one frame, in any other format; `CloudError` if it cannot be read, or has no x, y and z."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cloud: Cloud = FRAME_READERS[path.suffix.lower()](path)
        self.size = self.cloud.size
        missing = [axis for axis in "xyz" if axis not in self.names]
        if missing:
            raise CloudError(f"no field {missing[0]!r}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fields."""
        return self.cloud.dtype.names or ()

    def parts(self) -> Iterator[Any]:
        """Yield the points in parts, as structured arrays."""
        for start in range(0, self.size, CHUNK_POINTS):
            yield self.cloud.points[start : start + CHUNK_POINTS]


def open_tile(path: Path) -> LasTile | CloudTile:
    """Open a tile of any format in `FRAME_READERS`; `InputError` if it cannot be read."""
    make: Callable[[Path], LasTile | CloudTile] = LasTile if path.suffix.lower() in (".las", ".laz") else CloudTile
    try:
        return make(path)
    except CloudError as error:
        raise InputError(f"{path}: {error}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error


def find_tiles(tiles: PathLike | Iterable[PathLike]) -> list[Path]:
    """Return the tiles that names, folders and globs refer to; a folder refers to the tiles in it.

    A tile with several names, such as a relative and an absolute path, is found once. `UsageError` if there is no such
    file or folder, `InputError` if one of the names refers to no tile.
    """
    found: dict[Path, Path] = {}
    for given in [tiles] if isinstance(tiles, str | os.PathLike) else tiles:
        pattern = os.fspath(given)
        paths = [Path(pattern)] if Path(pattern).exists() else [Path(name) for name in sorted(glob(pattern))]  # noqa: PTH207
        if not (paths or "://" in pattern or pattern.endswith(_EPT)):
            missing = "no file matches this pattern" if has_magic(pattern) else "no such file or folder"
            raise UsageError(f"{pattern}: {missing}")
        files = [file for path in paths for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
        own = [file for file in files if file.suffix.lower() in FRAME_READERS]
        if not own:
            raise InputError(f"{pattern}: {_reason(pattern, files)}")
        for file in own:
            found.setdefault(file.resolve(), file)
    return list(found.values())


def _reason(pattern: str, files: Iterable[Path]) -> str:
    """Return why a pattern refers to no tile, and what to do."""
    ept = next((str(file) for file in files if file.name == _EPT), pattern)
    if ept.startswith("ept://") or ept.endswith(_EPT):
        return f"Entwine point tiles (EPT) are not read; {_advice('readers.ept', ept)}"
    if is_url(pattern):
        part = f", or {_advice('readers.copc', pattern)}" if pattern.endswith(".copc.laz") else ""
        return f"tiles are read from local files; download it{part}"
    return f"no tile found; supported suffixes: {', '.join(FRAME_READERS)}"


def _advice(reader: str, source: str) -> str:
    bounds = "'([WEST, EAST], [SOUTH, NORTH])'"
    command = f"pdal translate -r {reader} {quote(source)} part.laz --{reader}.bounds={bounds}"
    return f"write a part of it to a file with PDAL: {command}"
