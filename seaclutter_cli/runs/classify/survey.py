"""Tiles of one survey: which of them are neighbours, and the margins that they share."""

from collections.abc import Sequence
from pathlib import Path

from seaclutter_cli.jobs.together import in_threads
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.sources.extents import TileHead, neighbors_of, read_head
from seaclutter_cli.sources.margins import Margin, PointsWithMargin, read_margin
from seaclutter_cli.sources.tiles import CloudTile, LasTile, TilePointReader
from seaclutter_cli.text import count

MARGIN_M = 100.0
"""Width of the margin around a tile from which points of its neighbours are used."""


def margins_of(tiles: Sequence[Path], margin_m: float, observer: Observer) -> list[Margin | None]:
    """Return the margin of each tile; None for those without neighbours.

    Parameters
    ----------
    tiles : sequence of Path
        The tiles of a survey.
    margin_m : float
        Width of the margin; 0: each tile is processed alone.
    observer : Observer
        Receives a warning if tiles have different coordinate reference systems, and details.
    """
    if len(tiles) < 2 or margin_m <= 0:
        return [None] * len(tiles)
    heads = in_threads(read_head, tiles)
    systems = {head.crs for head in heads if head.extent}
    if len(systems) > 1:
        observer.warn(f"tiles have {len(systems)} coordinate reference systems; margins come from tiles with the same")
    found = neighbors_of(heads, margin_m)
    pairs = sum(map(len, found)) // 2
    observer.note(f"{count(len(tiles), 'tile')}, {count(pairs, 'pair')} of neighbours", detail=True)
    return [_margin(*pair, margin_m) for pair in zip(heads, found, strict=True)]


def _margin(head: TileHead, neighbors: Sequence[TileHead], margin_m: float) -> Margin | None:
    if head.extent is None or not neighbors:
        return None
    return Margin(head.extent.grown(margin_m), tuple(one.path for one in neighbors))


def points_of(tile: LasTile | CloudTile, margin: Margin | None, observer: Observer) -> TilePointReader:
    """Return the points of a tile, followed by those in its margin; warn of neighbours that cannot be read."""
    if margin is None:
        return TilePointReader(tile)
    found, failed = read_margin(margin)
    for path, reason in failed.items():
        observer.warn(f"{tile.path.stem}: no margin from {path.name}, which cannot be read ({reason})")
    return PointsWithMargin(tile, found)
