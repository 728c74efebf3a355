"""The record of a run in the tiles that it wrote, by which a later run recognises them."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.airborne.land_cells import LandCells
from seaclutter_cli.airborne.separation import SeaState, Separation
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import CloudError, UsageError
from seaclutter_cli.runs.run_record import RunIdentity
from seaclutter_cli.sinks.las import TextRecord, text_in
from seaclutter_cli.sources.tiles import LasTile, read_columns

RUN = TextRecord(2, "run that wrote this tile")
"""Record of LAS and LAZ files of a survey with the identity and the result of the run as JSON."""

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
