"""Estimate of the duration and the outputs of a run, from the first frames of one recording."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from seaclutter_cli.jobs.processes import default_jobs
from seaclutter_cli.runs.batch import BatchOptions, size_of
from seaclutter_cli.runs.log_outcome import LogOutcome
from seaclutter_cli.runs.plan_result import Estimate, Planned
from seaclutter_cli.runs.planned_works import PlannedWork
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.threads import VARIABLE, cores

_FEW, _MORE = 5, 25
"""Frames of the two samples; what differs between them is the cost of further frames, without start-up."""


def estimate(todo: Sequence[tuple[Planned, PlannedWork]], batch: BatchOptions) -> Estimate | None:
    """Return the estimate for recordings; None if no sample can be processed.

    The sample is from the largest recording on this machine whose number of frames is known. The numbers of frames of
    others follow from their sizes.
    """
    known = [(one.bytes_in, one.frames or 0, work) for one, work in todo if one.frames and isinstance(one.input, Path)]
    if not known:
        return None
    _, _, work = max(known, key=lambda one: one[0])
    jobs = default_jobs(len(todo)) if batch.jobs is None else min(batch.jobs, len(todo))
    with TemporaryDirectory(prefix="seaclutter-") as folder, _threads(max(1, cores() // jobs)):
        few, more = (_sample(work, Path(folder, f"{frames}{_suffix(work)}"), frames) for frames in (_FEW, _MORE))
    if few.error or more.error:
        return None
    per_byte = sum(frames for _, frames, _ in known) / max(sum(size for size, _, _ in known), 1)
    frames = sum(one.frames or round(one.bytes_in * per_byte) for one, _ in todo)
    further, start = more.frames - few.frames, few
    if further <= 0:  # a short recording: no start-up is told apart
        further, start = max(more.frames, 1), work.without_result(None)
    seconds, bytes_out = ((getattr(more, name) - getattr(start, name)) / further for name in ("seconds", "bytes_out"))
    return Estimate(
        seconds=(max(start.seconds - few.frames * seconds, 0.0) * len(todo) + max(seconds, 0.0) * frames) / jobs,
        bytes_out=round(max(bytes_out, 0.0) * frames),
        jobs=jobs,
        sample=work.recording.name,
        frames=more.frames,
    )


def _sample(work: PlannedWork, target: Path, frames: int) -> LogOutcome:
    """Process the first frames of a recording."""
    outcome = work.sample(target, frames)
    outcome.bytes_out = 0 if outcome.error else size_of(target)
    return outcome


def _suffix(work: PlannedWork) -> str:
    kind = OUTPUT_FORMATS[work.form]
    return "" if kind.is_folder else kind.suffix


@contextmanager
def _threads(number: int) -> Iterator[None]:
    """Limit the threads of this process, as those of each process of the run will be."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = before or str(number)
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
