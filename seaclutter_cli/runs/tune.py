"""Tuning: every combination of methods and parameter values over labelled recordings, in one pass."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from seaclutter_cli.errors import UsageError
from seaclutter_cli.evaluation.tuning import Parts
from seaclutter_cli.plots.figure import check_target
from seaclutter_cli.reporting.history import FrameListener
from seaclutter_cli.runs.batch import BatchOptions, run_batch
from seaclutter_cli.runs.comparison import Evaluated
from seaclutter_cli.runs.evaluate import EvaluateWork
from seaclutter_cli.runs.frame_table import FrameRows
from seaclutter_cli.runs.held_out import PartsOfRecordings, split_scores
from seaclutter_cli.runs.labels import LabelSources
from seaclutter_cli.runs.methods import MethodOptions
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import inputs_of, may_appear, prepare_outputs, write_files
from seaclutter_cli.runs.recordings import Logs, ReadOptions, expand, require_selected
from seaclutter_cli.runs.sweep import Combination, Sweep, grid
from seaclutter_cli.runs.threshold_history import ThresholdHistory
from seaclutter_cli.runs.tune_result import TuningResult
from seaclutter_cli.storage.locations import Location
from seaclutter_cli.storage.scratch import copies_removed


@dataclass(frozen=True, kw_only=True)
class TuneOptions:
    """Options of a sweep: methods, parameters, labels, input and output files.

    Parameters
    ----------
    sweeps : tuple of Sweep
        Parameters and the values to try, in all combinations.
    labels : LabelSources
        Labels of the recordings.
    methods : MethodOptions
        Methods to compare, and the configuration to start from.
    hold_out : float
        Share of the recordings, or of the frames of each, on which the best combination is only judged, not chosen.
    reading : ReadOptions
        Part of each recording to read, and how.
    output : Path, Url or None
        File for the configuration with the best values.
    csv_file : Path, Url or None
        File for a table with a row for each combination.
    curve_file : Path, Url or None
        File for a plot of the rates over the values of a single sweep.
    thresholds_file : Path, Url or None
        File for a plot of a range ring's threshold over the frames, for each combination, and the ideal threshold.
    ring : int
        Number of the range ring in that plot, from 1.
    force : bool
        Replace existing files.
    batch : BatchOptions
        How several recordings are processed.
    """

    sweeps: tuple[Sweep, ...]
    labels: LabelSources
    methods: MethodOptions = field(default_factory=MethodOptions)
    hold_out: float = 0.25
    reading: ReadOptions = field(default_factory=ReadOptions)
    output: Location | None = None
    csv_file: Location | None = None
    curve_file: Location | None = None
    thresholds_file: Location | None = None
    ring: int = 2
    force: bool = False
    batch: BatchOptions = field(default_factory=BatchOptions)

    @property
    def targets(self) -> Mapping[str, Location | None]:
        """Output files by option; None for a file that is not requested."""
        return {
            "-o": self.output,
            "--csv": self.csv_file,
            "--plot": self.curve_file,
            "--plot-thresholds": self.thresholds_file,
        }


@copies_removed()
def tune(logs: Logs, options: TuneOptions, observer: Observer = SILENT) -> TuningResult:
    """Evaluate every combination of methods and parameter values, and find the one with the fewest bad frames.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    options : TuneOptions
        Parameters, labels, input and output files.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If the run cannot start or continue; an error in a single recording is stored in its outcome.
    """
    if not 0 <= options.hold_out < 1:
        raise UsageError(f"--hold-out {options.hold_out:g}: must be a share from 0 to below 1")
    combinations = grid(options.sweeps, options.methods)
    variants = [one.variant for one in combinations]
    recordings = expand(logs, options.reading, observer)
    inputs = inputs_of(recordings, options.reading, options.methods.file, [one.config for one in variants])
    prepare_outputs(options.targets, inputs, options.labels.paths, force=options.force, observer=observer)
    _check_plots(options, combinations, len(recordings))
    history = ThresholdHistory(variants, options.ring) if options.thresholds_file else None
    labels = options.labels.assign(recordings)
    works = [TuneWork(variants, options.reading, *each) for each in zip(recordings, labels, strict=True)]
    if history or options.batch.runs_here(len(works)):
        outcomes = [works[0].run(observer, listeners=[history] if history else [])]
    else:
        outcomes = run_batch(works, options.batch, observer)
    require_selected(outcomes)
    parts = [outcome.parts or Parts(len(variants)) for outcome in outcomes]
    split = split_scores(outcomes, parts, [one.name for one in variants], options.hold_out)
    result = TuningResult(options.sweeps, combinations, outcomes, split)
    if may_appear(options.targets.values(), result.outcomes, observer):
        write_files(_files(result, history, options), replace=options.force)
        if options.output and not result.best:
            observer.warn(f"{options.output}: not written, because no frame is labelled")
    return result


@dataclass(frozen=True)
class TuneWork(EvaluateWork):
    """Evaluation of one recording, with the scores of its parts, some of which may be held out."""

    def run(
        self, observer: Observer, tables: Sequence[FrameRows] = (), listeners: Sequence[FrameListener] = ()
    ) -> Evaluated:
        """Evaluate the recording; see `EvaluateWork.run`."""
        parts = PartsOfRecordings(len(self.variants))
        outcome = super().run(observer, tables, [parts, *listeners])
        outcome.parts = next(iter(parts.recordings), None)
        return outcome


def _check_plots(options: TuneOptions, combinations: Sequence[Combination], recordings: int) -> None:
    for path in (options.curve_file, options.thresholds_file):
        if path:
            check_target(path)
    several = len({one.method for one in combinations}) > 1
    if options.curve_file and (len(options.sweeps) != 1 or several):
        raise UsageError("--plot: needs a single --sweep of a single method")
    if options.thresholds_file and several:
        raise UsageError("--plot-thresholds: needs a single method")
    if options.thresholds_file and recordings > 1:
        raise UsageError("--plot-thresholds: needs a single recording")


def _files(result: TuningResult, history: ThresholdHistory | None, options: TuneOptions) -> dict[Location, bytes]:
    files: dict[Location, bytes] = {}
    if options.output and result.best:
        files[options.output] = result.best_config().encode()
    if options.csv_file:
        files[options.csv_file] = result.as_csv().encode()
    if options.curve_file:
        files[options.curve_file] = result.curve(options.curve_file.suffix)
    if options.thresholds_file and history:
        files[options.thresholds_file] = history.plot(options.thresholds_file.suffix)
    return files
