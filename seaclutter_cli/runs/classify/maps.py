"""Maps of tiles: pictures, and shoreline and objects as GeoJSON."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.airborne.map import IS_LAND, IS_OBJECT, length_m, map_of, shoreline_of
from seaclutter_cli.airborne.objects import FoundObject, ObjectFindingParams, unclassified_objects
from seaclutter_cli.airborne.separation import SeaState, Separation
from seaclutter_cli.arrays import Floats
from seaclutter_cli.errors import MissingExtraError
from seaclutter_cli.plots.figure import render
from seaclutter_cli.plots.tiles import MapPart, aspect_of, draw_map
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.classifiers import SeparateTilesOptions
from seaclutter_cli.sources.extents import TileHead
from seaclutter_cli.sources.tiles import CloudTile, Crs, LasTile, ToLongitudeLatitude
from seaclutter_cli.text import listed

_PIXELS = 1000


def pixel_of(tiles: Sequence[TileHead]) -> float:
    """Return the width of a pixel of the picture of all tiles in metres; 0 if it is not known from headers."""
    if not (extents := [tile.extent for tile in tiles if tile.extent]):
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
    shoreline: Sequence[Floats] = ()
    objects: Sequence[FoundObject] = ()
    part: MapPart | None = field(default=None, repr=False)
    sea: SeaState | None = None


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


def map_files(options: SeparateTilesOptions, tiles: Sequence[MappedTile], observer: Observer) -> dict[Path, bytes]:
    """Return the contents of the maps of a run by their paths."""
    files: dict[Path, bytes] = {}
    if not tiles:
        return files
    if options.geojson_file:
        if not any(tile.shoreline for tile in tiles):
            observer.note("no shoreline: water and land do not meet in these tiles")
        files[options.geojson_file] = geojson_of(tiles, observer)
    if options.plot_file:
        if len(systems := {tile.crs.by_code for tile in tiles}) > 1:
            text = f"shows tiles with {len(systems)} coordinate reference systems as one map"
            observer.warn(f"{options.plot_file}: {text}")
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


def geojson_of(tiles: Sequence[MappedTile], observer: Observer) -> bytes:
    """Return objects, then shorelines, as GeoJSON: in WGS 84, or in the coordinates of a tile without a known CRS."""
    objects: list[dict[str, Any]] = []
    shorelines: list[dict[str, Any]] = []
    without: dict[str, list[str]] = {}
    for tile in tiles:
        try:
            convert, reason = tile.crs.to_wgs84(), "its CRS is unknown"
        except MissingExtraError as error:
            convert, reason = None, str(error)
        if convert is None:
            without.setdefault(reason, []).append(tile.name)
        origin = {"coordinates": "WGS 84" if convert else "tile", "tile": tile.name}
        for one in tile.objects:
            corners = one.corners(tile.crs.unit_m)
            ring = _places(np.concatenate((corners, corners[:1])), convert)
            objects.append(_feature("Polygon", [ring], {**origin, **one.attributes}))
        for line in tile.shoreline:
            properties = {**origin, "kind": "shoreline", "length_m": round(length_m(line), 1)}
            shorelines.append(_feature("LineString", _places(line / tile.crs.unit_m, convert), properties))
    for reason, names in without.items():
        observer.warn(f"{listed(names)}: GeoJSON is in the coordinates of the tile, not in WGS 84: {reason}")
    return json.dumps({"type": "FeatureCollection", "features": [*objects, *shorelines]}).encode()


def _feature(kind: str, places: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": places}, "properties": properties}


def _places(positions: Floats, convert: ToLongitudeLatitude | None) -> list[list[float]]:
    found, digits = (convert(positions), 8) if convert else (positions, 3)
    return [[round(x, digits), round(y, digits)] for x, y in found.tolist()]
