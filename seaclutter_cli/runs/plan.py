"""What a run would do, without doing it."""

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.buckets import mirror_of, on_paths
from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.runs.batch import Work, input_bytes, run_batch
from seaclutter_cli.runs.convert import ConvertOptions, plan_conversions
from seaclutter_cli.runs.estimate import estimate
from seaclutter_cli.runs.filter import FilterOptions, plan_works
from seaclutter_cli.runs.info import excerpt_of
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.output_plan import check_names
from seaclutter_cli.runs.outputs import Root, check_outputs
from seaclutter_cli.runs.plan_result import Planned, RunPlan
from seaclutter_cli.runs.planned_works import PlannedWork, PlannedWorks, W
from seaclutter_cli.runs.recordings import Logs, PathLike, ReadOptions, expected_frames
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.sources import Recording


@on_paths
def plan_filter(logs: Logs, output: PathLike, options: FilterOptions, observer: Observer = SILENT) -> RunPlan:
    """Return what a filter run would do with each recording, and an estimate of its duration and outputs.

    Recordings are opened, and the first frames of one of them are filtered into a temporary folder. Nothing else is
    written.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    output : path
        File for one recording, folder for several or if it is a `str` that ends in a slash.
    options : FilterOptions
        Options of the run.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If the run could not start, whatever the recordings.
    """
    return _plan(plan_works(logs, output, options, observer, ahead=False), observer, options.labels.paths)


@on_paths
def plan_conversion(logs: Logs, output: PathLike, options: ConvertOptions, observer: Observer = SILENT) -> RunPlan:
    """Return what a conversion would do with each recording, with an estimate; see `plan_filter`."""
    return _plan(plan_conversions(logs, output, options, observer, ahead=False), observer)


def _plan(plan: PlannedWorks[W], observer: Observer, labels: Sequence[Path] = ()) -> RunPlan:
    options = plan.works[0].options
    log_file = getattr(observer, "log_file", None)
    check_outputs(plan.outputs, plan.inputs, labels, force=True, log_file=log_file, root=plan.root)
    check_names((work.target for work in plan.works), options.to)
    others = {option: place for option, place in plan.outputs.items() if option != "-o"}
    check_outputs(others, {}, force=options.force or options.batch.resume)
    works = [PlanWork(work, exists=os.path.lexists(work.output)) for work in plan.works]
    single = len(works) == 1
    planned = [works[0].run(observer)] if single else list(run_batch(works, options.batch.here(), observer))
    todo = [(one, work) for one, work in zip(planned, plan.works, strict=True) if one.status == "do"]
    result = RunPlan(planned, estimate(todo, options.batch), _free_bytes(plan.works[0].target))
    if result.is_too_large:
        observer.warn(f"{plan.root.place}: the outputs may not fit")
    return result


def _free_bytes(target: Path) -> int | None:
    """Return the free space for outputs on this machine."""
    if mirror_of(target):
        return None
    folder = next(above for above in target.absolute().parents if above.exists())
    return shutil.disk_usage(folder).free


@dataclass(frozen=True)
class PlanWork(Work[Planned]):
    """A look at one recording and its output.

    Parameters
    ----------
    work : PlannedWork
        What would be done.
    exists : bool
        Whether there is something in place of the output.
    """

    work: PlannedWork
    exists: bool

    @property
    def recording(self) -> Recording:  # type: ignore[override]
        """The recording."""
        return self.work.recording

    def run(self, observer: Observer) -> Planned:
        """Return what would be done; an error is the reason why it would be refused."""
        planned = self.without_result(None)
        try:
            self._look(planned)
        except SeaclutterError as error:
            planned.error = str(error)
        observer.damage(planned.damage)
        return planned

    def without_result(self, reason: str | None) -> Planned:
        """Return a plan without content."""
        recording, target = self.recording, self.work.output
        size = input_bytes(recording)
        return Planned(recording=recording.name, input=recording.paths[0], output=target, bytes_in=size, error=reason)

    def _look(self, planned: Planned) -> None:
        options = self.work.options
        if self.exists and options.batch.resume:
            outcome, planned.reason = self.work.earlier()
            if outcome is not None:
                planned.skipped, planned.frames = True, outcome.frames
                return
        elif self.exists:
            root = Root(self.work.output, OUTPUT_FORMATS[self.work.form].marker)
            check_outputs({"-o": self.work.output}, {}, force=options.force, root=root)
            planned.reason = "replaces the output"
        with _opened(self.recording, options.reading) as source:
            if source is None:
                return
            clouds = self.work.clouds(source)
            planned.frames = expected_frames(source, clouds, options.reading.selection)
            planned.damage = list(source.damage)


@contextmanager
def _opened(recording: Recording, reading: ReadOptions) -> Iterator[Source | None]:
    """Open a recording, or the beginning of one in object storage; yield None if it would have to be copied."""
    part = excerpt_of(recording)
    if part is None and mirror_of(recording.paths[0]):
        yield None
        return
    with closing(reading.open(recording)) as source:
        if part is not None:
            source.counts.update(part.messages)
        yield source
