"""What a run would do, without doing it."""

import os
import shutil
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seaclutter_cli.buckets import mirror_of, use_case_of
from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.runs.convert import ConvertWork
from seaclutter_cli.runs.filter import filter_run
from seaclutter_cli.runs.info import excerpt_of
from seaclutter_cli.runs.log_work import LogRun, LogWork, W
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import ConvertOptions, FilterOptions
from seaclutter_cli.runs.outputs import prepare_outputs
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, expected_frames, open_recording, statuses
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.text import count, data_size, table
from seaclutter_cli.threads import in_threads


@use_case_of(FilterOptions)
def plan_filter(options: FilterOptions) -> "RunPlan":
    """Return what `filter_log` would do with each log, and how large it is; nothing is written.

    Returns
    -------
    RunPlan
        ``outcomes``: for each recording, its ``status`` (``do``, ``skip`` or ``refuse``), the reason, its size and
        number of frames; ``bytes_in``: size of all that is to be done.

    Examples
    --------
    >>> import seaclutter
    >>> plan = seaclutter.plan_filter("samples/sea.mcap", folder / "planned.mcap")
    >>> [(one.recording, one.status, one.frames) for one in plan.outcomes]
    [('sea', 'do', 60)]
    """
    return _plan(filter_run(options, options.observer, ahead=False), options.observer)


@use_case_of(ConvertOptions)
def plan_convert(options: ConvertOptions) -> "RunPlan":
    """Return what `convert_log` would do with each log, and how large it is; nothing is written.

    Returns
    -------
    RunPlan
        As from `plan_filter`.

    Examples
    --------
    >>> import seaclutter
    >>> plan = seaclutter.plan_convert("samples/sea.mcap", folder / "planned.bag")
    >>> [(one.recording, one.status, one.frames) for one in plan.outcomes]
    [('sea', 'do', 60)]
    """
    return _plan(LogRun(options, options.observer, ConvertWork, ahead=False), options.observer)


def _plan(run: LogRun[W], observer: Observer) -> "RunPlan":
    run.prepare(dry=True)
    prepare_outputs(run.options.outputs, {}, force=run.options.replaces, dry=True)
    planned = in_threads(_planned, run.works)
    for one in planned:
        observer.done("", one.damage, None) if len(planned) > 1 else observer.damage(one.damage)
    target = run.works[0].target
    folder = next(above for above in target.absolute().parents if above.exists())
    result = RunPlan(planned, None if mirror_of(target) else shutil.disk_usage(folder).free)
    if result.free_bytes is not None and result.bytes_in > result.free_bytes:  # outputs of the size of their recordings
        observer.warn(f"{Path(run.options.output)}: the outputs may not fit")
    return result


def _planned(work: LogWork[Any, Any]) -> "Planned":
    """Return what would be done with one recording; an error is the reason why it would be refused."""
    recording, size = work.recording, work.input_bytes
    planned = Planned(recording=recording.name, input=recording.paths[0], output=work.output, bytes_in=size)
    try:
        _look(work, planned)
    except SeaclutterError as error:
        planned.error = str(error)
    return planned


def _look(work: LogWork[Any, Any], planned: "Planned") -> None:
    options, exists = work.options, os.path.lexists(work.output)
    if exists and options.resume:
        outcome, planned.reason = work.earlier()
        if outcome is not None:
            planned.skipped, planned.frames, planned.reason = True, outcome.frames, "the output is complete"
            return
    elif exists:
        marker = OUTPUT_FORMATS[work.form].marker
        prepare_outputs({"-o": work.output}, {}, force=options.force, root=work.output, marker=marker, dry=True)
        planned.reason = "replaces the output"
    part = excerpt_of(work.recording)
    if part is None and mirror_of(work.recording.paths[0]):
        return  # it would have to be copied
    with closing(open_recording(work.recording, options.reading)) as source:
        if part is not None:
            source.counts.update(part.messages)
        planned.frames = expected_frames(source, work.clouds(source), options.reading.selection)
        planned.damage = list(source.damage)


@dataclass(kw_only=True)
class Planned(Outcome):
    """What a run would do with one recording, and why it would be skipped or done again.

    The size is 0 and the number of frames None if they are not known before reading.
    """

    data = "recording input output status reason=why frames bytes_in damage"

    input: Path
    output: Path
    bytes_in: int
    frames: int | None = None

    @property
    def status(self) -> str:
        """What would be done: ``do``, ``skip`` or ``refuse``."""
        return "refuse" if self.error else "skip" if self.skipped else "do"

    @property
    def why(self) -> str | None:
        """Why the recording would be refused, skipped or done again; None without a reason."""
        return self.error or self.reason or None

    @property
    def explanation(self) -> str:
        """Why the recording would be refused, skipped or done again, and its output otherwise."""
        damaged = f"; {count(len(self.damage), 'damaged part')}" if self.damage else ""
        again = f"{self.reason + '; ' if self.reason else ''}-> {self.output}{damaged}"
        return self.error or (self.reason if self.skipped else again)


@dataclass(frozen=True)
class RunPlan(RecordingsResult[Planned]):
    """What a run would do with each recording, and the free space for the outputs; None in object storage."""

    data = "recordings=outcomes bytes_in free_bytes"

    free_bytes: int | None = None

    @property
    def damaged(self) -> bool:
        """Whether the parts of any recording to be done are damaged, as far as opening it shows."""
        return any(one.damage and not one.skipped for one in self.outcomes)

    @property
    def bytes_in(self) -> int:
        """Size of the recordings that would be processed."""
        return sum(one.bytes_in for one in self.outcomes if one.status == "do")

    def as_text(self) -> str:
        """Return a line for each recording, and the totals."""
        rows = [
            (one.recording, data_size(one.bytes_in), "-" if one.frames is None else f"{one.frames:,}", one.status)
            for one in self.outcomes
        ]
        lines = table(("recording", "size", "frames", "plan"), rows, [one.explanation for one in self.outcomes])
        free = f"; {data_size(self.free_bytes)} free" if self.free_bytes is not None else ""
        return f"{lines}\n{statuses(self.outcomes, 'to ')}; {data_size(self.bytes_in)} in{free}"
