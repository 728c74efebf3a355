"""Maps of tiles: pictures, and shoreline and objects as GeoJSON and GeoPackage."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.map import IS_LAND, IS_OBJECT, TileMap, map_of, shoreline_of, total_length_m
from seaclutter_cli.airborne.objects import (
    FoundObject,
    ObjectFindingParams,
    as_geojson,
    geodata_fields,
    unclassified_objects,
)
from seaclutter_cli.airborne.separation import SeaState, Separation
from seaclutter_cli.errors import MissingExtraError
from seaclutter_cli.plots.figure import check_target, render
from seaclutter_cli.plots.tiles import MapPart, aspect_of, draw_map
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.tiles import MapOptions
from seaclutter_cli.sinks.geopackage import Feature, Layer, geopackage
from seaclutter_cli.sources.crs import Crs, ToLongitudeLatitude
from seaclutter_cli.sources.extents import TileHead
from seaclutter_cli.sources.tiles import CloudTile, LasTile, TilePointReader
from seaclutter_cli.text import listed

_NOT_WGS84 = "GeoJSON is in the coordinates of the tile, not in WGS 84"
_LEFT_OUT = "left out of the GeoPackage, which is in WGS 84"
_PIXELS = 1000


def check_maps(options: MapOptions) -> None:
    """Check names and libraries before a run."""
    if options.plot_file:
        check_target(options.plot_file)
    check_geodata(shoreline=options.wanted, package=options.gpkg_file is not None)


def pixel_of(tiles: Sequence[TileHead]) -> float:
    """Return the width of a pixel of the picture of all tiles in metres; 0 if it is not known from headers."""
    extents = [tile.extent for tile in tiles if tile.extent]
    if not extents:
        return 0.0
    low, high = np.min([one.low for one in extents], axis=0), np.max([one.high for one in extents], axis=0)
    return float((high - low).max()) / _PIXELS


@dataclass(frozen=True)
class DrawnTile:
    """One tile of the maps of a run: its part of the picture, and its geodata."""

    part: MapPart = field(repr=False)
    geodata: "TileGeodata" = field(repr=False)


def shoreline_in(tile: LasTile | CloudTile, found: Separation) -> list[NDArray[np.float64]]:
    """Return the shoreline of a separated tile in metres."""
    return shoreline_of(map_of(TilePointReader(tile), found, found.land.cell_m))


def drawn(
    tile: LasTile | CloudTile, found: Separation, name: str, pixel_m: float, params: ObjectFindingParams | None
) -> DrawnTile:
    """Return the map of a separated tile with pixels of about a width in metres; 0: as its own size requires.

    ``params`` are those of the search for objects; None: they are not searched for.
    """
    points = TilePointReader(tile)
    fine = map_of(points, found, found.land.cell_m)
    lines = shoreline_of(fine)
    objects = [] if params is None else unclassified_objects(points, found, fine, params)
    placed = [one.placed(tile.crs.unit_m) for one in objects]
    width = pixel_m or max(fine.kind.shape) * fine.cell_m / _PIXELS
    return DrawnTile(_part(fine.coarser(width), lines), TileGeodata(name, tile.crs, lines, placed))


def _part(one: TileMap, lines: Sequence[NDArray[np.float64]]) -> MapPart:
    low = np.array(one.first) * one.cell_m
    high = low + np.array(one.kind.shape) * one.cell_m
    (west, south), (east, north) = low.tolist(), high.tolist()
    return MapPart((west, south), (east, north), one.level_m, one.kind == IS_LAND, one.kind == IS_OBJECT, lines)


def map_files(
    options: MapOptions, tiles: Sequence[DrawnTile], seas: Sequence[SeaState], observer: Observer
) -> dict[Path, bytes]:
    """Return the contents of the maps of a run by their paths."""
    files: dict[Path, bytes] = {}
    if not tiles:
        return files
    geodata = [tile.geodata for tile in tiles]
    if not any(tile.shoreline for tile in geodata) and (options.geojson_file or options.gpkg_file):
        observer.note("no shoreline: water and land do not meet in these tiles")
    if options.geojson_file:
        files[options.geojson_file] = geojson_of(geodata, observer)
    if options.gpkg_file:
        files[options.gpkg_file] = geopackage_of(geodata, observer, classified=False)
    if options.plot_file:
        systems = {tile.crs.by_code for tile in geodata}
        if len(systems) > 1:
            observer.warn(
                f"{options.plot_file}: shows tiles with {len(systems)} coordinate reference systems as one map"
            )
        parts, title = [tile.part for tile in tiles], waves_line(seas)
        suffix = options.plot_file.suffix
        files[options.plot_file] = render(lambda it: draw_map(it, parts, title), suffix, aspect=aspect_of(parts))
    return files


def waves_line(seas: Sequence[SeaState]) -> str:
    """Return a line about the waves of tiles."""
    known = [(sea.wave_height_m, sea.wave_length_m) for sea in seas if sea.wave_height_m is not None]
    if not known:
        return "No waves found"
    heights, lengths = (sorted(float(value or 0) for value in values) for values in zip(*known, strict=True))
    return f"Waves {_range(heights, 1)} high, {_range(lengths, 0)} long"


def _range(values: Sequence[float], digits: int) -> str:
    low, high = (f"{value:.{digits}f} m" for value in (values[0], values[-1]))
    return low if low == high else f"{low.removesuffix(' m')} to {high}"


@dataclass(frozen=True)
class TileGeodata:
    """Shoreline in metres and objects of one tile, with centres in its coordinates.

    The lines between water and land have shape (N, 2), float64.
    """

    name: str
    crs: Crs
    shoreline: Sequence[NDArray[np.float64]]
    objects: Sequence[FoundObject] = ()


def _conversions(tiles: Sequence[tuple[str, Crs]], what: str, observer: Observer) -> list[ToLongitudeLatitude | None]:
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
    ways = _conversions([(tile.name, tile.crs) for tile in tiles], _NOT_WGS84, observer)
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
    ways = _conversions([(tile.name, tile.crs) for tile in tiles], _LEFT_OUT, observer)
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
