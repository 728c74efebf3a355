"""Simulated tiles as LAS or LAZ files, with the truth of every point."""

import math
from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.airborne.render import POINT, TileRenderer
from seaclutter_cli.simulation.airborne.scene import TileScene
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.las import import_laspy, las_writer
from seaclutter_cli.threads import in_order, threads

TRUTH = {"object_class": ("u1", "0 none, 1 ship ... 8 garbage"), "object_id": ("u2", "number of the object, 0 none")}
_MOST_PULSES = 300_000
_SCALE_M = 0.001
_ANGLE_UNIT_DEG = 0.006
_CREATION_DATE = date(2024, 1, 1)


def simulate_strips(scene: TileScene) -> Iterator[NDArray[np.void]]:
    """Yield the echoes of a scene strip by strip, rendered in threads; the number of threads does not change them."""
    renderer = TileRenderer(scene)
    pulses = math.prod(scene.tile.size_m) * scene.lidar.pulses_m2 / len(renderer.lines)
    workers = min(2, threads()) if pulses < _MOST_PULSES else 1  # a strip of a million takes 400 MB
    return in_order(renderer.strip, len(renderer.lines), workers=workers, ahead=workers)


def record_tile(
    scene: TileScene,
    path: Path,
    on_strip: Callable[[NDArray[np.void]], object] = lambda _: None,
    group: OutputGroup | None = None,
) -> None:
    """Write a scene to a LAS or LAZ file with point format 6.

    It appears, together with the files of the group, when it is complete. Raise `MissingExtraError` if laspy or its LAZ
    backend is not installed, `OutputError` if the file cannot be written.
    """
    laspy = import_laspy()
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, _SCALE_M)
    header.offsets = np.array([*scene.tile.origin_m, 0.0])
    header.system_identifier, header.generating_software = "simulated", "seaclutter simulate"
    header.creation_date = _CREATION_DATE
    header.uuid = UUID(int=0)
    header.global_encoding.wkt = True  # LAS 1.4 requires it from point format 6; some readers check
    empty = laspy.ScaleAwarePointRecord.zeros(0, header=header)
    with las_writer(path, header, TRUTH, whole=False, group=group) as write:
        for points in simulate_strips(scene):
            write(_record(laspy, empty, points), {name: points[name] for name in TRUTH})
            on_strip(points)


def _record(laspy: Any, empty: Any, points: NDArray[np.void]) -> Any:
    record = laspy.ScaleAwarePointRecord.zeros(
        len(points), point_format=empty.point_format, scales=empty.scales, offsets=empty.offsets
    )
    for name in POINT.names or ():
        if name not in TRUTH:
            record[name] = points[name] / _ANGLE_UNIT_DEG if name == "scan_angle" else points[name]
    return record
