"""What all studies of recordings share: work on each with its labels, and the outcomes of all of them."""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from seaclutter_cli.config import Config
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.runs.batch import Work, inputs_of_work, run_batch
from seaclutter_cli.runs.observer import Observer, Step
from seaclutter_cli.runs.options import BatchOptions, Logs, ReadOptions
from seaclutter_cli.runs.options.logs import MaskOptions, ViewOptions
from seaclutter_cli.runs.options.studies import (
    CalibrateOptions,
    EvaluateOptions,
    LabelCheckOptions,
    ReportOptions,
    TuneOptions,
)
from seaclutter_cli.runs.outputs import Paths, inputs_of, prepare_outputs
from seaclutter_cli.runs.recordings import (
    LabelFile,
    Outcome,
    assign_labels,
    expand,
    expected_frames,
    finish_labels,
    opened,
    require_frames,
    require_selected,
    storing_errors,
)
from seaclutter_cli.selection import Selection, cloud_channels
from seaclutter_cli.sources.recordings import Recording

StudyOptions = (
    CalibrateOptions | EvaluateOptions | LabelCheckOptions | MaskOptions | ReportOptions | TuneOptions | ViewOptions
)
O = TypeVar("O", bound=Outcome)  # noqa: E741 - an outcome

LabelledRecordings = list[tuple[Recording, LabelFile | None]]
"""Recordings with their labels, not yet read."""


def prepared(
    logs: Logs, options: StudyOptions, outputs: Paths, observer: Observer, configs: Iterable[Config] = ()
) -> LabelledRecordings:
    """Return the recordings of a study with their labels, after a check of its outputs against all inputs."""
    recordings = expand(logs, options.reading, observer)
    inputs = inputs_of(recordings, options.reading, getattr(options, "config", None), configs)
    labels, force = getattr(options, "labels", ()), getattr(options, "force", False)
    prepare_outputs(outputs, inputs, labels, force=force, observer=observer)
    return list(zip(recordings, assign_labels(options, recordings), strict=True))


@dataclass(frozen=True)
class StudyWork(Work[O]):
    """Study of a part of one recording, with its labels if there are any."""

    reading: ReadOptions
    recording: Recording
    labels: LabelFile | None

    @property
    def reads(self) -> Sequence[Path]:
        """Files and folders that the work reads."""
        return inputs_of_work(self.recording, self.reading, self.labels)

    def run(self, observer: Observer) -> O:
        """Study the recording; store an error in the outcome."""
        outcome = self.without_result(None)
        with storing_errors(outcome, observer):
            labels = self.labels.open() if self.labels else None
            with opened(self.recording, self.reading, observer, outcome) as source:
                self.study(source, labels, outcome, observer)
        return outcome

    @abstractmethod
    def study(self, source: Source, labels: Labels | None, outcome: O, observer: Observer) -> None:
        """Read the recording, and store what is found in the outcome."""

    @abstractmethod
    def without_result(self, reason: str | None) -> O:
        """Return an outcome without frames."""

    def finish(self, source: Source, labels: Labels | None, frames: int) -> None:
        """Raise an error if no frame was read, or if a complete recording lacks a frame that is labelled."""
        require_frames(source, frames, self.reading.selection)
        finish_labels(labels, source, self.reading.selection)


def study_all(
    works: Sequence[Work[O]],
    batch: BatchOptions,
    observer: Observer,
    in_order: Callable[[O], object] = lambda _: None,
    *,
    together: bool = False,
) -> list[O]:
    """Return the outcome of each recording; raise `SelectionError` if none has a frame in the selected time.

    The only recording of a run is studied in this process, with its progress and messages as they come; `run_batch`
    describes several, and the last parameters.
    """
    if batch.runs_here(len(works)):
        outcomes = [works[0].run(observer)]
        in_order(outcomes[0])
    else:
        outcomes = run_batch(works, batch, observer, in_order, together=together)
    require_selected(outcomes)
    return outcomes


@contextmanager
def frame_progress(source: Source, selection: Selection, observer: Observer) -> Iterator[Step]:
    """Show the progress over the selected frames of a recording; yield the function to call for each."""
    clouds = cloud_channels(source, selection.topics)
    with observer.progress(source.name, expected_frames(source, clouds, selection)) as step:
        yield step
