"""Tiles that are processed together: which of them are neighbours, and the margins that they share."""

from collections.abc import Sequence
from pathlib import Path

from seaclutter_cli.errors import CloudError, InputError, UsageError
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.sources.crs import Crs
from seaclutter_cli.sources.extents import (
    Margin,
    PointsWithMargin,
    TileHead,
    is_indexed,
    neighbors_of,
    read_head,
    read_margin,
    region_of,
    windows_of,
)
from seaclutter_cli.sources.tiles import CloudTile, LasTile, TilePointReader
from seaclutter_cli.text import count
from seaclutter_cli.threads import in_threads


def tiles_of(paths: Sequence[Path], window_m: float | None, observer: Observer) -> list[TileHead]:
    """Return the tiles in files: whole ones, or with ``window_m`` the windows of that width in COPC files.

    Raises
    ------
    UsageError
        If there are to be windows, but no COPC file.
    InputError
        If the index of a COPC file is damaged.
    """
    if window_m is None:
        return in_threads(read_head, paths) if len(paths) > 1 else [TileHead(path, Crs(), None) for path in paths]
    heads: list[TileHead] = []
    for path in paths:
        try:
            heads += windows_of(path, window_m) if is_indexed(path) else [read_head(path)]
        except CloudError as error:
            raise InputError(f"{path}: {error}") from error
    whole = [head.path.name for head in heads if not head.window]
    if len(whole) == len(heads):
        raise UsageError("--window: only COPC files can be read by window, and no TILE is one")
    if whole:
        observer.warn(f"not read by window, because only COPC files can be: {', '.join(whole)}")
    return heads


def margins_of(heads: Sequence[TileHead], margin_m: float, observer: Observer) -> list[Margin | None]:
    """Return the margin of each tile, wider around small ones; None for those without neighbours, or a width of 0."""
    if len(heads) < 2 or margin_m <= 0:
        return [None] * len(heads)
    systems = {head.crs.by_code for head in heads if head.extent}
    if len(systems) > 1:
        observer.warn(f"tiles have {len(systems)} coordinate reference systems; margins come from tiles with the same")
    found = neighbors_of(heads, margin_m)
    pairs = sum(map(len, found)) // 2
    observer.note(f"{count(len(heads), 'tile')}, {count(pairs, 'pair')} of neighbours", detail=True)
    return [_margin(*pair, margin_m) for pair in zip(heads, found, strict=True)]


def _margin(head: TileHead, neighbors: Sequence[TileHead], margin_m: float) -> Margin | None:
    region = region_of(head, margin_m)
    if region is None or not neighbors:
        return None
    return Margin(region, tuple(dict.fromkeys(one.path for one in neighbors)), head.window)


def points_of(tile: LasTile | CloudTile, margin: Margin | None, observer: Observer) -> TilePointReader:
    """Return the points of a tile, followed by those in its margin; warn of neighbours that cannot be read."""
    if margin is None:
        return TilePointReader(tile)
    found, failed = read_margin(tile.path, margin)
    for path, reason in failed.items():
        observer.warn(f"{tile.path.stem}: no margin from {path.name}, which cannot be read ({reason})")
    return PointsWithMargin(tile, found)
