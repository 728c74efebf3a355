"""Options of use cases about the objects in logs: tables of them, proposed labels, and suspects."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from seaclutter_cli.options import (
    Converted,
    Grouped,
    OptionalPath,
    Place,
    Whole,
    grouped,
    option,
)
from seaclutter_cli.runs.options import BatchOptions, Observed, OfLogs, Replacing
from seaclutter_cli.runs.options.methods import ConfigOptions

if TYPE_CHECKING:
    from pathlib import Path

    from seaclutter_cli.urls import PathLike


class ObjectsOptions(Replacing, OfLogs, ConfigOptions):
    """Options of a search for objects; the default method is ``confirmed``."""

    output: OptionalPath = option(
        "-o --output OBJECTS",
        "Write a table with a row for each frame and object (.csv, .parquet), or tracks on earth (.geojson).",
        default=None,
        kw_only=False,
    )
    batch: Grouped[BatchOptions] = grouped("resume", default=BatchOptions())


class ProposeOptions(Replacing, OfLogs, ConfigOptions):
    """Options of a proposal of labels; the default method is ``confirmed``."""

    output: PathLike = option(
        "-o --output LABELS",
        "Labels of one recording; folder with RECORDING.labels.csv for each of several, or with a slash at its end.",
        kind=Place(output=True, or_folder=True),
        kw_only=False,
    )
    to: Literal["csv", "sustechpoints", "seepersea"] = option(
        "--to", "Form of the labels; sustechpoints and seepersea are folders with the clouds.", default="csv"
    )
    batch: Grouped[BatchOptions] = grouped("resume", "manifest", default=BatchOptions())


class CompareOptions(Observed):
    """Options of a comparison of labels."""

    proposed: Converted[PathLike, Path] = option(
        "A", "Labels before they were corrected, as `labels propose` wrote them.", kind=Place(), kw_only=False
    )
    corrected: Converted[PathLike, Path] = option(
        "B", "Labels of the same frames after that.", kind=Place(), kw_only=False
    )


class SuspectsOptions(Replacing, OfLogs, ConfigOptions):
    """Options of a search for suspects."""

    output: OptionalPath = option(
        "-o --output SUSPECTS.csv", "Write a table with a row for each suspect.", default=None, kw_only=False
    )
    picture_folder: OptionalPath = option(
        "--pictures DIR",
        "Draw each suspect that is shown, before and after the filter; reads the logs twice.",
        default=None,
        kind=Place(remote=True),
    )
    shown: int = option("--show", "Number of suspects of each kind to show.", default=10, kind=Whole(1, 500))
    batch: Grouped[BatchOptions] = grouped("resume", "manifest", default=BatchOptions())
