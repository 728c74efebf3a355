"""Raw logs filtered, or filtered logs read back, frame by frame for a listener."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import TypeVar

from seaclutter_cli.config import parse_config
from seaclutter_cli.errors import ConfigError, InputError, UsageError
from seaclutter_cli.evaluation.label_check import LabelCheck
from seaclutter_cli.evaluation.scores import Summary, score_frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.reporting.history import FrameListener, ScoredFrame
from seaclutter_cli.reporting.replay import Replayed, filtered_topics, recorded_config, replay
from seaclutter_cli.runs.evaluate import Comparison, Evaluated, EvaluateWork
from seaclutter_cli.runs.methods import Variant, is_default
from seaclutter_cli.runs.methods import variants as variants_of
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options import ReadOptions
from seaclutter_cli.runs.options.methods import MethodOptions
from seaclutter_cli.runs.recordings import open_recording, require_frames
from seaclutter_cli.runs.studies import LabelledRecordings, StudyWork
from seaclutter_cli.selection import was_filtered
from seaclutter_cli.sources import Recording

L = TypeVar("L", bound=FrameListener)


def filter_or_replay(
    pairs: LabelledRecordings,
    methods: MethodOptions,
    reading: ReadOptions,
    observer: Observer,
    make_listener: Callable[[Sequence[Variant]], L],
) -> tuple[Comparison, L]:
    """Filter recordings, or read filtered ones back if no method is chosen, and pass every frame to a listener.

    Raises
    ------
    UsageError
        If filtered logs differ in their configuration, or a topic has to be chosen.
    InputError
        If the recorded configuration is not valid, or a filtered log lacks the removed points.
    """
    recordings = [recording for recording, _ in pairs]
    variant, topics = _recorded_run(recordings, reading) if is_default(methods) else (None, ())
    variants = [variant] if variant else variants_of(methods, configured_first=True)
    listener = make_listener(variants)
    works: list[StudyWork[Evaluated]] = (
        [_ReplayWork(reading, *pair, variant, topic, listener) for pair, topic in zip(pairs, topics, strict=True)]
        if variant
        else [EvaluateWork(reading, *pair, variants, [listener]) for pair in pairs]
    )
    return Comparison(variants, [work.run(observer) for work in works]), listener


def _recorded_run(recordings: Sequence[Recording], reading: ReadOptions) -> tuple[Variant | None, Sequence[str]]:
    """Return the method of filtered logs, and the raw topic of each; None for raw logs."""
    runs = [_recorded(recording, reading) for recording in recordings]
    known = [run for run in runs if run]
    if not known:
        return None, ()
    for recording, run in zip(recordings, runs, strict=True):
        if run is None or run[1] != known[0][1]:
            raise UsageError(
                f"{recording.name}: not filtered in the same way as the other logs; process each one alone"
            )
    try:
        config = parse_config(known[0][1], f"{recordings[0].name}, recorded configuration")
    except ConfigError as error:
        raise InputError(str(error)) from error
    return Variant(config.method, config), [topic for topic, _ in known]


def _recorded(recording: Recording, reading: ReadOptions) -> tuple[str, str] | None:
    """Return the raw topic and the configuration of a filtered log; None for a raw log."""
    with closing(open_recording(recording, reading)) as source:
        topics = [topic for topic in filtered_topics(source) if not reading.topics or topic in reading.topics]
        if not topics:
            if was_filtered(source, reading.topics):
                raise InputError(
                    f"{source.name}: already filtered, and the log lacks the removed points; use the raw log or one "
                    "filtered with --keep-raw --with-removed, or show the remaining points with -m none"
                )
            return None
        if len(topics) > 1:
            raise UsageError(f"{source.name}: several filtered topics; choose from: -t {' -t '.join(topics)}")
        return topics[0], recorded_config(source) or ""


@dataclass(frozen=True)
class _ReplayWork(StudyWork[Evaluated]):
    """Reading of a filtered log for a listener, and comparison with its labels if there are any."""

    variant: Variant
    topic: str
    listener: FrameListener

    def without_result(self, reason: str | None) -> Evaluated:
        """Return an outcome without frames."""
        return Evaluated(recording=self.recording.name, methods={self.variant.name: Summary()}, error=reason)

    def run(self, observer: Observer) -> Evaluated:
        """Read the recording, also for the listener; store an error in the outcome."""
        self.listener.begin(self.recording.name)
        return super().run(observer)

    def study(self, source: Source, labels: Labels | None, outcome: Evaluated, observer: Observer) -> None:
        """Read all frames."""
        selection, (summary,) = self.reading.selection, outcome.methods.values()
        total = sum(source.counts.get(channel.id, 0) for channel in source.channels if channel.topic == self.topic)
        found, check = False, LabelCheck(self.variant.config.evaluation)
        with observer.progress(source.name, selection.frames or total or None) as step:
            for one in replay(source, self.topic, selection):
                self._add(one, labels, summary, check)
                step()
                found = True
        if not found:
            require_frames(source, 0, selection)
            reason = (
                source.damage[0] if source.damage else f"no frame of {self.topic} has removed points and diagnostics"
            )
            raise InputError(f"{source.name}: nothing to show; {reason}")
        self.finish(source, labels, 1)
        for finding in check.findings(summary.targets, summary.visible):
            observer.warn(f"{source.name}: labels: {finding.text}")

    def _add(self, one: Replayed, labels: Labels | None, summary: Summary, check: LabelCheck) -> None:
        truth = labels.truth(one.frame) if labels else None
        score = None
        if truth is not None:
            check.add(one.frame, truth)
            score = score_frame(one.frame, [one.result], truth, self.variant.config.evaluation)[0]
        if score is not None:
            summary.add(score, None)
        else:
            summary.unlabelled += 1
        self.listener.add(ScoredFrame(one.frame, [one.statistics], truth, [score], lambda: [one.result]))
