"""Work on several recordings: in this process, in several, or on a cluster."""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from operator import methodcaller
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar, cast

from seaclutter_cli.buckets import copies_removed, local, mirror_of, on_paths, shown
from seaclutter_cli.errors import SeaclutterError, SelectionError, TopicError
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.jobs.engine import Engine, Lost, Report, run_in_turn
from seaclutter_cli.records import Channel
from seaclutter_cli.registry import warn_here
from seaclutter_cli.runs.observer import Observer, Silent, Step
from seaclutter_cli.runs.options import BatchOptions, OfLogs, ReadOptions
from seaclutter_cli.runs.outputs import Paths, inputs_of, prepare_outputs
from seaclutter_cli.runs.recordings import (
    MAX_NAMED,
    NOT_PROCESSED,
    LabelFile,
    O,
    Outcome,
    assign_labels,
    expand,
    expected_frames,
    opened,
    require_frames,
    storing_errors,
)
from seaclutter_cli.selection import cloud_channels, recorded_of
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.text import count, listed

if TYPE_CHECKING:  # imports all filters, which tiles do not need
    from seaclutter_cli.config import Config

T = TypeVar("T")
_MIB = 2**20


@contextmanager
def _engine(options: BatchOptions, works: "Sequence[Work[Any]]", observer: Observer) -> Iterator[Engine[Any]]:
    if options.cluster is not None:
        from seaclutter_cli.jobs.cluster.connection import connection_to
        from seaclutter_cli.jobs.cluster.engine import Cluster  # asyncio takes time to import
        from seaclutter_cli.runs.shared_files import shared_files

        connection = connection_to(options.cluster, insecure=options.cluster_insecure, workers=options.jobs)
        reads, writes = ([path for work in works for path in getattr(work, name)] for name in ("reads", "writes"))
        with shared_files(reads, writes) as check:
            yield Cluster(connection, check, observer.warn, options.jobs)
        return
    from seaclutter_cli.jobs.processes import default_jobs, run_in_processes  # not needed for a single recording

    every = (path for work in works for path in work.reads)
    # Small objects are fetched many at a time for one process, not for several.
    are_small = options.jobs is None and all((mirror := mirror_of(path)) and mirror.is_small(path) for path in every)
    jobs = options.jobs or (1 if are_small else default_jobs(len(works)))
    yield run_in_turn if min(jobs, len(works)) <= 1 else partial(run_in_processes, jobs)


class Work(ABC, Generic[O]):
    """Work on one recording: an object that pickle can copy, as its outcome."""

    noun: ClassVar[str] = "recording"
    """Name of what is processed, for the progress."""
    kind: ClassVar[type[Outcome]] = Outcome
    """Class of the outcome."""
    recording: Recording
    """The recording."""

    @property
    def reads(self) -> Sequence[Path]:
        """Files and folders that the work reads."""
        return self.recording.paths

    @property
    def writes(self) -> Sequence[Path]:
        """Files that the work writes."""
        return ()

    @property
    def input_bytes(self) -> int:
        """Size of the files of the recording in bytes; 0 for those that cannot be read."""
        return sum(map(size_of, self.recording.paths))

    def run(self, observer: Observer) -> O:
        """Do the work; an error of the recording is stored in the outcome."""
        outcome = self.without_result(None)
        with storing_errors(outcome, observer):
            self.fill(outcome, observer)
        return outcome

    @abstractmethod
    def fill(self, outcome: O, observer: Observer) -> None:
        """Do the work, and store what is found in the outcome."""

    def without_result(self, reason: str | None) -> O:
        """Return the outcome of work that has not begun, or did not come to an end."""
        return cast("O", self.kind(recording=self.recording.name, error=reason))

    def skipped(self, reason: str) -> O:
        """Return the outcome of a recording that is skipped."""
        outcome = self.without_result(None)
        outcome.skipped, outcome.reason = True, reason
        return outcome


@dataclass(frozen=True)
class RecordingWork(Work[O]):
    """Work on a part of one recording, with its labels if there are any."""

    reading: ReadOptions
    recording: Recording
    labels: LabelFile | None

    @property
    def reads(self) -> Sequence[Path]:
        """Files and folders that the work reads."""
        return *self.recording.paths, *self.reading.beside(), *((self.labels.path,) if self.labels else ())

    def fill(self, outcome: O, observer: Observer) -> None:
        """Open the recording and its labels, and study them."""
        labels = self.labels.open() if self.labels else None
        with opened(self.recording, self.reading, observer, outcome) as source:
            self.study(source, labels, outcome, observer)

    @abstractmethod
    def study(self, source: Source, labels: Labels | None, outcome: O, observer: Observer) -> None:
        """Read the recording, and store what is found in the outcome."""

    def stepped(
        self, every: Iterable[T], source: Source, observer: Observer, clouds: Sequence[Channel] | None = None
    ) -> Iterator[T]:
        """Yield what a source gives, frames or results, with progress over those of clouds, by default the selected."""
        selection = self.reading.selection
        clouds = cloud_channels(source, selection.topics) if clouds is None else clouds
        with observer.progress(source.name, expected_frames(source, clouds, selection)) as step:
            for one in every:
                yield one
                step()

    def finish(self, source: Source, labels: Labels | None, frames: int) -> None:
        """Raise an error if no frame was read, or if a complete recording lacks a frame that is labelled."""
        selection = self.reading.selection
        require_frames(source, frames, selection)
        is_part = any(one.is_part for one in recorded_of(source, selection.topics))
        if labels and selection.is_whole and not source.damage and not is_part:
            labels.finish()


def prepared(
    options: OfLogs, observer: Observer, configs: "Sequence[Config]" = (), others: Paths = MappingProxyType({})
) -> list[tuple[Recording, LabelFile | None]]:
    """Return recordings with their labels, not yet read, after a check of the outputs against all inputs.

    Outputs are those of the options, and ``others`` by option.
    """
    recordings = expand(options, observer)
    inputs, force = inputs_of(recordings, options, configs), getattr(options, "force", False)
    prepare_outputs({**options.outputs, **others}, inputs, force=force, observer=observer)
    return list(zip(recordings, assign_labels(options, recordings), strict=True))


@dataclass
class _Messages(Silent):
    """Observer of the work on one of several recordings, perhaps in another process.

    Messages, which begin with the name of the recording, come along with the result, or reach ``observer`` at once.
    """

    report: Report
    name: str
    observer: Observer | None = None
    messages: list[Callable[[Observer], object]] = field(default_factory=list)
    error: SeaclutterError | None = None

    @contextmanager
    def progress(self, title: str, total: int | None, unit: str = "frame") -> Iterator[Step]:  # noqa: ARG002
        done = itertools.count(1)
        yield lambda: self.report(min(next(done) / total, 1.0)) if total else None

    def note(self, text: str, *, detail: bool = False) -> None:
        self._add("note", text, detail=detail)

    def warn(self, text: str) -> None:
        self._add("warn", text)

    def _add(self, kind: str, text: str, **options: bool) -> None:
        named = text if text.startswith(f"{self.name}:") else f"{self.name}: {text}"
        call = methodcaller(kind, named, **options)
        call(self.observer) if self.observer else self.messages.append(call)

    def fail(self, error: SeaclutterError) -> None:
        self.error = error


@dataclass(frozen=True)
class _Task(Generic[O]):
    """Work with an observer whose messages travel with the outcome, or appear at once in this process."""

    work: Work[O]
    name: str
    observer: Observer | None

    def __call__(self, report: Report) -> tuple[O, list[Callable[[Observer], object]], SeaclutterError | None]:
        messages = _Messages(report, self.name, self.observer)
        outcome = _outcome(self.work, messages)
        return outcome, messages.messages, messages.error

    def __reduce__(self) -> tuple[Any, ...]:
        """Let another process have copies of its own."""
        return _Task, (shown(self.work), self.name, None)


@on_paths
def _outcome(work: Work[O], observer: Observer) -> O:
    for path in work.reads:
        if mirror := mirror_of(path):
            mirror.know(path)
    with copies_removed():
        try:
            return work.run(observer)
        except SelectionError as error:
            return work.skipped(str(error))
        except TopicError as error:
            observer.fail(error)
            return work.without_result(str(error))


def run_all(
    works: Sequence[Work[O]],
    options: BatchOptions,
    observer: Observer,
    in_order: Callable[[O], object] = lambda _: None,
    *,
    earlier: list[Any] | None = None,
) -> list[O]:
    """Return the outcome of each recording; raise `SelectionError` if none has a frame in the selected time.

    ``observer`` receives messages and the progress of the only recording of a run, which is processed in this process;
    of several, the progress of all together, and the end of each. ``in_order`` receives each outcome as soon as those
    of all recordings before are known, except for recordings without a frame in the selected time. ``earlier`` outcomes
    are None where work is left, and receive the others, even if an interrupt ends the run.
    """
    outcomes: list[Any] = earlier or [None] * len(works)
    left = [number for number, outcome in enumerate(outcomes) if outcome is None]
    each, passed = [works[number] for number in left], 0
    here = ((k, work.run(observer)) for k, work in enumerate(each))
    try:
        with closing(here if options.runs_here(len(works)) else _run_batch(each, options, observer)) as every:
            for k, one in every:
                outcomes[left[k]] = one
                while passed < len(left) and (known := outcomes[left[passed]]) is not None:
                    if not known.has_nothing:
                        in_order(known)
                    passed += 1
    finally:
        for number in left:
            outcomes[number] = outcomes[number] or works[number].without_result(NOT_PROCESSED)
    if outcomes and all(outcome.has_nothing for outcome in outcomes):
        raise SelectionError("no recording has a frame in the selected time")
    return outcomes


def without_labels(works: Sequence[RecordingWork[O]], observer: Observer) -> list[O | None]:
    """Return the outcome of recordings without labels, which are skipped, with a warning; None for all others."""
    if names := [work.recording.name for work in works if not work.labels]:
        skipped = f"{count(len(names), 'recording')} of {len(works):,} skipped"
        observer.warn(f"{skipped}, without labels: {listed(names, MAX_NAMED)}")
    return [None if work.labels else work.skipped("no labels") for work in works]


def _run_batch(
    works: Sequence[Work[O]], options: BatchOptions, observer: Observer
) -> Generator[tuple[int, O], None, None]:
    """Yield numbers and outcomes of several recordings, in the order in which they are known."""
    warn_here()
    with ExitStack() as stack, _progress(works, observer) as on_share, _engine(options, works, observer) as engine:
        here = observer if engine is run_in_turn else None
        # They have names because paths in buckets are URLs at first in another process.
        tasks = [_Task(work, work.recording.name, here) for work in works]
        done = stack.enter_context(closing(engine(tasks, on_share)))
        for number, result in done:
            work, error = works[number], None
            if isinstance(result, Lost):
                outcome = work.without_result(f"{work.recording.paths[0]}: {result.reason}")
                error = SeaclutterError(str(outcome.error))
            else:
                outcome, messages, error = local(result)
                for message in messages:
                    message(observer)
            on_share(number, 1.0)
            yield number, outcome
            observer.done(outcome.line(), outcome.damage, error)
            if error and options.fail_fast:
                break


@contextmanager
def _progress(works: Sequence[Work[O]], observer: Observer) -> Iterator[Callable[[int, float], None]]:
    """Show the progress over all recordings, in MiB of input if there are any; yield the function that gets shares."""
    noun, unit = works[0].noun if works else Work.noun, "MiB"
    sizes = [max(work.input_bytes, 1) / _MIB for work in works]
    if sum(sizes) < 1:  # small, or not there yet
        sizes, unit = [1.0] * len(works), noun
    shares = [0.0] * len(works)
    done, shown = 0.0, 0
    with observer.progress(count(len(works), noun), round(sum(sizes)), unit=unit) as step:

        def on_share(number: int, share: float) -> None:
            nonlocal done, shown
            done += sizes[number] * (share - shares[number])
            shares[number] = share
            while shown < int(done):
                step()
                shown += 1

        yield on_share


def size_of(path: Path) -> int:
    """Return the size of a file, or of the files in a folder, in bytes; 0 if it cannot be read."""
    try:
        if path.is_dir():
            return sum(child.stat().st_size for child in path.iterdir() if child.is_file())
        return path.stat().st_size
    except OSError:
        return 0
