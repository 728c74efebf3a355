"""Separated tiles, as text and as data."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from seaclutter_cli.airborne.separation import SeaState
from seaclutter_cli.runs.classify.batch import TileOutcome
from seaclutter_cli.runs.classify.maps import DrawnTile
from seaclutter_cli.runs.recordings import RecordingsResult, statuses
from seaclutter_cli.text import UNKNOWN, count, share, table


@dataclass(frozen=True)
class SeparatedTile:
    """Separation of one tile.

    Parameters
    ----------
    tile, output : str
        Name of the tile, and path of the written file.
    points, sea, other : int
        Numbers of all points, sea points and non-sea points.
    sea_state : SeaState
        Waves, and the surface and height that separate objects from them.
    seconds : float
        Processing time.
    """

    tile: str
    output: str
    points: int
    sea: int
    other: int
    sea_state: SeaState
    seconds: float


@dataclass(kw_only=True)
class SeparateOutcome(TileOutcome[SeparatedTile]):
    """Outcome of the separation of one tile.

    Parameters
    ----------
    output : Path
        The separated tile.
    map : DrawnTile or None
        Its part of the maps of the run.
    """

    output: Path
    map: DrawnTile | None = None

    def figures(self) -> str:
        """Return points and share of the non-sea points, for a line about the outcome."""
        found = self.result
        if self.skipped or found is None:
            return f"{count(self.points, 'point')}; skipped, the output was complete"
        return f"{count(found.points, 'point')}, {share(found.other, found.points)} non-sea, {self.seconds:.1f} s"

    def counts(self) -> dict[str, Any]:
        """Return further columns of the manifest of a run."""
        kept = self.result.other if self.result else 0
        return {
            "output": None if self.error else str(self.output),
            "points_in": self.points,
            "points_out": kept,
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome as JSON-compatible data."""
        blank = {"tile": self.recording, "output": None, "points": 0, "sea": 0, "other": 0, "sea_state": None}
        found = asdict(self.result) if self.result else {**blank, "seconds": self.seconds}
        return {**found, "status": self.status, "error": self.error}


@dataclass(frozen=True)
class SeparateResult(RecordingsResult):
    """Separation of several tiles.

    Parameters
    ----------
    outcomes : sequence of SeparateOutcome
        Outcome of each tile.
    """

    is_summary = True

    outcomes: Sequence[SeparateOutcome]

    @property
    def tiles(self) -> list[SeparatedTile]:
        """Separation of each tile without an error."""
        return [outcome.result for outcome in self.outcomes if outcome.result]

    def as_dict(self) -> list[dict[str, Any]]:
        """Return the result as JSON-compatible data."""
        return [outcome.as_dict() for outcome in self.outcomes]

    def as_text(self) -> str:
        """Return the result as human-readable text: a table, and of several tiles how many were done."""
        head = ("tile", "points", "non-sea", "share", "waves", "length", "seconds")
        rows = [table(head, [_cells(tile) for tile in self.tiles])] if self.tiles else []
        return "\n".join([*rows, *([statuses(self.outcomes)] if len(self.outcomes) > 1 else [])])


def _cells(tile: SeparatedTile) -> tuple[str, ...]:
    counts = f"{tile.points:,}", f"{tile.other:,}", share(tile.other, tile.points)
    height, length = tile.sea_state.wave_height_m, tile.sea_state.wave_length_m
    waves = (UNKNOWN if height is None else f"{height:.1f} m", UNKNOWN if length is None else f"{length:.0f} m")
    return tile.tile, *counts, *waves, f"{tile.seconds:.2f}"
