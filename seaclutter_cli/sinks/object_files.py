"""Files with a table of objects: CSV, Parquet, and tracks on earth as GeoJSON."""

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

from seaclutter_cli.errors import InputError, UsageError, requiring
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.sinks.objects import COLUMNS
from seaclutter_cli.tracking.follow import CONFIRMED

_ROWS_AT_ONCE = 20_000
_STEP_NS = 1_000_000_000
_PROPERTIES = ("recording", "topic", "track_id", "class", "length_m", "width_m", "height_m")

Write = Callable[[BinaryIO, Iterable[bytes]], None]


def check_objects_file(path: Path | None) -> None:
    """Raise `UsageError` if no format has the suffix, `MissingExtraError` if a library is missing."""
    if path is None:
        return
    if path.suffix.lower() not in OBJECT_FILES:
        raise UsageError(f"{path}: a table of objects must end in {', '.join(OBJECT_FILES)}")
    if path.suffix.lower() == ".parquet":
        _pyarrow()


def write_objects(path: Path, stream: BinaryIO, lines: Iterable[bytes]) -> None:
    """Write the lines of a table, without its head, to a file in the format of its name."""
    OBJECT_FILES[path.suffix.lower()](stream, lines)


def parsed(lines: Iterable[bytes]) -> Iterator[list[Any]]:
    """Yield the values of the rows of a table, given its lines; None for empty cells of numbers."""
    kinds = list(COLUMNS.values())
    for row in csv.reader(line.decode(errors="surrogateescape") for line in lines):
        yield [kind(cell) if cell or kind is str else None for kind, cell in zip(kinds, row, strict=True)]


def rows_as_mappings(lines: Iterable[bytes]) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table by column, given its lines."""
    return (dict(zip(COLUMNS, values, strict=True)) for values in parsed(lines))


def _write_csv(stream: BinaryIO, lines: Iterable[bytes]) -> None:
    stream.write(csv_line(COLUMNS))
    stream.writelines(lines)


def _pyarrow() -> Any:
    with requiring("Parquet", "parquet"):
        import pyarrow.parquet  # takes 0.3 s, rarely needed
    return pyarrow


def _write_parquet(stream: BinaryIO, lines: Iterable[bytes]) -> None:
    arrow = _pyarrow()
    types = {str: arrow.string(), int: arrow.int64(), float: arrow.float64()}
    schema = arrow.schema([(name, types[kind]) for name, kind in COLUMNS.items()])
    rows = parsed(lines)
    with arrow.parquet.ParquetWriter(stream, schema) as writer:
        while block := list(islice(rows, _ROWS_AT_ONCE)):
            columns = [
                [value.encode(errors="replace").decode() for value in column] if kind is str else list(column)
                for kind, column in zip(COLUMNS.values(), zip(*block, strict=True), strict=True)
            ]
            arrays = [arrow.array(column, field.type) for column, field in zip(columns, schema, strict=True)]
            writer.write_table(arrow.Table.from_arrays(arrays, schema=schema))


def _write_geojson(stream: BinaryIO, lines: Iterable[bytes]) -> None:
    """Write the tracks that were confirmed and whose positions on earth are known, with a position each second."""
    tracks: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in rows_as_mappings(lines):
        if row["latitude_deg"] is None or row["state"] != CONFIRMED:
            continue
        key = row["recording"], row["topic"], row["track_id"]
        track = tracks.setdefault(key, {"stamps": [], "places": [], "speeds": []})
        track |= {name: row[name] for name in _PROPERTIES}
        if not track["stamps"] or row["stamp_ns"] - track["stamps"][-1] >= _STEP_NS:
            track["stamps"].append(row["stamp_ns"])
            track["places"].append([row["longitude_deg"], row["latitude_deg"]])
            track["speeds"].append(row["speed_ms"])
    if not tracks:
        raise InputError(
            "GeoJSON: no position on earth is known; the log needs sensor_msgs/NavSatFix and sensor_msgs/Imu with the "
            "heading, or /tf from the lidar to the frame earth"
        )
    features = [_feature(track) for track in tracks.values()]
    stream.write(json.dumps({"type": "FeatureCollection", "features": features}).encode() + b"\n")


def _feature(track: Mapping[str, Any]) -> dict[str, Any]:
    places = track["places"]
    geometry = {"type": "LineString", "coordinates": places}
    if len(places) == 1:
        geometry = {"type": "Point", "coordinates": places[0]}
    named = {name: track[name] for name in _PROPERTIES}
    return {
        "type": "Feature",
        "geometry": geometry,
        "properties": {**named, "stamps_ns": track["stamps"], "speeds_ms": track["speeds"]},
    }


OBJECT_FILES: Mapping[str, Write] = {".csv": _write_csv, ".parquet": _write_parquet, ".geojson": _write_geojson}
"""Writers by the suffixes of files. To add a format, add a line here."""
