"""Tiles of an airborne survey: one file each, found by name and read in parts, and the reference systems of LAS."""

import os
import re
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from glob import glob, has_magic
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError, InputError, UsageError, opening, requiring
from seaclutter_cli.frame import Frame
from seaclutter_cli.sources.frame_files import FRAME_READERS
from seaclutter_cli.sources.frame_files.las import CHUNK_POINTS, open_las, parts_of, with_records
from seaclutter_cli.sources.frame_files.reading import reading
from seaclutter_cli.urls import PathLike, is_url

if TYPE_CHECKING:
    from seaclutter_cli.cloud import Cloud

Columns = dict[str, NDArray[Any]]

LAS = (".las", ".laz")
_KEPT_BYTES = 1 << 28
_PIECE_POINTS = 1 << 17
_EPT = "ept.json"
"""File that describes a set of Entwine point tiles, in their folder."""

_USER = "LASF_Projection"
_WKT, _GEO_KEYS = 2112, 34735
_MODEL_TYPE, _PROJECTED_CRS, _LINEAR_UNIT, _VERTICAL_UNIT = 1024, 3072, 3076, 4099
_GEOGRAPHIC = 2
_UNITS_M = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}
_UNIT = re.compile(r'\b(?:LENGTH)?UNIT\s*\[\s*"[^"]*"\s*,\s*([0-9.eE+-]+)')
_CODE = re.compile(r'\b(?:AUTHORITY|ID)\s*\[\s*"EPSG"\s*,\s*"?(\d+)"?\s*\]\s*\]\s*$')
_PROJECTED = re.compile(r"\bPROJ(?:CS|CRS|ECTEDCRS)\s*\[")
_GEODETIC = re.compile(r"\b(?:GEOGCS|GEOGCRS|GEODCRS|GEOGRAPHICCRS|GEODETICCRS)\s*\[")
_SYSTEM = re.compile(r"^\w+\s*\[")
_VERTICAL = re.compile(r"\bVERT(?:CRS|_CS|ICALCRS)\s*\[")

ToLongitudeLatitude = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Function from positions in a tile to longitude and latitude in degrees; both have the shape (N, 2)."""


@dataclass(frozen=True)
class Crs:
    """Coordinate reference system of a tile: WKT or ``EPSG:NUMBER``, empty if unknown, and units in metres."""

    definition: str = ""
    unit_m: float = 1.0
    height_unit_m: float = 1.0
    is_geographic: bool = False

    @property
    def by_code(self) -> "Crs":
        """The same system, defined by its EPSG code if it has one: WKT and GeoTIFF keys may state the same system."""
        found = _CODE.search(self.definition)
        return replace(self, definition=f"EPSG:{found[1]}") if found else self

    def to_wgs84(self) -> ToLongitudeLatitude | None:
        """Return the conversion to longitude and latitude, which needs pyproj; None if the system is not known."""
        if not self.definition:
            return None
        with requiring("GeoJSON in WGS 84", "geo"):
            import pyproj  # an extra
        try:
            source = pyproj.CRS.from_user_input(self.definition)
            transformer = pyproj.Transformer.from_crs(source, "EPSG:4326", always_xy=True)
        except pyproj.exceptions.ProjError:
            return None
        return lambda xy: np.stack(transformer.transform(xy[:, 0], xy[:, 1]), axis=1)


def read_crs(records: Iterable[Any]) -> Crs:
    """Return the coordinate reference system in the variable length records of a LAS file, WKT before GeoTIFF keys."""
    found = {one.record_id: bytes(one.record_data) for one in records if one.user_id == _USER}
    text = found.get(_WKT, b"").split(b"\0")[0].decode("utf-8", "replace").strip()
    if _SYSTEM.match(text):  # some files have an empty text in quotation marks
        is_geographic = _PROJECTED.search(text) is None and _GEODETIC.search(text) is not None
        horizontal, *vertical = _VERTICAL.split(text, maxsplit=1)
        unit_m = 1.0 if is_geographic else _last_unit(horizontal, 1.0)
        return Crs(text, unit_m, _last_unit(vertical[0], unit_m) if vertical else unit_m, is_geographic)
    data = found.get(_GEO_KEYS, b"")
    keys = {key: value for key, at, _, value in struct.iter_unpack("<4H", data[8 : len(data) // 8 * 8]) if at == 0}
    unit_m = _UNITS_M.get(keys.get(_LINEAR_UNIT, 0), 1.0)
    code = keys.get(_PROJECTED_CRS, 0)
    definition = f"EPSG:{code}" if 1024 <= code < 32767 else ""
    is_geographic = keys.get(_MODEL_TYPE) == _GEOGRAPHIC
    return Crs(definition, unit_m, _UNITS_M.get(keys.get(_VERTICAL_UNIT, 0), unit_m), is_geographic)


def _last_unit(text: str, default: float) -> float:
    """Return the last unit in a part of WKT, which is that of its axes: units of parameters come before."""
    units = [float(number) for number in _UNIT.findall(text) if re.fullmatch(r"[0-9.]+(?:[eE][+-]?\d+)?", number)]
    return units[-1] if units and units[-1] > 0 else default


class Tile(ABC):
    """The points of one file, in a fixed order: `seaclutter_cli.interfaces.TilePoints`."""

    path: Path
    size: int
    names: tuple[str, ...]
    """Names of the points' fields."""
    crs = Crs()
    intensity_name: str | None = "intensity"
    """Name of the intensity field, by default that of LAS; None without."""

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


class LasTile(Tile):
    """A LAS or LAZ file; `CloudError` if it cannot be read.

    Packed points of up to 256 MiB are kept in memory; those of larger files are read at every pass.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with reading("LAS"), open_las(path) as reader:
            self.header = with_records(reader.header, path)
            self.size = int(reader.header.point_count)
        self.names = tuple(self.header.point_format.dimension_names)
        self.crs = read_crs([*self.header.vlrs, *(self.header.evlrs or ())])
        self._small = self.size * self.header.point_format.size <= _KEPT_BYTES
        self._kept: list[Any] | None = None

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
        self.size, self.intensity_name = self.cloud.size, Frame(self.cloud).intensity_name
        self.names = self.cloud.dtype.names or ()
        if missing := [axis for axis in "xyz" if axis not in self.names]:
            raise CloudError(f"no field {missing[0]!r}")

    def parts(self) -> Iterator[Any]:
        """Yield the points in parts, as structured arrays."""
        for start in range(0, self.size, CHUNK_POINTS):
            yield self.cloud.points[start : start + CHUNK_POINTS]


def open_tile(path: Path) -> LasTile | CloudTile:
    """Open a tile of any format in `FRAME_READERS`; `InputError` if it cannot be read."""
    make: Callable[[Path], LasTile | CloudTile] = LasTile if path.suffix.lower() in LAS else CloudTile
    with opening(path, problem="cannot be read"):
        return make(path)


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
    if pattern.startswith("ept://") or pattern.endswith(_EPT) or any(file.name == _EPT for file in files):
        return "Entwine point tiles (EPT) are not read; write a part of them to a file, as with pdal translate"
    if is_url(pattern):
        return "tiles are read from local files; download it, or a part of it, as with pdal translate"
    return f"no tile found; supported suffixes: {', '.join(FRAME_READERS)}"
