"""``seaclutter info``: what a log holds."""

import json
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.console import Progress, fail, report_damage, share, table, warn
from seaclutter_cli.commands.options import decoding_options, logs_argument, output_options, selection_options
from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.text import printable

if TYPE_CHECKING:
    from seaclutter_cli.interfaces import Source
    from seaclutter_cli.pipeline import Selection
    from seaclutter_cli.records import Channel, Damage, SensorFacts
    from seaclutter_cli.sources import Recording
    from seaclutter_cli.survey import TopicSurvey

_NANO = 1_000_000_000
_DEFAULT_THRESHOLD = 4


@click.command(short_help="Show what a log holds and what a filter run would need to be told.")
@logs_argument
@selection_options
@output_options
def command(logs: tuple[str, ...], **options: Any) -> None:
    """Show what LOGS hold: topics, frames, fields, extents, and what a filter run would need to be told.

    Every frame is read; -n N stops after the first N.
    """
    from seaclutter_cli.pipeline import Selection
    from seaclutter_cli.sources import find_recordings

    chosen = ("topics", "start_s", "end_s", "frames", "intensity_field")
    selection = Selection(**{name: options[name] for name in chosen})
    contents = [_look(recording, selection, options) for recording in find_recordings(logs)]
    if options["as_json"]:
        click.echo(json.dumps([content.as_dict() for content in contents], indent=2))
    elif read := [content.as_text() for content in contents if not content.error]:
        click.echo("\n\n".join(read))
    if any(content.error for content in contents):
        raise click.exceptions.Exit(1)
    if any(content.damage for content in contents):
        raise click.exceptions.Exit(3)


@dataclass
class Content:
    """What a recording holds."""

    recording: str
    path: str
    format: str = ""
    channels: Sequence["Channel"] = ()
    messages: Counter[str] = field(default_factory=Counter)
    times_ns: list[int] = field(default_factory=list)
    clouds: Mapping[str, "TopicSurvey"] = field(default_factory=dict)
    facts: Mapping[str, "SensorFacts"] = field(default_factory=dict)
    damage: Sequence["Damage"] = ()
    error: str | None = None

    def note_time(self, time_ns: int) -> None:
        """Widen the recording's extent in time."""
        self.times_ns = [min([time_ns, *self.times_ns]), max([time_ns, *self.times_ns])]

    @property
    def duration_s(self) -> float:
        """Seconds from the first message to the last."""
        return (self.times_ns[1] - self.times_ns[0]) / _NANO if self.times_ns else 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return the content as JSON holds it."""
        topics = [
            {"topic": c.topic, "type": c.schema.name if c.schema else None, "encoding": c.message_encoding}
            for c in self.channels
        ]
        return {
            "recording": self.recording,
            "path": self.path,
            "format": self.format,
            "duration_s": self.duration_s,
            "start_ns": self.times_ns[0] if self.times_ns else None,
            "topics": [{**topic, "messages": self.messages[str(topic["topic"])]} for topic in topics],
            "clouds": {topic: survey.as_dict() for topic, survey in self.clouds.items()},
            "sensors": {topic: asdict(facts) for topic, facts in self.facts.items()},
            "needs": self.needs(),
            "damage": [str(item) for item in self.damage],
            "error": self.error,
        }

    def as_text(self) -> str:
        """Return the content as people read it."""
        began = ""
        if self.times_ns and self.times_ns[0] > _NANO * 86400 * 365:
            began = f", from {datetime.fromtimestamp(self.times_ns[0] / _NANO, UTC):%Y-%m-%d %H:%M:%S} UTC"
        lines = [f"{self.path}: {self.format}, {self.duration_s:.1f} s{began}"]
        rows = {c.topic: (c.topic, self.messages[c.topic], c.schema.name if c.schema else "-") for c in self.channels}
        lines.append(table(("topic", "messages", "type"), list(rows.values())))
        lines += [_describe(topic, survey, self.facts.get(topic)) for topic, survey in self.clouds.items()]
        lines += [printable(need) for need in self.needs()]
        return "\n".join(lines)

    def needs(self) -> list[str]:
        """Return what a filter run would need to be told, a line each."""
        needs = []
        if len(self.clouds) > 1:
            choices = " ".join(f"-t {topic}" for topic in self.clouds)
            needs.append(f"a filter run needs to know which topics: {choices}")
        for topic, survey in self.clouds.items():
            if survey.problem:
                needs.append(f"{topic}: {survey.problem}")
            elif survey.frames and survey.intensity_name is None:
                needs.append(f"{topic} has no intensity field of a usual name: name one with --intensity-field")
            elif survey.frames and survey.intensity[1] < _DEFAULT_THRESHOLD:
                least, most = survey.intensity
                needs.append(f"{topic}: intensities of {least:g} to {most:g} need thresholds of their own (-c)")
        if not self.clouds:
            needs.append("there are no point clouds that can be read")
        return needs


def _describe(topic: str, survey: "TopicSurvey", facts: "SensorFacts | None") -> str:
    least, middle, most = survey.sizes()
    rate = f" at {survey.rate_hz:.2f} Hz" if survey.rate_hz else ""
    rows = [
        ("frames", f"{survey.frames}{rate}, frame id {survey.frame_id!r}"),
        (
            "points",
            f"{least:,} to {most:,} a frame, median {middle:,.0f}; {share(survey.invalid, survey.points)} invalid",
        ),
        ("fields", ", ".join(f"{f.name} {f.type}{f'x{f.count}' if f.count > 1 else ''}" for f in survey.fields)),
        ("intensity", f"{survey.intensity_name or 'none'}{_span(survey.intensity)}"),
        ("range", f"{_span(survey.range_m).strip() or 'none'} m"),
        ("sensor", f"like {' or '.join(survey.sensors)}" if survey.sensors else "not recognised"),
    ]
    if facts:
        told = (f"{name}: {text}" for name, text in facts.details.items())
        rows[-1] = ("sensor", "; ".join((facts.model, *told)))
        rows.append(("packets", f"{facts.lost_packets:,} missing, {facts.bad_packets:,} not decodable"))
    return "\n".join((printable(topic), *(_wrap(f"  {name:<10} {text}") for name, text in rows)))


def _wrap(line: str) -> str:
    return textwrap.fill(
        printable(line), 79, subsequent_indent=" " * 13, break_on_hyphens=False, break_long_words=False
    )


def _span(limits: Sequence[float]) -> str:
    return f" {limits[0]:g} to {limits[1]:g}" if limits[0] <= limits[1] else ""


def _look(recording: "Recording", selection: "Selection", options: Mapping[str, Any]) -> Content:
    content = Content(recording.name, str(recording.paths[0]))
    try:
        with closing(recording.open(rate_hz=options["rate_hz"], decoding=decoding_options(options))) as source:
            _read(source, content, selection, quiet=options["quiet"])
            content.damage = source.damage
            report_damage(source.damage, verbose=options["verbose"])
    except SeaclutterError as error:
        content.error = str(error)
        fail(error)
    return content


def _read(source: "Source", content: Content, selection: "Selection", *, quiet: bool) -> None:
    from seaclutter_cli.messages import find_codec
    from seaclutter_cli.pipeline import read
    from seaclutter_cli.records import Message
    from seaclutter_cli.survey import TopicSurvey

    content.format, content.channels = source.format, source.channels
    told = len(source.warnings)
    for text in source.warnings:
        warn(text, quiet=quiet)
    clouds = [c for c in source.channels if find_codec(c) and (not selection.topics or c.topic in selection.topics)]
    surveys = {channel.topic: TopicSurvey() for channel in clouds}
    content.clouds = surveys
    total = sum(source.counts.get(channel.id, 0) for channel in clouds)
    with Progress(selection.frames or total or None, source.name, quiet=quiet) as progress:
        for record, frame in read(source, clouds, selection):
            if isinstance(record, Message):
                content.messages[record.channel.topic] += 1
                content.note_time(record.log_time_ns)
            if frame is not None:
                surveys[frame.topic].add(frame)
                progress.step()
    for text in source.warnings[told:]:
        warn(text, quiet=quiet)
    content.facts = getattr(source, "facts", {})
