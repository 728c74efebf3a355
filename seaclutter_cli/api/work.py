"""Work on whole logs: filtering, calibration, evaluation, simulation."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from seaclutter_cli.api.arguments import (
    Settings,
    config_options,
    config_source,
    label_sources,
    path_or_none,
    run_observer,
)
from seaclutter_cli.calibration import FILTER_RATE
from seaclutter_cli.runs.batch import BatchOptions
from seaclutter_cli.runs.calibrate import CalibrateOptions, calibrate_logs
from seaclutter_cli.runs.calibrate_result import CalibrationResult
from seaclutter_cli.runs.convert import ConvertOptions, convert_logs
from seaclutter_cli.runs.convert_result import ConvertSummary
from seaclutter_cli.runs.evaluate import Comparison, EvaluateOptions, evaluate_logs
from seaclutter_cli.runs.filter import FilterOptions, filter_logs
from seaclutter_cli.runs.filter_result import FilterSummary
from seaclutter_cli.runs.methods import MethodOptions
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.plan import plan_conversion
from seaclutter_cli.runs.plan import plan_filter as run_plan
from seaclutter_cli.runs.plan_result import RunPlan
from seaclutter_cli.runs.recordings import Logs, PathLike, ReadOptions
from seaclutter_cli.runs.simulate import SimulateOptions, SimulationResult, TileSimulationResult, simulate_scene
from seaclutter_cli.sinks.options import McapOptions


def filter_log(  # noqa: PLR0913 - each an option of its own
    logs: Logs,
    output: PathLike,
    *,
    method: str | None = None,
    config: Settings | None = None,
    reading: ReadOptions | None = None,
    written: McapOptions | None = None,
    to: str | None = None,
    csv_file: PathLike | None = None,
    force: bool = False,
    keep_going: bool = False,
    batch: BatchOptions | None = None,
    observer: Observer = SILENT,
) -> FilterSummary:
    """Filter one or several logs into drop-in logs.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    output : path
        Output of one recording, folder for several.
    method : str, optional
        Filter method; by default that of the configuration, or ``joint``.
    config : path, mapping or Config, optional
        Configuration file or the name of a built-in one, the content of a file, or a configuration.
    reading : ReadOptions, optional
        Part of each recording to read, and how.
    written : McapOptions, optional
        Content of the filtered logs.
    to : str, optional
        Format of the filtered logs, as for ``--to``; by default that of the suffix of ``output``, or ``mcap``.
    csv_file : path, optional
        File for a table with a row for each frame.
    force : bool, optional
        Replace existing files.
    keep_going : bool, optional
        Store an error of a recording in its outcome and continue with the others, instead of raising it.
    batch : BatchOptions, optional
        How several recordings are processed; by default one after another. A script that uses several processes needs
        ``if __name__ == "__main__":``, as for `multiprocessing`.
    observer : Observer, optional
        Receives progress and warnings.

    Returns
    -------
    FilterSummary
        Outcome of each recording: frames, points by reason, range rings, damage, seconds.

    Raises
    ------
    SeaclutterError
        If a log cannot be filtered; see its subclasses.

    Examples
    --------
    >>> import seaclutter
    >>> first = seaclutter.ReadOptions(frames=5)
    >>> done = seaclutter.filter_log("samples/sea.mcap", folder / "filtered.mcap", reading=first)
    >>> outcome = done.outcomes[0]
    >>> outcome.frames, outcome.topics["/points"].points_in
    (5, 10304)
    """
    options = FilterOptions(
        config=config_options(method, config),
        reading=reading or ReadOptions(),
        written=written or McapOptions(),
        to=to,
        csv_file=path_or_none(csv_file),
        force=force,
        batch=batch or BatchOptions(),
    )
    return filter_logs(logs, output, options, run_observer(observer, keep_going=keep_going))


def convert_log(  # noqa: PLR0913 - each an option of its own
    logs: Logs,
    output: PathLike,
    *,
    to: str | None = None,
    reading: ReadOptions | None = None,
    written: McapOptions | None = None,
    force: bool = False,
    keep_going: bool = False,
    batch: BatchOptions | None = None,
    observer: Observer = SILENT,
) -> ConvertSummary:
    """Convert one or several logs to another format, without filtering.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    output : path
        Output of one recording, folder for several.
    to : str, optional
        Format, as for ``--to``; by default that of the suffix of ``output``, or ``mcap``.
    reading : ReadOptions, optional
        Part of each recording to read, and how.
    written : McapOptions, optional
        Compression, parts and topics of the outputs; the rest is for `filter_log` only.
    force : bool, optional
        Replace existing files.
    keep_going : bool, optional
        Store an error of a recording in its outcome and continue with the others, instead of raising it.
    batch : BatchOptions, optional
        How several recordings are processed, as for `filter_log`.
    observer : Observer, optional
        Receives progress and warnings, among them what a format cannot keep.

    Returns
    -------
    ConvertSummary
        Outcome of each recording: messages, frames, points, what was lost, damage, seconds.

    Raises
    ------
    SeaclutterError
        If a log cannot be converted; see its subclasses.

    Examples
    --------
    >>> import seaclutter
    >>> done = seaclutter.convert_log("samples/sea.mcap", folder / "sea.bag")
    >>> done.outcomes[0].messages, done.outcomes[0].lost
    (60, ['sequence numbers'])
    """
    options = ConvertOptions(
        reading=reading or ReadOptions(),
        written=written or McapOptions(),
        to=to,
        force=force,
        batch=batch or BatchOptions(),
    )
    return convert_logs(logs, output, options, run_observer(observer, keep_going=keep_going))


def plan_filter(  # noqa: PLR0913 - each an option of its own
    logs: Logs,
    output: PathLike,
    *,
    method: str | None = None,
    config: Settings | None = None,
    reading: ReadOptions | None = None,
    written: McapOptions | None = None,
    to: str | None = None,
    csv_file: PathLike | None = None,
    force: bool = False,
    batch: BatchOptions | None = None,
    observer: Observer = SILENT,
) -> RunPlan:
    """Return what `filter_log` would do with each log, with an estimate of its duration; nothing is written.

    Parameters
    ----------
    logs, output, method, config, reading, written, to, csv_file, force, batch
        As for `filter_log`.
    observer : Observer, optional
        Receives progress and warnings.

    Returns
    -------
    RunPlan
        ``outcomes``: for each recording, its ``status`` (``do``, ``skip`` or ``refuse``), the reason, and its size;
        ``estimate``: seconds and bytes of the run.

    Raises
    ------
    SeaclutterError
        If the run could not start.

    Examples
    --------
    >>> import seaclutter
    >>> plan = seaclutter.plan_filter("samples/sea.mcap", folder / "planned.mcap")
    >>> [(one.recording, one.status, one.frames) for one in plan.outcomes]
    [('sea', 'do', 60)]
    """
    options = FilterOptions(
        config=config_options(method, config),
        reading=reading or ReadOptions(),
        written=written or McapOptions(),
        to=to,
        csv_file=path_or_none(csv_file),
        force=force,
        batch=batch or BatchOptions(),
    )
    return run_plan(logs, output, options, observer)


def plan_convert(  # noqa: PLR0913 - each an option of its own
    logs: Logs,
    output: PathLike,
    *,
    to: str | None = None,
    reading: ReadOptions | None = None,
    written: McapOptions | None = None,
    force: bool = False,
    batch: BatchOptions | None = None,
    observer: Observer = SILENT,
) -> RunPlan:
    """Return what `convert_log` would do with each log, with an estimate of its duration; nothing is written.

    Parameters
    ----------
    logs, output, to, reading, written, force, batch
        As for `convert_log`.
    observer : Observer, optional
        Receives progress and warnings.

    Returns
    -------
    RunPlan
        As from `plan_filter`.

    Raises
    ------
    SeaclutterError
        If the run could not start.

    Examples
    --------
    >>> import seaclutter
    >>> plan = seaclutter.plan_convert("samples/sea.mcap", folder / "planned.bag")
    >>> [(one.recording, one.status, one.frames) for one in plan.outcomes]
    [('sea', 'do', 60)]
    """
    options = ConvertOptions(
        reading=reading or ReadOptions(),
        written=written or McapOptions(),
        to=to,
        force=force,
        batch=batch or BatchOptions(),
    )
    return plan_conversion(logs, output, options, observer)


def calibrate(  # noqa: PLR0913 - each an option of its own
    logs: Logs,
    *,
    method: str | None = None,
    config: Settings | None = None,
    filter_rate: float = FILTER_RATE,
    max_left: float | None = None,
    choose: bool = False,
    trade_off: bool = False,
    keep_end: bool = False,
    labels: PathLike | Sequence[PathLike] | None = None,
    reading: ReadOptions | None = None,
    output: PathLike | None = None,
    plot_file: PathLike | None = None,
    force: bool = False,
    batch: BatchOptions | None = None,
    observer: Observer = SILENT,
) -> CalibrationResult:
    """Derive the threshold of each range ring and the far limit from logs that contain sea clutter.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs. The logs contain no targets, unless there are labels.
    method : str, optional
        Filter method with thresholds for range rings; by default that of the configuration, or ``joint``.
    config : path, mapping or Config, optional
        Configuration to start from; provides the range rings and all settings that are not derived.
    filter_rate : float, optional
        Share of the clutter points in each range ring that its threshold must remove.
    max_left : float, optional
        Number of clutter points per frame that a range ring may keep; where it would keep more, its rate is higher.
    choose, trade_off : bool, optional
        Compare values of the two by labels, on held-out frames; with ``choose``, use the best.
    keep_end : bool, optional
        Keep the far limit of the configuration.
    labels : path, or sequence of paths, optional
        Labels of targets and areas to leave out.
    reading : ReadOptions, optional
        Part of each recording to read, and how.
    output : path, optional
        File for the resulting configuration.
    plot_file : path, optional
        File for a plot of clutter and thresholds over range; PNG or SVG.
    force : bool, optional
        Replace existing files.
    batch : BatchOptions, optional
        How several recordings are processed; by default one after another.
    observer : Observer, optional
        Receives progress and warnings.

    Returns
    -------
    CalibrationResult
        ``config``, to filter with; ``found``, the threshold of each range ring.

    Raises
    ------
    SeaclutterError
        If a log cannot be used; see its subclasses.

    Examples
    --------
    >>> import seaclutter
    >>> result = seaclutter.calibrate("samples/sea.mcap", labels="samples/sea.labels.csv")
    >>> result.config.method, len(result.found.rings)
    ('joint', 6)
    """
    options = CalibrateOptions(
        config=config_options(method, config),
        filter_rate=filter_rate,
        max_left=max_left,
        choose=choose,
        trade_off=trade_off,
        keep_end=keep_end,
        labels=label_sources(labels),
        reading=reading or ReadOptions(),
        output=path_or_none(output),
        plot_file=path_or_none(plot_file),
        force=force,
        batch=batch or BatchOptions(),
    )
    return calibrate_logs(logs, options, observer)


def evaluate(  # noqa: PLR0913 - each an option of its own
    logs: Logs,
    labels: PathLike | Sequence[PathLike],
    *,
    methods: str | Sequence[str] = (),
    compare: Sequence[Literal["paper", "peers", "all"]] = (),
    config: Settings | None = None,
    clustering: Literal["euclidean", "dbscan"] | None = None,
    reading: ReadOptions | None = None,
    frames_file: PathLike | None = None,
    summary_file: PathLike | None = None,
    force: bool = False,
    keep_going: bool = False,
    batch: BatchOptions | None = None,
    observer: Observer = SILENT,
) -> Comparison:
    """Count false alarms and missed targets of one or several methods against labels, in one pass over the logs.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    labels : path, or sequence of paths
        Labels of the recordings in the same order, or a folder with ``RECORDING.labels.csv`` for each.
    methods : str or sequence of str, optional
        Filter methods, ``none`` for the unfiltered logs; by default that of the configuration, or ``joint``.
    compare : sequence of {"paper", "peers", "all"}, optional
        Groups of methods.
    config : path, mapping or Config, optional
        Configuration file or the name of a built-in one, the content of a file, or a configuration.
    clustering : {"euclidean", "dbscan"}, optional
        Clustering algorithm; by default that of the configuration.
    reading : ReadOptions, optional
        Part of each recording to read, and how.
    frames_file : path, optional
        File for a table with a row for each frame and method (CSV).
    summary_file : path, optional
        File for all results (JSON).
    force : bool, optional
        Replace existing files.
    keep_going : bool, optional
        Store an error of a recording in its outcome and continue with the others, instead of raising it.
    batch : BatchOptions, optional
        How several recordings are processed; by default one after another. A script that uses several processes needs
        ``if __name__ == "__main__":``, as for `multiprocessing`.
    observer : Observer, optional
        Receives progress and warnings.

    Returns
    -------
    Comparison
        ``totals()``, a `Summary` for each method; ``as_text()``, the tables of the command line.

    Raises
    ------
    SeaclutterError
        If a log or its labels cannot be used; see its subclasses.

    Examples
    --------
    >>> import seaclutter
    >>> result = seaclutter.evaluate("samples/sea.mcap", "samples/sea.labels.csv", methods=["joint", "none"])
    >>> {name: (summary.n_fp, summary.n_fn) for name, summary in result.totals().items()}
    {'joint': (14, 8), 'none': (60, 0)}
    """
    names = (methods,) if isinstance(methods, str) else tuple(methods)
    options = EvaluateOptions(
        labels=label_sources(labels),
        methods=MethodOptions(file=config_source(config), methods=names, comparisons=tuple(compare)),
        clustering=clustering,
        reading=reading or ReadOptions(),
        frames_file=path_or_none(frames_file),
        summary_file=path_or_none(summary_file),
        force=force,
        batch=batch or BatchOptions(),
    )
    return evaluate_logs(logs, options, run_observer(observer, keep_going=keep_going))


def simulate(  # noqa: PLR0913 - each an option of its own
    scene: PathLike,
    output: PathLike,
    *,
    frames: int | None = None,
    seed: int | None = None,
    lidar: str | None = None,
    scene_file: PathLike | None = None,
    force: bool = False,
    observer: Observer = SILENT,
) -> SimulationResult | TileSimulationResult:
    """Simulate a labelled recording of a scene.

    Parameters
    ----------
    scene : path or str
        Scene file (YAML), or the name of a built-in scene, layout or tile scene.
    output : path
        ``.mcap`` for point clouds, ``.pcap`` for packets, ``.las`` or ``.laz`` for an airborne tile.
    frames : int, optional
        Number of frames; by default that of the scene.
    seed : int, optional
        Seed of all random numbers; by default that of the scene, 1 for a layout.
    lidar : str, optional
        Lidar; by default that of the scene.
    scene_file : path, optional
        File for an editable copy of the scene.
    force : bool, optional
        Replace existing files.
    observer : Observer, optional
        Receives progress.

    Returns
    -------
    SimulationResult or TileSimulationResult
        Written files, and number of points by label.

    Raises
    ------
    ConfigError
        If the scene is not valid.
    UsageError
        If the name of an output does not fit its format, or the file exists.

    Examples
    --------
    >>> import seaclutter
    >>> made = seaclutter.simulate("calm", folder / "calm.mcap", frames=2)
    >>> made.tally.frames, made.labels.name
    (2, 'calm.labels.csv')
    """
    saved = None if scene_file is None else Path(scene_file)
    options = SimulateOptions(frames=frames, seed=seed, lidar=lidar, scene_file=saved, force=force)
    return simulate_scene(scene, Path(output), options, observer)
