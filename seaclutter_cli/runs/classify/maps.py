"""Maps of tiles: pictures, and shoreline and objects as GeoJSON and GeoPackage."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.map import IS_LAND, IS_OBJECT, map_of, shoreline_of, total_length_m
from seaclutter_cli.airborne.objects import FoundObject, ObjectFindingParams, geodata_fields, unclassified_objects
from seaclutter_cli.airborne.separation import SeaState, Separation
from seaclutter_cli.errors import MissingExtraError, requiring
from seaclutter_cli.plots.figure import render
from seaclutter_cli.plots.tiles import MapPart, aspect_of, draw_map
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.classifiers import MapOptions
from seaclutter_cli.sources.extents import TileHead
from seaclutter_cli.sources.tiles import CloudTile, Crs, LasTile, ToLongitudeLatitude
from seaclutter_cli.text import listed

_WGS84 = 4326
_NEVER_CHANGED = "1970-01-01T00:00:00.000Z"
_TYPES = {str: "TEXT", int: "INTEGER", float: "DOUBLE"}


Feature = tuple[Sequence[tuple[float, float]], Sequence[Any]]
"""Longitudes and latitudes of a line, or of the outline of a polygon, and its attributes."""


Layer = tuple[Mapping[str, type], Sequence[Feature]]
"""Layer of a GeoPackage: the type of each attribute, str, int or float, and its features."""

_SHAPES = {"shoreline": "LINESTRING", "objects": "POLYGON"}


def geopackage(layers: Mapping[str, Layer]) -> bytes:
    """Return a GeoPackage with some of the layers in `_SHAPES`, the same bytes for the same layers.

    `MissingExtraError` if fudgeo is not installed.
    """
    with requiring("GeoPackage", "geo"):
        from fudgeo.geometry import LineString, Polygon
        from fudgeo.geopkg import Field, MemoryGeoPackage
    package = MemoryGeoPackage.create(flavor="EPSG")
    try:
        system = package.spatial_references[_WGS84]
        for layer, (types, features) in layers.items():
            fields = [Field(name, _TYPES[kind]) for name, kind in types.items()]
            package.create_feature_class(
                layer, system, shape_type=_SHAPES[layer], fields=fields, geom_name="geom", spatial_index=True
            )
            make = LineString if layer == "shoreline" else lambda ring, srs_id: Polygon([ring], srs_id=srs_id)
            columns = ", ".join(f'"{name}"' for name in ("geom", *types))
            marks = ", ".join("?" * (1 + len(types)))
            rows = [(make(list(ring), srs_id=_WGS84), *values) for ring, values in features]
            package.connection.executemany(f'INSERT INTO "{layer}" ({columns}) VALUES ({marks})', rows)  # noqa: S608 - own names
        package.connection.execute("UPDATE gpkg_contents SET last_change = ?", (_NEVER_CHANGED,))
        package.connection.commit()
        return bytes(package.connection.serialize())
    finally:
        package.connection.close()


_PIXELS = 1000


def check_maps(*, shoreline: bool, package: bool) -> None:
    """Check the libraries for maps before a run."""
    if shoreline:
        with requiring("the shoreline", "geo"):
            import contourpy  # noqa: F401 - availability check
    if package:
        geopackage({})


def pixel_of(tiles: Sequence[TileHead]) -> float:
    """Return the width of a pixel of the picture of all tiles in metres; 0 if it is not known from headers."""
    extents = [tile.extent for tile in tiles if tile.extent]
    if not extents:
        return 0.0
    low, high = np.min([one.low for one in extents], axis=0), np.max([one.high for one in extents], axis=0)
    return float((high - low).max()) / _PIXELS


@dataclass(frozen=True)
class MappedTile:
    """Shoreline in metres and objects of one tile, with centres in its coordinates, and what a picture shows of it.

    The lines between water and land have shape (N, 2), float64. There is no picture of classified tiles.
    """

    name: str
    crs: Crs
    shoreline: Sequence[NDArray[np.float64]] = ()
    objects: Sequence[FoundObject] = ()
    part: MapPart | None = field(default=None, repr=False)
    sea: SeaState | None = None


def shoreline_in(tile: LasTile | CloudTile, found: Separation) -> list[NDArray[np.float64]]:
    """Return the shoreline of a separated tile in metres."""
    return shoreline_of(map_of(tile, found, found.land.cell_m))


def mapped(
    tile: LasTile | CloudTile, found: Separation, name: str, pixel_m: float, params: ObjectFindingParams | None
) -> MappedTile:
    """Return the map of a separated tile with pixels of about a width in metres; 0: as its own size requires.

    ``params`` are those of the search for objects; None: they are not searched for.
    """
    fine = map_of(tile, found, found.land.cell_m)
    lines = shoreline_of(fine)
    objects = [] if params is None else unclassified_objects(tile, found, fine, params)
    placed = [one.placed(tile.crs.unit_m) for one in objects]
    drawn = fine.coarser(pixel_m or max(fine.kind.shape) * fine.cell_m / _PIXELS)
    low = np.array(drawn.first) * drawn.cell_m
    (west, south), (east, north) = low.tolist(), (low + np.array(drawn.kind.shape) * drawn.cell_m).tolist()
    kinds = drawn.kind == IS_LAND, drawn.kind == IS_OBJECT
    part = MapPart((west, south), (east, north), drawn.level_m, *kinds, lines)
    return MappedTile(name, tile.crs, lines, placed, part, found.sea)


def map_files(options: MapOptions, tiles: Sequence[MappedTile], observer: Observer) -> dict[Path, bytes]:
    """Return the contents of the maps of a run by their paths."""
    files: dict[Path, bytes] = {}
    if not tiles:
        return files
    if not any(tile.shoreline for tile in tiles) and (options.geojson_file or options.gpkg_file):
        observer.note("no shoreline: water and land do not meet in these tiles")
    if options.geojson_file:
        files[options.geojson_file] = geojson_of(tiles, observer)
    if options.gpkg_file:
        files[options.gpkg_file] = geopackage_of(tiles, observer, classified=False)
    if options.plot_file:
        systems = {tile.crs.by_code for tile in tiles}
        if len(systems) > 1:
            observer.warn(
                f"{options.plot_file}: shows tiles with {len(systems)} coordinate reference systems as one map"
            )
        parts = [tile.part for tile in tiles if tile.part]
        title = waves_line([tile.sea for tile in tiles if tile.sea])
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


def _conversions(tiles: Sequence[MappedTile], what: str, observer: Observer) -> list[ToLongitudeLatitude | None]:
    """Return the conversion of each tile's positions to WGS 84; warn of the tiles for which there is none."""
    found: list[ToLongitudeLatitude | None] = []
    without: dict[str, list[str]] = {}
    for tile in tiles:
        try:
            conversion, reason = tile.crs.to_wgs84(), "its CRS is unknown"
        except MissingExtraError as error:
            conversion, reason = None, str(error)
        if conversion is None:
            without.setdefault(reason, []).append(tile.name)
        found.append(conversion)
    for reason, names in without.items():
        observer.warn(f"{listed(names)}: {what}: {reason}")
    return found


_Feature = tuple[str, NDArray[np.float64], dict[str, Any]]
"""Layer, ``objects`` or ``shoreline``, with positions of shape (N, 2), those of objects closed, and attributes."""


def _features(tile: MappedTile, convert: ToLongitudeLatitude | None) -> Iterator[_Feature]:
    """Yield objects and shorelines in the coordinates of a tile, or converted."""
    for one in tile.objects:
        corners = one.corners_in(tile.crs.unit_m)
        ring = np.concatenate((corners, corners[:1]))
        yield "objects", ring if convert is None else convert(ring), one.attributes
    for line in tile.shoreline:
        places = line / tile.crs.unit_m
        length = {"length_m": round(total_length_m([line]), 1)}
        yield "shoreline", places if convert is None else convert(places), length


def geojson_of(tiles: Sequence[MappedTile], observer: Observer) -> bytes:
    """Return objects, then shorelines, as GeoJSON: in WGS 84, or in the coordinates of a tile without a known CRS."""
    features = []
    ways = _conversions(tiles, "GeoJSON is in the coordinates of the tile, not in WGS 84", observer)
    for tile, convert in zip(tiles, ways, strict=True):
        digits, known = (3, "tile") if convert is None else (8, "WGS 84")
        for layer, positions, values in _features(tile, convert):
            places = [[round(x, digits), round(y, digits)] for x, y in positions.tolist()]
            geometry = {"type": "Polygon", "coordinates": [places]}
            properties = {"coordinates": known, "tile": tile.name, **values}
            if layer == "shoreline":
                geometry = {"type": "LineString", "coordinates": places}
                properties = {"coordinates": known, "tile": tile.name, "kind": layer, **values}
            features.append((layer, {"type": "Feature", "geometry": geometry, "properties": properties}))
    ordered = [feature for _, feature in sorted(features, key=itemgetter(0))]
    return json.dumps({"type": "FeatureCollection", "features": ordered}).encode()


def geopackage_of(tiles: Sequence[MappedTile], observer: Observer, *, classified: bool) -> bytes:
    """Return shorelines and objects as layers of a GeoPackage in WGS 84; tiles without a known CRS are left out.

    ``classified`` is whether the objects have classes.
    """
    layers: dict[str, tuple[dict[str, type], list[Feature]]] = {
        "shoreline": ({"tile": str, "length_m": float}, []),
        "objects": ({"tile": str, **geodata_fields(classified=classified)}, []),
    }
    ways = _conversions(tiles, "left out of the GeoPackage, which is in WGS 84", observer)
    for tile, convert in zip(tiles, ways, strict=True):
        for layer, positions, values in _features(tile, convert) if convert else ():
            layers[layer][1].append((positions.tolist(), (tile.name, *values.values())))
    return geopackage(layers)
