"""Filtered logs read back: which logs are such, and a job that reads them as `judging.Job` filters raw ones."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from seaclutter_cli.commands.comparison import Evaluated
from seaclutter_cli.commands.console import Progress, report_damage, told_errors
from seaclutter_cli.commands.judging import Job
from seaclutter_cli.commands.options import decoding_options
from seaclutter_cli.commands.variants import Variant
from seaclutter_cli.config import parse_config
from seaclutter_cli.errors import ConfigError, InputError, UsageError
from seaclutter_cli.evaluation.scores import Summary, score_frame
from seaclutter_cli.pipeline import is_remainder
from seaclutter_cli.reporting.replay import Replayed, filtered_topics, recorded_config, replay

if TYPE_CHECKING:
    from seaclutter_cli.interfaces import Labels, Source
    from seaclutter_cli.reporting.audience import Audience
    from seaclutter_cli.sources import Recording


@dataclass(frozen=True)
class FilterRun:
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


def filter_run(recordings: "Sequence[Recording]", options: Mapping[str, Any]) -> FilterRun | None:
    """Return what recordings have in common that are filtered logs; None if they are raw ones.

    Raises
    ------
    UsageError
        If they do not go together, or a topic has to be chosen.
    InputError
        If the configuration that they record is not valid.
    """
    runs = [_recorded(recording, options) for recording in recordings]
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
    return FilterRun(Variant(config.method, config), [topic for topic, _ in known])


def _recorded(recording: "Recording", options: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the raw topic and the configuration of a filtered log; None of a raw one."""
    with closing(recording.open(rate_hz=options["rate_hz"], decoding=decoding_options(options))) as source:
        topics = [topic for topic in filtered_topics(source) if not options["topics"] or topic in options["topics"]]
        if not topics:
            if is_remainder(source, options["topics"]):
                raise InputError(
                    f"{source.name}: was filtered already, and what was removed is not in it; take the raw log, or "
                    "one filtered with --keep-raw --with-removed; -m none shows what is left"
                )
            return None
        if len(topics) > 1:
            raise UsageError(f"{source.name}: several filtered topics; choose from: -t {' -t '.join(topics)}")
        return topics[0], recorded_config(source) or ""


class Reader:
    """Reads filtered logs, and compares them with labels if there are any.

    Parameters
    ----------
    job : Job
        Of the variant that the logs record.
    audience : Audience
        Is told of every frame.
    """

    def __init__(self, job: Job, audience: "Audience") -> None:
        self._job, self._audience = job, audience
        self._variant = job.variants[0]

    def run(self, recording: "Recording", topic: str, labels: "Labels | None") -> Evaluated:
        """Read one recording; an error of its own is told and kept."""
        outcome = Evaluated(recording.name, {self._variant.name: Summary()})
        with (
            told_errors(outcome),
            closing(recording.open(rate_hz=self._job.rate_hz, decoding=self._job.decoding)) as source,
        ):
            self._stream(source, topic, labels, outcome.methods[self._variant.name])
            outcome.damage = source.damage
            report_damage(source.damage, verbose=self._job.verbose)
        return outcome

    def _stream(self, source: "Source", topic: str, labels: "Labels | None", summary: Summary) -> None:
        selection = self._job.selection
        total = sum(source.counts.get(channel.id, 0) for channel in source.channels if channel.topic == topic)
        if (selection.start_s, selection.end_s) == (None, None):
            self._audience.expect(min(selection.frames or total, total))
        found = False
        with Progress(selection.frames or total or None, source.name, quiet=self._job.quiet) as progress:
            for one in replay(source, topic, selection):
                self._take(one, labels, summary)
                progress.step()
                found = True
        if not found:
            reason = source.damage[0] if source.damage else f"{topic} has no frame with all that the filter wrote of it"
            raise InputError(f"{source.name}: nothing to show; {reason}")
        part = (selection.start_s, selection.end_s, selection.frames)
        if labels and part == (None, None, None) and not source.damage:
            labels.finish()

    def _take(self, one: Replayed, labels: "Labels | None", summary: Summary) -> None:
        truth = labels.truth(one.frame) if labels else None
        score = None
        if truth is not None:
            score = score_frame(one.frame, [one.result], truth, self._variant.config.evaluation)[0]
        if score is not None:
            summary.add(score, None)
        else:
            summary.unlabelled += 1
        self._audience.add(one.frame, [one.numbers], truth, [score], lambda: [one.result])
