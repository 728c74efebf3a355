"""Conversion of recordings to other formats."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING

from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.frame import Reason
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.messages import find_codec
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.reading import read
from seaclutter_cli.records import Channel
from seaclutter_cli.runs.log_work import LogOutcome, LogRun, LogSummary, LogWork
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import ConvertOptions
from seaclutter_cli.runs.recordings import expected_frames
from seaclutter_cli.runs.resume import identity_of
from seaclutter_cli.selection import Selection, cloud_channels
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.sinks.options import McapOptions
from seaclutter_cli.text import count, printable

if TYPE_CHECKING:
    from seaclutter_cli.runs.log_work import OutputSink


@use_case_of(ConvertOptions)
def convert_log(options: ConvertOptions) -> "ConvertSummary":
    """Convert one or several logs to another format, without filtering.

    Returns
    -------
    ConvertSummary
        Outcome of each recording: messages, frames, points, what was lost, damage, seconds.

    Examples
    --------
    >>> import seaclutter
    >>> done = seaclutter.convert_log("samples/sea.mcap", folder / "sea.bag")
    >>> done.outcomes[0].messages, done.outcomes[0].lost
    (60, ['sequence numbers'])
    """
    started, observer = perf_counter(), options.watching
    run = LogRun(options, observer, ConvertWork)
    outcomes = run.do(run.begin())
    run.list_outputs(outcomes)
    return ConvertSummary(outcomes, perf_counter() - started)


@dataclass(frozen=True)
class ConvertWork(LogWork["ConvertOutcome", ConvertOptions]):
    """Conversion of one recording."""

    def clouds(self, source: Source) -> list[Channel]:
        """Return the channels of the clouds that are converted as frames, and counted."""
        selection, has_topics = self.reading.selection, OUTPUT_FORMATS[self.form].has_topics
        clouds = [channel for channel in source.channels if find_codec(channel)]
        if selection.topics or selection.frames or not has_topics:
            every = has_topics and not selection.topics
            return cloud_channels(source, {channel.topic for channel in clouds} if every else selection.topics)
        return [channel for channel in clouds if self.options.written.takes(channel.topic)]

    def without_result(self, reason: str | None) -> "ConvertOutcome":
        """Return an outcome without frames."""
        return ConvertOutcome(
            recording=self.recording.name, output=self.output, form=self.form, bytes_in=self.input_bytes, error=reason
        )

    def identity(self) -> Mapping[str, str]:
        """Return what the output depends on."""
        return identity_of(self, self.options.written, None, convert_to=self.form)

    def sink_options(self, options: McapOptions, labels: Labels | None) -> McapOptions:  # noqa: ARG002
        """Return the options of an output to which nothing is added."""
        return replace(options, as_is=True)

    def stream(
        self, source: Source, selection: Selection, outcome: "ConvertOutcome", sink: "OutputSink", observer: Observer
    ) -> int:
        """Copy the records, and count the frames."""
        clouds = self.clouds(source)
        outcome.topics |= {channel.topic: TopicTally() for channel in clouds}
        with observer.progress(source.name, expected_frames(source, clouds, selection)) as step:
            sink.begin(source, clouds)
            for item, frame in read(source, clouds, selection, with_latched=True):
                if frame is None:
                    sink.copy(item)
                    continue
                sink.keep(frame)
                tally = outcome.topics[frame.topic]
                tally.frames += 1
                tally.points_in += frame.size
                tally.counts[Reason.KEPT] += frame.size
                step()
            sink.end()
        outcome.messages = sink.messages
        return outcome.frames if clouds else outcome.messages


@dataclass(kw_only=True)
class ConvertOutcome(LogOutcome):
    """Outcome of the conversion of one recording to the format ``form``.

    ``messages`` is the number of messages that were written; 0 if the output is that of an earlier run.
    """

    data = "recording status output=written_to format=form error damage seconds=rounded_s messages topics=sums lost"

    form: str
    messages: int = 0

    def amounts(self) -> str:
        """Return messages, frames and points."""
        return f"{count(self.messages, 'message')}, {count(self.frames, 'frame')} of {count(self.points_in, 'point')}"

    @property
    def sums(self) -> dict[str, dict[str, int]]:
        """Frames and points of each topic."""
        return {topic: {"frames": tally.frames, "points": tally.points_in} for topic, tally in self.topics.items()}

    def as_text(self) -> str:
        """Return the outcome as human-readable text."""
        if self.skipped:
            return f"{printable(self.recording)}: {self.figures()}"
        lines = [printable(f"{self.recording} -> {self.output}")]
        lines += [
            f"  {printable(topic)}: {count(tally.frames, 'frame')}, {count(tally.points_in, 'point')}"
            for topic, tally in self.topics.items()
        ]
        return "\n".join([*lines, f"{count(self.messages, 'message')} in {self.seconds:.1f} s"])


class ConvertSummary(LogSummary[ConvertOutcome]):
    """Outcomes of the conversion of several recordings."""
