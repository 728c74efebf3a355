"""Coordinate reference systems of LAS files: unit of lengths, and conversion to WGS 84."""

import re
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import MissingExtraError

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
        try:
            import pyproj  # an extra
        except ImportError as error:
            raise MissingExtraError("GeoJSON in WGS 84", "geo") from error
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
