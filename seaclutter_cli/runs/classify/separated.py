"""Separated tiles: the records in them by which a later run recognises them, and results as text and as data."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.airborne.separation import SeaState, Separation
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import CloudError, UsageError
from seaclutter_cli.grids.land_cells import LandCells
from seaclutter_cli.runs.classify.maps import DrawnTile
from seaclutter_cli.runs.classify.tiles import TileOutcome
from seaclutter_cli.runs.recordings import RecordingsResult, statuses
from seaclutter_cli.runs.resume import RunIdentity
from seaclutter_cli.sinks.las import TextRecord, text_in
from seaclutter_cli.sources.tiles import LasTile, read_columns
from seaclutter_cli.text import UNKNOWN, count, share, table

SEA_STATE = TextRecord(1, "sea state of the separation")
"""Record of LAS and LAZ files with a `SeaState` as JSON."""

RUN = TextRecord(2, "run that wrote this tile")
"""Record of each of several tiles with the identity and the result of the run as JSON."""

LAND = TextRecord(3, "land of the separation")
"""Record with the `LandCells` of the tile as JSON, by which a later run draws its map."""

_MAX_RECORD_BYTES = 2**16 - 1


def land_text(land: LandCells) -> str:
    """Return the text of the record of the land; empty if it is too long for a record."""
    text = land.as_text()
    return text if len(text) <= _MAX_RECORD_BYTES else ""


def recorded_separation(output: Path, sea: SeaState) -> tuple[LasTile, Separation]:
    """Return an output and its separation, without heights; raise `ValueError` if there is no record of the land."""
    tile = LasTile(output)
    land = LandCells.from_text(text_in(tile.header, LAND) or "")
    classes = read_columns(tile, ["classification"]).get("classification", np.empty(0, np.uint8))
    return tile, Separation(classes, np.empty(0, np.float32), 0, sea, land)


def record_text(identity: RunIdentity, result: Mapping[str, Any]) -> str:
    """Return the text of the record of a run."""
    return json.dumps({**asdict(identity), "result": result}, sort_keys=True)


def recorded_run(output: Path) -> Mapping[str, Any] | None:
    """Return the record in an output; None if there is no such file.

    Raises
    ------
    UsageError
        If the file is not a tile that a run over several tiles wrote.
    """
    if not output.exists():
        return None
    try:
        text = text_in(LasTile(output).header, RUN)
        if text is None:
            raise UsageError(f"{output}: without a record of its run, not replaced; use --force to replace it")
        record = load_json(text)
    except (CloudError, OSError, ValueError) as error:
        raise UsageError(
            f"{output}: not a separated tile, not replaced ({error}); use --force to replace it"
        ) from error
    return record if isinstance(record, dict) else {}


@dataclass(frozen=True)
class SeparatedTile:
    """Separation of one tile: its name and file, numbers of all, sea and non-sea points, and the state of the sea."""

    tile: str
    output: str
    points: int
    sea: int
    other: int
    sea_state: SeaState
    seconds: float


@dataclass(kw_only=True)
class SeparateOutcome(TileOutcome[SeparatedTile]):
    """Outcome of the separation of one tile, and its part of the maps of the run."""

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
    """Separation of several tiles."""

    is_summary = True

    outcomes: Sequence[SeparateOutcome]

    @property
    def tiles(self) -> list[SeparatedTile]:
        """Separation of each tile without an error."""
        return [outcome.result for outcome in self.outcomes if outcome.result]

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
