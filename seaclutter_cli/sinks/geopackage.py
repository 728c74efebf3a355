"""GeoPackage files with lines and polygons in WGS 84."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from seaclutter_cli.errors import MissingExtraError

_WGS84 = 4326
_NEVER_CHANGED = "1970-01-01T00:00:00.000Z"
_TYPES = {str: "TEXT", int: "INTEGER", float: "DOUBLE"}


Feature = tuple[Sequence[tuple[float, float]], Sequence[Any]]
"""Longitudes and latitudes of a line, or of the outline of a polygon, and its attributes."""


@dataclass(frozen=True)
class Layer:
    """Layer of a GeoPackage: lines or polygons, and the type of each of their attributes: str, int or float."""

    name: str
    shape: Literal["LINESTRING", "POLYGON"]
    fields: Mapping[str, type]
    features: Sequence[Feature]


def geopackage(layers: Sequence[Layer]) -> bytes:
    """Return a GeoPackage, the same bytes for the same layers; `MissingExtraError` if fudgeo is not installed."""
    try:
        from fudgeo.geometry import LineString, Polygon
        from fudgeo.geopkg import Field, MemoryGeoPackage
    except ImportError as error:
        raise MissingExtraError("GeoPackage", "geo") from error
    package = MemoryGeoPackage.create(flavor="EPSG")
    try:
        system = package.spatial_references[_WGS84]
        for layer in layers:
            fields = [Field(name, _TYPES[kind]) for name, kind in layer.fields.items()]
            package.create_feature_class(
                layer.name, system, shape_type=layer.shape, fields=fields, geom_name="geom", spatial_index=True
            )
            make = LineString if layer.shape == "LINESTRING" else lambda ring, srs_id: Polygon([ring], srs_id=srs_id)
            columns = ", ".join(f'"{name}"' for name in ("geom", *layer.fields))
            marks = ", ".join("?" * (1 + len(layer.fields)))
            rows = [(make(list(ring), srs_id=_WGS84), *values) for ring, values in layer.features]
            package.connection.executemany(f'INSERT INTO "{layer.name}" ({columns}) VALUES ({marks})', rows)  # noqa: S608 - own names
        package.connection.execute("UPDATE gpkg_contents SET last_change = ?", (_NEVER_CHANGED,))
        package.connection.commit()
        return bytes(package.connection.serialize())
    finally:
        package.connection.close()
