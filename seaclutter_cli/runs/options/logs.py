"""Options of use cases that work on logs: filter, convert, info, mask, view."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seaclutter_cli.options import Choice, Grouped, Number, OptionalPath, Place, Whole, grouped, option
from seaclutter_cli.runs.options import (
    BatchOptions,
    ConfigOptions,
    LabelSources,
    OfLogs,
    ReadOptions,
    Replacing,
)
from seaclutter_cli.sinks.options import FORMATS, McapOptions

if TYPE_CHECKING:
    from seaclutter_cli.urls import PathLike


class WritingLogs(Replacing, OfLogs):
    """Options of functions that write a log for each recording."""

    output: PathLike = option(
        "-o --output OUT",
        "Output of one recording; folder for several, or with a slash at its end.",
        kind=Place(remote=True, output=True, or_folder=True),
        kw_only=False,
    )
    to: str | None = option(
        "--to", "Format of the output. [default: by the suffix of OUT, or mcap]", default=None, kind=Choice(FORMATS)
    )
    written: Grouped[McapOptions] = grouped(default=McapOptions())
    batch: Grouped[BatchOptions] = grouped(default=BatchOptions())


class FilterOptions(WritingLogs, LabelSources, ConfigOptions):
    """Options of a filter run."""

    csv_file: OptionalPath = option("--csv", "Also write a table with a row for each frame.", default=None)
    with_scene: bool = option(
        "--with-scene",
        "Write boxes around clusters, and those of --labels, to /seaclutter/scene, for 3D panels.",
        default=False,
    )


class ConvertOptions(WritingLogs):
    """Options of a conversion."""

    reading: Grouped[ReadOptions] = grouped("intensity_field", default=ReadOptions())
    written: Grouped[McapOptions] = grouped(
        *("keep_raw", "with_removed", "keep_organized", "diagnostics"),
        default=McapOptions(),
        help="Compression, parts and topics of the outputs; the rest is for `filter_log` only.",
    )


class InfoOptions(OfLogs):
    """Options of a survey of logs."""

    batch: Grouped[BatchOptions] = grouped("resume", "manifest", default=BatchOptions())


class MaskOptions(Replacing, OfLogs):
    """Options of the search for own ship's structure."""

    output: OptionalPath = option(
        "-o --output MASK.csv", "Write the mask, for the configuration key filter.mask.", default=None, kw_only=False
    )
    plot_file: OptionalPath = option("--plot", "Draw the mask (.png or .svg).", default=None)
    reach_m: float = option(
        "--reach METRES",
        "Range up to which structure is searched; somewhat more than own ship's length.",
        default=20.0,
        kind=Number(1, 100),
    )


class ViewOptions(Replacing, LabelSources, ConfigOptions):
    """Options of the viewer; by default, filtered logs are read back.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.ViewOptions().port
    9876
    """

    target: OptionalPath = option(
        "--save FILE.rrd", "Write a file for the viewer instead of opening it; needs no display.", default=None
    )
    port: int = option("--port", "Port of the viewer.", default=9876, kind=Whole(1, 65535))
    reading: Grouped[ReadOptions] = grouped(default=ReadOptions())
