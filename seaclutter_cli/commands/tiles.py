"""What the commands for airborne tiles share: which tiles, where the output goes, and writing them."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seaclutter_cli.commands.outputs import refuse_replacing, refuse_twice
from seaclutter_cli.errors import UsageError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seaclutter_cli.sinks.las import ExtraDims
    from seaclutter_cli.sources.tiles import CloudTile, LasTile

_LAS = (".las", ".laz")


def plan_tiles(
    tiles: Sequence[Path], output: Path, further: Sequence[Path] = (), inputs: Sequence[Path] = (), *, force: bool
) -> list[Path]:
    """Return the file for each tile: ``output`` itself for one, files of the tiles' names in it for several.

    Parameters
    ----------
    tiles : sequence of Path
        Tiles that are read.
    output : Path
        From the command line.
    further, inputs : sequence of Path, optional
        What else will be written, and what else is read.
    force : bool
        Whether files may be replaced.

    Raises
    ------
    UsageError
        If an output is an input, exists and may not be replaced, would be written twice, or is of a format that the
        tile cannot become.
    """
    from seaclutter_cli.sinks.points import POINT_WRITERS

    into_folder = len(tiles) > 1 or output.is_dir() or str(output).endswith((os.sep, "/"))
    targets = [output / tile.name for tile in tiles] if into_folder else [output]
    if into_folder:  # formats that are only read
        targets = [t if t.suffix.lower() in (*_LAS, *POINT_WRITERS) else t.with_suffix(".pcd") for t in targets]
    if len(set(targets)) < len(targets):
        raise UsageError(f"{output}: two tiles have the same name; write them one by one")
    refuse_twice([*targets, *further])
    refuse_replacing([*targets, *further], [*tiles, *inputs], force=force)
    for tile, target in zip(tiles, targets, strict=True):
        _check_format(tile, target)
    return targets


def _check_format(tile: Path, target: Path) -> None:
    from seaclutter_cli.sinks.points import POINT_WRITERS

    suffix = target.suffix.lower()
    if suffix not in (*_LAS, *POINT_WRITERS):
        raise UsageError(f"{target}: tiles are written as {', '.join((*_LAS, *POINT_WRITERS))}")
    if suffix in _LAS and tile.suffix.lower() not in _LAS:
        raise UsageError(f"{target}: only LAS and LAZ tiles become LAS or LAZ; write {', '.join(POINT_WRITERS)}")


def write_tile(
    tile: "LasTile | CloudTile", target: Path, columns: "Mapping[str, NDArray[Any]]", extra: "ExtraDims"
) -> None:
    """Write a tile with other or more columns; all else stays as it is."""
    from seaclutter_cli.sinks.las import write_las
    from seaclutter_cli.sinks.points import POINT_WRITERS, with_columns
    from seaclutter_cli.sources.frame_files import FRAME_READERS
    from seaclutter_cli.sources.tiles import LasTile

    if isinstance(tile, LasTile) and target.suffix.lower() in _LAS:
        write_las(target, tile.header, tile.parts(), columns, extra)
        return
    cloud = FRAME_READERS[tile.path.suffix.lower()](tile.path) if isinstance(tile, LasTile) else tile.cloud
    POINT_WRITERS[target.suffix.lower()](target, with_columns(cloud, columns))
