"""Content of recordings: topics, frames, fields, extents, sensors, and settings that a filter run needs."""

import math
import textwrap
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from seaclutter_cli.buckets import mirror_of, use_case_of
from seaclutter_cli.errors import InputError
from seaclutter_cli.messages import find_codec, main_clouds
from seaclutter_cli.reading import read
from seaclutter_cli.records import Channel, Message, SensorFacts
from seaclutter_cli.runs.batch import Work, run_all
from seaclutter_cli.runs.checks import impossible
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options import ReadOptions
from seaclutter_cli.runs.options.logs import InfoOptions
from seaclutter_cli.runs.recordings import RecordingsResult, expand, expected_frames, opened, statuses
from seaclutter_cli.runs.surroundings import Surroundings, smallest
from seaclutter_cli.runs.topic_statistics import Described, TopicStatistics
from seaclutter_cli.selection import hint_of
from seaclutter_cli.sources.mcap.excerpt import Excerpt, excerpt
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.text import count, printable, share, table

_NANO = 1_000_000_000
_DEFAULT_THRESHOLD = 4


@use_case_of(InfoOptions)
def info(options: InfoOptions) -> "InfoResult":
    """Return the content of logs: topics, frames, fields, extents, sensors, and settings that a filter run needs.

    Examples
    --------
    >>> import seaclutter
    >>> (content,) = seaclutter.info("samples/sea.mcap").outcomes
    >>> content.format, content.clouds["/points"].frames, content.clouds["/points"].intensity
    ('MCAP', 60, [1.0, 255.0])
    """
    observer = options.watching
    recordings = expand(options, observer, ahead=False)  # an excerpt may suffice
    works = [_InfoWork(options.reading, recording) for recording in recordings]
    result = InfoResult(run_all(works, options, observer))
    if result.failed and not any(content.error for content in result.outcomes):
        where = result.outcomes[0].recording if len(works) == 1 else count(len(works), "recording")
        options.observer.fail(InputError(f"{where}: no point clouds that can be read"))
    return result


@dataclass(frozen=True)
class _InfoWork(Work["Content"]):
    reading: ReadOptions
    recording: Recording

    def fill(self, outcome: "Content", observer: Observer) -> None:
        part = excerpt_of(self.recording) if self.reading.selection.is_whole else None
        with opened(self.recording, self.reading, observer, outcome) as source:
            outcome.format, outcome.channels, outcome.has_times = source.format, source.channels, source.has_times
            selection, topics = self.reading.selection, self.reading.topics
            clouds = [c for c in source.channels if find_codec(c) and (not topics or c.topic in topics)]
            outcome.clouds = {channel.topic: TopicStatistics(around=Surroundings()) for channel in clouds}
            with observer.progress(source.name, expected_frames(source, clouds, selection)) as step:
                for record, frame in read(source, clouds, selection, unreadable=outcome.unreadable):
                    if isinstance(record, Message):
                        outcome.messages[record.channel.topic] += 1
                        outcome.note_time(record.log_time_ns)
                    if frame is not None:
                        outcome.clouds[frame.topic].add(frame)
                        step()
            if part:  # of the whole recording
                outcome.sampled, outcome.times_ns = True, [part.start_ns, part.end_ns]
                outcome.messages = Counter[str]()
                for channel in outcome.channels:
                    outcome.messages[channel.topic] += part.messages.get(channel.id, 0)

    def without_result(self, reason: str | None) -> "Content":
        return Content(recording=self.recording.name, path=str(self.recording.paths[0]), error=reason)


def excerpt_of(recording: Recording) -> Excerpt | None:
    """Let a large recording in object storage consist of its first frames; None if it is another one."""
    first, *others = recording.paths
    mirror = mirror_of(first)
    if mirror is None or others or not (parts := mirror.parts(first)):
        return None
    part = excerpt(*parts)
    if part is not None:
        mirror.fill(first, part.data)
    return part


@dataclass(kw_only=True)
class Content(Described):
    """Content of a recording: its topics with their messages and, for clouds, statistics.

    ``unreadable`` says why the clouds of a topic cannot be read. If it is ``sampled``, only the first frames were read,
    but messages and times are of the whole recording.
    """

    data = "recording path format sampled duration_s start_ns topics clouds sensors=facts needs damage error"

    path: str
    format: str = ""
    channels: Sequence[Channel] = ()
    messages: Counter[str] = field(default_factory=Counter)
    unreadable: dict[str, str] = field(default_factory=dict)
    sampled: bool = False
    has_times: bool = True

    @property
    def duration_s(self) -> float:
        """Seconds from the first message to the last."""
        return (self.times_ns[1] - self.times_ns[0]) / _NANO if self.times_ns else 0.0

    @property
    def start_ns(self) -> int | None:
        """Log time of the first message."""
        return self.times_ns[0] if self.times_ns else None

    @property
    def topics(self) -> list[dict[str, Any]]:
        """Type, encoding and messages of each topic, and whether its clouds are decoded from packets."""
        return [
            {
                "topic": channel.topic,
                "type": channel.schema.name if channel.schema else None,
                "encoding": channel.message_encoding,
                "messages": self.messages[channel.topic],
                "decoded": channel.topic in self.facts and self.facts[channel.topic].from_packets,
            }
            for channel in self.channels
        ]

    @property
    def is_readable(self) -> bool:
        """Whether clouds of any topic can be read."""
        clouds = [cloud for topic, cloud in self.clouds.items() if topic not in self.unreadable]
        return any(not cloud.problem or cloud.range_m[0] < math.inf for cloud in clouds)

    def as_text(self) -> str:
        """Return the content as human-readable text."""
        began = ""
        if self.times_ns and self.times_ns[0] > _NANO * 86400 * 365:
            began = f", from {datetime.fromtimestamp(self.times_ns[0] / _NANO, UTC):%Y-%m-%d %H:%M:%S} UTC"
        lines = [printable(f"{self.path}: {self.format}, {self.duration_s:.1f} s{began}")]
        types = {one["topic"]: "decoded from packets" if one["decoded"] else one["type"] or "-" for one in self.topics}
        lines.append(table(("topic", "messages", "type"), [(name, self.messages[name], types[name]) for name in types]))
        if self.sampled:
            lines.append("Only the first frames were read; -n N copies the log and reads N.")
        read = {topic: cloud for topic, cloud in self.clouds.items() if topic not in self.unreadable}
        rate = "" if self.has_times else " (no times; set by --rate)"
        lines += [_describe(topic, cloud, self.facts.get(topic), rate) for topic, cloud in read.items()]
        lines += [printable(need) for need in self.needs()]
        return "\n".join(lines)

    def line(self) -> str:
        """Return the error, if any; the result has a table of the contents."""
        return super().line() if self.error else ""

    def rows(self) -> list[tuple[str, ...]]:
        """Return a row of cells for each cloud topic, or one without a topic."""
        first = (self.recording, self.format, f"{self.duration_s:.1f}")
        rows: list[tuple[str, ...]] = []
        for topic, cloud in self.clouds.items():
            model, *others = cloud.sensor(self.facts.get(topic)).models or ("-",)
            sensor = f"{model} or others" if others else model
            rows.append((*first, topic, f"{cloud.frames:,}", f"{cloud.sizes()[1]:,.0f}", sensor))
        return rows or [(*first, "-", "-", "-", "-")]

    def needs(self) -> list[str]:
        """Return descriptions of the settings that a filter run needs, one line each."""
        needs = []
        main = [c.topic for c in main_clouds(c for c in self.channels if c.topic in self.clouds)]
        if len(set(main)) > 1:
            choices = " ".join(f"-t {topic}" for topic in dict.fromkeys(main))
            needs.append(f"several point-cloud topics; for a filter run, choose from: {choices}")
        for topic, cloud in self.clouds.items():
            if topic in self.unreadable:
                needs.append(self.unreadable[topic])
            elif cloud.problem:
                needs.append(f"{topic}: {cloud.problem}")
            elif why := impossible(*cloud.range_m):
                needs.append(f"{topic}: {why}")
            elif cloud.frames and cloud.intensity_name is None:
                needs.append(f"{topic}: no intensity field with a usual name; name one with --intensity-field")
            elif cloud.frames and cloud.invalid == cloud.points:
                needs.append(f"{topic}: the clouds contain no valid point, so there is nothing to filter")
            elif cloud.frames and cloud.intensity[1] < _DEFAULT_THRESHOLD:
                least, most = cloud.intensity
                other = f"; use --intensity-field {cloud.other_intensity}" if cloud.other_intensity else ""
                weak = f"intensities of {least:g} to {most:g} do not fit the default thresholds; use -c"
                needs.append(f"{topic}: {weak if most else f'{cloud.intensity_name} is always 0{other}'}")
        grounds = ((topic, cloud.around.ground) for topic, cloud in self.clouds.items() if cloud.around)
        needs += [f"{topic}: {land}" for topic, ground in grounds if (land := ground.warning())]
        if not self.clouds:
            needs.append(f"there are no point clouds that can be read{hint_of(self.channels)}")
        return needs


def _describe(topic: str, cloud: TopicStatistics, facts: SensorFacts | None, assumed: str) -> str:
    least, middle, most = cloud.sizes()
    rate = f" at {cloud.rate_hz:.2f} Hz{assumed}" if cloud.rate_hz else ""
    rows = [
        ("frames", f"{cloud.frames}{rate}" + f", frame id {cloud.frame_id!r}" * bool(cloud.frames)),
        (
            "points",
            f"{least:,} to {most:,} per frame, median {middle:,.0f}"
            + f"; {share(cloud.invalid, cloud.points)} invalid" * bool(cloud.points),
        ),
        ("fields", ", ".join(f"{f.name} {f.type}{f'x{f.count}' if f.count > 1 else ''}" for f in cloud.fields)),
        ("intensity", f"{cloud.intensity_name or 'none'}{_span(cloud.intensity)}"),
        ("range", "{:.1f} to {:.1f} m".format(*cloud.range_m) if _span(cloud.range_m) else "none"),
        ("sensor", str(cloud.sensor())),
    ]
    if facts:
        details = (f"{name}: {text}" for name, text in facts.details.items())
        rows[-1] = ("sensor", "; ".join((facts.model, *details)))
    if around := cloud.around:
        beams = smallest(cloud.sensor(facts).models, around.beams_deg, around.level_m)
        seen = {"own ship": around.own_ship(), "beams": beams}
        rows += [(name, text) for name, text in seen.items() if text]
    if facts and facts.from_packets:
        rows.append(("packets", f"{facts.lost_packets:,} missing, {facts.bad_packets:,} not decodable"))
    form = textwrap.TextWrapper(79, subsequent_indent=" " * 13, break_on_hyphens=False, break_long_words=False)
    return "\n".join((printable(topic), *(form.fill(printable(f"  {name:<10} {text}")) for name, text in rows)))


def _span(limits: Sequence[float]) -> str:
    return f" {limits[0]:g} to {limits[1]:g}" if limits[0] <= limits[1] else ""


class InfoResult(RecordingsResult[Content]):
    """Content of several recordings, as text and as data."""

    @property
    def failed(self) -> bool:
        """Whether any recording could not be processed, or no clouds of any can be read."""
        return super().failed or not any(content.is_readable for content in self.outcomes)

    def as_text(self) -> str:
        """Return the content of one recording, or a table of several, as human-readable text."""
        if len(self.outcomes) == 1:
            return self.details()
        rows = [row for content in self.outcomes if not content.error for row in content.rows()]
        head = ("recording", "format", "seconds", "cloud topic", "frames", "median points", "sensor")
        return "\n".join((*([table(head, rows)] if rows else []), statuses(self.outcomes)))
