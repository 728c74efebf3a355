"""Filtered logs read back, and raw ones filtered, while a listener receives every frame."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import TypeVar

from seaclutter_cli.config import parse_config
from seaclutter_cli.errors import ConfigError, InputError, UsageError
from seaclutter_cli.evaluation.scores import Summary, score_frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.pipeline import was_filtered
from seaclutter_cli.reporting.listener import ReplayListener
from seaclutter_cli.reporting.replay import Replayed, filtered_topics, recorded_config, replay
from seaclutter_cli.runs.comparison import Comparison, Evaluated
from seaclutter_cli.runs.evaluate import Evaluator
from seaclutter_cli.runs.methods import MethodOptions, Variant
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.recordings import ReadOptions, finish_labels, keeping_errors, opened
from seaclutter_cli.sources import Recording

L = TypeVar("L", bound=ReplayListener)


def watch(
    recordings: Sequence[Recording],
    labels: Sequence[Labels | None],
    methods: MethodOptions,
    reading: ReadOptions,
    observer: Observer,
    make_listener: Callable[[Sequence[Variant]], L],
) -> tuple[Comparison, L]:
    """Filter recordings, or read filtered ones back unless methods are chosen, while a listener receives every frame.

    Parameters
    ----------
    recordings : sequence of Recording
        Raw logs, or logs that were filtered alike.
    labels : sequence of Labels or None
        Of each recording.
    methods : MethodOptions
        Methods that filter the logs.
    reading : ReadOptions
        What is read.
    observer : Observer
        Receives progress and warnings.
    make_listener : callable
        Makes the listener that receives the results of some variants.

    Raises
    ------
    UsageError
        If filtered logs do not go together, or a topic has to be chosen.
    InputError
        If the configuration that they record is not valid.
    """
    recorded = recorded_run(recordings, reading) if methods.is_default else None
    if recorded is None:
        variants = methods.variants(configured_first=True)
        listener = make_listener(variants)
        comparison = Evaluator(variants, reading, observer).compare(recordings, labels, listeners=[listener])
        return comparison, listener
    listener = make_listener([recorded.variant])
    reader = ReplayReader(recorded.variant, reading, observer, listener)
    chosen = zip(recordings, recorded.topics, labels, strict=True)
    return Comparison([recorded.variant], [reader.run(*one) for one in chosen]), listener


@dataclass(frozen=True)
class RecordedRun:
    """What filtered logs have in common.

    Parameters
    ----------
    variant : Variant
        The method and configuration that they record.
    topics : sequence of str
        The raw topic of each.
    """

    variant: Variant
    topics: Sequence[str]


def recorded_run(recordings: Sequence[Recording], reading: ReadOptions) -> RecordedRun | None:
    """Return what recordings have in common that are filtered logs; None if they are raw ones.

    Raises
    ------
    UsageError
        If they do not go together, or a topic has to be chosen.
    InputError
        If the configuration that they record is not valid.
    """
    runs = [_recorded(recording, reading) for recording in recordings]
    known = [run for run in runs if run]
    if not known:
        return None
    for recording, run in zip(recordings, runs, strict=True):
        if run is None or run[1] != known[0][1]:
            raise UsageError(f"{recording.name}: was not filtered as others here were: make a report of each")
    try:
        config = parse_config(known[0][1], f"{recordings[0].name}, recorded configuration")
    except ConfigError as error:
        raise InputError(str(error)) from error
    return RecordedRun(Variant(config.method, config), [topic for topic, _ in known])


def _recorded(recording: Recording, reading: ReadOptions) -> tuple[str, str] | None:
    """Return the raw topic and the configuration of a filtered log; None of a raw one."""
    with closing(reading.open(recording)) as source:
        topics = [topic for topic in filtered_topics(source) if not reading.topics or topic in reading.topics]
        if not topics:
            if was_filtered(source, reading.topics):
                raise InputError(
                    f"{source.name}: was filtered already, and what was removed is not in it; take the raw log, or "
                    "one filtered with --keep-raw --with-removed; -m none shows what is left"
                )
            return None
        if len(topics) > 1:
            raise UsageError(f"{source.name}: several filtered topics; choose from: -t {' -t '.join(topics)}")
        return topics[0], recorded_config(source) or ""


@dataclass(frozen=True)
class ReplayReader:
    """Reads filtered logs back, and compares them with labels if there are any.

    Parameters
    ----------
    variant : Variant
        The method and configuration that the logs record.
    reading : ReadOptions
        What is read.
    observer : Observer
        Receives progress and warnings.
    listener : ReplayListener
        Receives every frame.
    """

    variant: Variant
    reading: ReadOptions
    observer: Observer
    listener: ReplayListener

    def run(self, recording: Recording, topic: str, labels: Labels | None) -> Evaluated:
        """Read one recording; an error of its own goes into the outcome."""
        summary = Summary()
        outcome = Evaluated(recording=recording.name, methods={self.variant.name: summary})
        self.listener.begin(recording.name)
        with keeping_errors(outcome, self.observer), opened(recording, self.reading, self.observer, outcome) as source:
            self._stream(source, topic, labels, summary)
        return outcome

    def _stream(self, source: Source, topic: str, labels: Labels | None, summary: Summary) -> None:
        selection = self.reading.selection
        total = sum(source.counts.get(channel.id, 0) for channel in source.channels if channel.topic == topic)
        if (selection.start_s, selection.end_s) == (None, None):
            self.listener.expect(min(selection.frames or total, total))
        found = False
        with self.observer.progress(source.name, selection.frames or total or None) as step:
            for one in replay(source, topic, selection):
                self._take(one, labels, summary)
                step()
                found = True
        if not found:
            reason = source.damage[0] if source.damage else f"{topic} has no frame with all that the filter wrote of it"
            raise InputError(f"{source.name}: nothing to show; {reason}")
        finish_labels(labels, source, selection)

    def _take(self, one: Replayed, labels: Labels | None, summary: Summary) -> None:
        truth = labels.truth(one.frame) if labels else None
        score = None
        if truth is not None:
            score = score_frame(one.frame, [one.result], truth, self.variant.config.evaluation)[0]
        if score is not None:
            summary.add(score, None)
        else:
            summary.unlabelled += 1
        self.listener.add(one.frame, [one.numbers], truth, [score], lambda: [one.result])
