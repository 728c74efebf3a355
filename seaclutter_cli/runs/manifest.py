"""Manifest of a run: a row for each recording."""

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from seaclutter_cli.buckets import shown
from seaclutter_cli.runs.recordings import Outcome
from seaclutter_cli.sources import Recording

COLUMNS = (
    "recording",
    "input",
    "output",
    "status",
    "frames",
    "points_in",
    "points_out",
    "false_alarms",
    "missed_targets",
    "bytes_in",
    "bytes_out",
    "seconds",
    "damaged_parts",
    "error",
)
"""Columns; those that a command does not know are empty."""


def manifest_of(path: Path, recordings: Sequence[Recording], outcomes: Sequence[Outcome]) -> dict[Path, bytes]:
    """Return the content of a manifest by its path: JSON if the name ends in ``.json``, otherwise CSV.

    Parameters
    ----------
    path : Path
        Target.
    recordings, outcomes : sequence of Recording, sequence of Outcome
        Recordings and their outcomes.
    """
    rows = shown([_row(*pair) for pair in zip(recordings, outcomes, strict=True)])
    text = json.dumps(rows, indent=2) + "\n" if path.suffix.lower() == ".json" else _csv(rows)
    return {path: text.encode(errors="surrogateescape")}


def _row(recording: Recording, outcome: Outcome) -> dict[str, Any]:
    known = {
        "recording": outcome.recording,
        "input": str(recording.paths[0]),
        "status": outcome.status,
        "seconds": round(outcome.seconds, 3),
        "damaged_parts": len(outcome.damage),
        "error": outcome.error,
        **outcome.counts(),
    }
    return {name: known.get(name) for name in COLUMNS}


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
