"""Studies of logs and methods: surveys, sweeps over parameters, reports."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from seaclutter_cli.api.arguments import (
    Settings,
    config_source,
    label_sources,
    path_or_none,
    run_observer,
)
from seaclutter_cli.runs.batch import BatchOptions
from seaclutter_cli.runs.info import InfoResult, describe_logs
from seaclutter_cli.runs.label_check import LabelCheckResult, check_label_files
from seaclutter_cli.runs.mask import MaskOptions, MaskResult
from seaclutter_cli.runs.mask import find_mask as find_mask_in
from seaclutter_cli.runs.methods import MethodOptions
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.recordings import Logs, PathLike, ReadOptions
from seaclutter_cli.runs.report import ReportOptions, ReportResult, report_on
from seaclutter_cli.runs.sweep import Sweep
from seaclutter_cli.runs.tune import TuneOptions, TuningResult
from seaclutter_cli.runs.tune import tune as tune_logs
from seaclutter_cli.urls import place


def info(
    logs: Logs,
    *,
    reading: ReadOptions | None = None,
    keep_going: bool = False,
    batch: BatchOptions | None = None,
    observer: Observer = SILENT,
) -> InfoResult:
    """Return the content of logs: topics, frames, fields, extents, sensors, and settings that a filter run needs.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    reading : ReadOptions, optional
        Part of each recording to read, and how.
    keep_going : bool, optional
        Store an error of a recording in its outcome and continue with the others, instead of raising it.
    batch : BatchOptions, optional
        How several recordings are processed; by default one after another. A script that uses several processes needs
        ``if __name__ == "__main__":``, as for `multiprocessing`.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If a log cannot be read; see its subclasses.

    Examples
    --------
    >>> import seaclutter
    >>> (content,) = seaclutter.info("samples/sea.mcap").outcomes
    >>> content.format, content.clouds["/points"].frames, content.clouds["/points"].intensity
    ('MCAP', 60, [1.0, 255.0])
    """
    return describe_logs(logs, reading, run_observer(observer, keep_going=keep_going), batch)


def find_mask(  # noqa: PLR0913 - each an option of its own
    logs: Logs,
    output: PathLike | None = None,
    *,
    reach_m: float = 20.0,
    plot_file: PathLike | None = None,
    reading: ReadOptions | None = None,
    force: bool = False,
    keep_going: bool = False,
    observer: Observer = SILENT,
) -> MaskResult:
    """Find own ship's structure, which is constant while the vessel moves, and write a mask of it.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs, of one lidar in one place.
    output, plot_file : path, optional
        Files for the mask, for the configuration key ``filter.mask``, and for its picture.
    reach_m : float, optional
        Range up to which structure is searched, in metres.
    reading : ReadOptions, optional
        Part of each recording to read, and how.
    force : bool, optional
        Replace existing files.
    keep_going : bool, optional
        Store an error of a recording in its outcome and continue with the others, instead of raising it.
    observer : Observer, optional
        Receives progress and warnings, among them that the vessel seems to be at rest.

    Raises
    ------
    SeaclutterError
        If a log cannot be used; see its subclasses.

    Examples
    --------
    >>> import seaclutter
    >>> result = seaclutter.find_mask("samples/sea.mcap")
    >>> result.found.frames, len(result.found.mask.sectors) > 0
    (60, True)
    """
    options = MaskOptions(
        output=path_or_none(output),
        plot_file=path_or_none(plot_file),
        reach_m=reach_m,
        reading=reading or ReadOptions(),
        force=force,
    )
    return find_mask_in(logs, options, run_observer(observer, keep_going=keep_going))


def check_labels(
    logs: Logs,
    labels: PathLike | Sequence[PathLike],
    *,
    reading: ReadOptions | None = None,
    keep_going: bool = False,
    batch: BatchOptions | None = None,
    observer: Observer = SILENT,
) -> LabelCheckResult:
    """Compare labels with the points of logs, and return probable mistakes with their remedies.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    labels : path, or sequence of paths
        Labels of the recordings in the same order, or a folder with ``RECORDING.labels.csv`` for each.
    reading : ReadOptions, optional
        Part of each recording to read, and how.
    keep_going : bool, optional
        Store an error of a recording in its outcome and continue with the others, instead of raising it.
    batch : BatchOptions, optional
        How several recordings are processed; by default one after another.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If a log or its labels cannot be used.

    Examples
    --------
    >>> import seaclutter
    >>> (checked,) = seaclutter.check_labels("samples/sea.mcap", "samples/sea.labels.csv").outcomes
    >>> checked.boxes, checked.visible, checked.findings
    (120, 120, [])
    """
    checked = run_observer(observer, keep_going=keep_going)
    return check_label_files(logs, label_sources(labels), reading, batch, checked)


def tune(  # noqa: PLR0913 - each an option of its own
    logs: Logs,
    labels: PathLike | Sequence[PathLike],
    sweeps: Mapping[str, Sequence[Any]],
    *,
    method: str | Sequence[str] | None = None,
    compare: Sequence[Literal["paper", "peers", "all"]] = (),
    hold_out: float = 0.25,
    config: Settings | None = None,
    reading: ReadOptions | None = None,
    output: PathLike | None = None,
    csv_file: PathLike | None = None,
    force: bool = False,
    keep_going: bool = False,
    batch: BatchOptions | None = None,
    observer: Observer = SILENT,
) -> TuningResult:
    """Evaluate every combination of methods and parameter values, and find the one with the fewest bad frames.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    labels : path, or sequence of paths
        Labels of the recordings in the same order, or a folder with ``RECORDING.labels.csv`` for each.
    sweeps : mapping of str to sequence
        Configuration keys of the filter, and the values to try for each; of several methods, those that have the key.
        ``"ror.min_neighbors"`` is for one of them. May be empty if several methods are compared.
    method : str or sequence of str, optional
        Filter methods; by default that of the configuration, or ``joint``.
    compare : sequence of {"paper", "peers", "all"}, optional
        Groups of methods.
    hold_out : float, optional
        Share of the recordings, or of fewer than four the last frames of each, on which the best combination is judged
        but not chosen.
    config : path, mapping or Config, optional
        Configuration to start from.
    reading : ReadOptions, optional
        Part of each recording to read, and how.
    output, csv_file : path, optional
        Files for the configuration with the best values, and for a table with a row for each combination.
    force : bool, optional
        Replace existing files.
    keep_going : bool, optional
        Store an error of a recording in its outcome and continue with the others, instead of raising it.
    batch : BatchOptions, optional
        How several recordings are processed; by default one after another.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If a log or its labels cannot be used, or a value is not allowed.

    Examples
    --------
    >>> import seaclutter
    >>> result = seaclutter.tune("samples/sea.mcap", "samples/sea.labels.csv", {"update_weight": [0.6, 1.0]})
    >>> result.best
    'update_weight=0.6'
    """
    names = (method,) if isinstance(method, str) else tuple(method or ())
    options = TuneOptions(
        sweeps=tuple(Sweep(key, tuple(values)) for key, values in sweeps.items()),
        labels=label_sources(labels),
        methods=MethodOptions(file=config_source(config), methods=names, comparisons=tuple(compare)),
        hold_out=hold_out,
        reading=reading or ReadOptions(),
        output=path_or_none(output),
        csv_file=path_or_none(csv_file),
        force=force,
        batch=batch or BatchOptions(),
    )
    return tune_logs(logs, options, run_observer(observer, keep_going=keep_going))


def report(  # noqa: PLR0913 - each an option of its own
    logs: Logs,
    output: PathLike,
    *,
    methods: str | Sequence[str] = (),
    compare: Sequence[Literal["paper", "peers", "all"]] = (),
    config: Settings | None = None,
    labels: PathLike | Sequence[PathLike] | None = None,
    reading: ReadOptions | None = None,
    figure_folder: PathLike | None = None,
    picks: Sequence[int] = (),
    force: bool = False,
    keep_going: bool = False,
    observer: Observer = SILENT,
) -> ReportResult:
    """Write a page that shows the effect of a filter on logs and, with labels, its quality.

    Parameters
    ----------
    logs : path, or sequence of paths
        Raw logs, which are filtered; or logs filtered with ``McapOptions(keep_raw=True, with_removed=True)``, which are
        read back unless a method is named.
    output : path
        File of the page (HTML).
    methods : str or sequence of str, optional
        Filter methods; by default that of the configuration, or ``joint``.
    compare : sequence of {"paper", "peers", "all"}, optional
        Groups of methods.
    config : path, mapping or Config, optional
        Configuration file or the name of a built-in one, the content of a file, or a configuration.
    labels : path, or sequence of paths, optional
        Labels of the recordings.
    reading : ReadOptions, optional
        Part of each recording to read, and how.
    figure_folder : path, optional
        Folder for all figures as SVG files.
    picks : sequence of int, optional
        Indices of frames to include in any case.
    force : bool, optional
        Replace existing files.
    keep_going : bool, optional
        Store an error of a recording in its outcome and continue with the others, instead of raising it.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If a log cannot be used; see its subclasses.

    Examples
    --------
    >>> import seaclutter
    >>> done = seaclutter.report("samples/sea.mcap", folder / "report.html", reading=seaclutter.ReadOptions(frames=20))
    >>> done.frames, len(done.sizes)
    (20, 1)
    """
    names = (methods,) if isinstance(methods, str) else tuple(methods)
    options = ReportOptions(
        output=place(output),
        methods=MethodOptions(file=config_source(config), methods=names, comparisons=tuple(compare)),
        labels=label_sources(labels),
        reading=reading or ReadOptions(),
        figure_folder=path_or_none(figure_folder),
        picks=tuple(picks),
        force=force,
    )
    return report_on(logs, options, run_observer(observer, keep_going=keep_going))
