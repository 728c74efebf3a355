"""Shoreline and objects of tiles as GeoJSON and GeoPackage."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.map import total_length_m
from seaclutter_cli.airborne.objects import FoundObject, as_geojson, geodata_fields
from seaclutter_cli.errors import MissingExtraError
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.sinks.geopackage import Feature, Layer, geopackage
from seaclutter_cli.sources.crs import Crs, ToLongitudeLatitude
from seaclutter_cli.text import listed

NOT_WGS84 = "GeoJSON is in the coordinates of the tile, not in WGS 84"
LEFT_OUT = "left out of the GeoPackage, which is in WGS 84"
Lines = Sequence[NDArray[np.float64]]


@dataclass(frozen=True)
class TileGeodata:
    """Shoreline and objects of one tile.

    Parameters
    ----------
    name : str
        Name of the tile.
    crs : Crs
        Its coordinate reference system.
    shoreline : sequence of ndarray, shape (N, 2), float64
        Lines between water and land in metres.
    objects : sequence of FoundObject
        Objects with centres in the coordinates of the tile.
    """

    name: str
    crs: Crs
    shoreline: Lines
    objects: Sequence[FoundObject] = ()


def conversions(tiles: Sequence[tuple[str, Crs]], what: str, observer: Observer) -> list[ToLongitudeLatitude | None]:
    """Return the conversion of each tile's positions to WGS 84; warn of the tiles for which there is none."""
    found: list[ToLongitudeLatitude | None] = []
    without: dict[str, list[str]] = {}
    for name, crs in tiles:
        try:
            conversion, reason = crs.to_wgs84(), "its CRS is unknown"
        except MissingExtraError as error:
            conversion, reason = None, str(error)
        if conversion is None:
            without.setdefault(reason, []).append(name)
        found.append(conversion)
    for reason, names in without.items():
        observer.warn(f"{listed(names)}: {what}: {reason}")
    return found


def geojson_of(tiles: Sequence[TileGeodata], observer: Observer) -> bytes:
    """Return objects, then shorelines, as GeoJSON: in WGS 84, or in the coordinates of a tile without a known CRS."""
    ways = conversions([(tile.name, tile.crs) for tile in tiles], NOT_WGS84, observer)
    lines = chain.from_iterable(_line_features(*pair) for pair in zip(tiles, ways, strict=True))
    places = [(tile.crs.unit_m, way) for tile, way in zip(tiles, ways, strict=True)]
    return as_geojson([(tile.name, tile.objects) for tile in tiles], places, list(lines)).encode()


def _line_features(tile: TileGeodata, convert: ToLongitudeLatitude | None) -> list[dict[str, Any]]:
    digits = 3 if convert is None else 8
    return [
        {
            "type": "Feature",
            "geometry": {
                "type": "LineString",
                "coordinates": [[round(x, digits), round(y, digits)] for x, y in _placed(line, tile.crs, convert)],
            },
            "properties": {
                "coordinates": "tile" if convert is None else "WGS 84",
                "tile": tile.name,
                "kind": "shoreline",
                "length_m": round(total_length_m([line]), 1),
            },
        }
        for line in tile.shoreline
    ]


def _placed(line: NDArray[np.float64], crs: Crs, convert: ToLongitudeLatitude | None) -> list[tuple[float, float]]:
    own = line / crs.unit_m
    return [(float(x), float(y)) for x, y in (own if convert is None else convert(own))]


def geopackage_of(tiles: Sequence[TileGeodata], observer: Observer, *, classified: bool) -> bytes:
    """Return shorelines and objects as layers of a GeoPackage in WGS 84; tiles without a known CRS are left out.

    ``classified`` is whether the objects have classes.
    """
    lines: list[Feature] = []
    boxes: list[Feature] = []
    ways = conversions([(tile.name, tile.crs) for tile in tiles], LEFT_OUT, observer)
    for tile, convert in zip(tiles, ways, strict=True):
        if convert is None:
            continue
        lines += [
            (_placed(line, tile.crs, convert), (tile.name, round(total_length_m([line]), 1))) for line in tile.shoreline
        ]
        for one in tile.objects:
            ring = convert(one.corners_in(tile.crs.unit_m)).tolist()
            boxes.append(([*ring, ring[0]], (tile.name, *one.attributes.values())))
    return geopackage(
        [
            Layer("shoreline", "LINESTRING", {"tile": str, "length_m": float}, lines),
            Layer("objects", "POLYGON", {"tile": str, **geodata_fields(classified=classified)}, boxes),
        ]
    )


def check_geodata(*, shoreline: bool, package: bool) -> None:
    """Check that the libraries for geodata are installed; raise `MissingExtraError` otherwise."""
    if shoreline:
        try:
            import contourpy  # noqa: F401 - availability check
        except ImportError as error:
            raise MissingExtraError("the shoreline", "geo") from error
    if package:
        geopackage([])
