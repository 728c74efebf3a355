"""``seaclutter filter``: the main job."""

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.console import Progress, report_damage, share, told_errors, warn
from seaclutter_cli.commands.options import (
    config_options,
    decoding_options,
    force_option,
    logs_argument,
    output_options,
    selection_options,
)
from seaclutter_cli.commands.sensor_facts import mismatches
from seaclutter_cli.commands.truths import label_options
from seaclutter_cli.errors import InputError, UsageError
from seaclutter_cli.text import printable

if TYPE_CHECKING:
    from seaclutter_cli.commands.outcome import Outcome
    from seaclutter_cli.config import Config
    from seaclutter_cli.frame import FilterResult
    from seaclutter_cli.interfaces import Labels, Sink, Source
    from seaclutter_cli.pipeline import Selection, TopicTally
    from seaclutter_cli.sensors.packets import DecoderOptions
    from seaclutter_cli.sinks import McapOptions
    from seaclutter_cli.sources import Recording

_COMPRESSIONS = {"zstd": "zstd", "lz4": "lz4", "none": ""}


@click.command(name="filter", short_help="Filter logs into drop-in MCAP files.")
@logs_argument
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="OUT",
    help="File for one recording, folder for several.",
)
@force_option
@config_options
@selection_options
@click.option("--csv", "csv_file", type=click.Path(path_type=Path), metavar="FILE", help="Also write a line a frame.")
@click.option("--keep-raw", is_flag=True, help="Leave the raw cloud on its topic; write to TOPIC/filtered.")
@click.option("--with-removed", is_flag=True, help="Write removed points to TOPIC/removed, with their reason.")
@click.option("--keep-organized", is_flag=True, help="Keep the shape of organised clouds; removed points become NaN.")
@click.option("--diagnostics/--no-diagnostics", default=True, help="Write /seaclutter/diagnostics, or leave it out.")
@click.option("--with-scene", is_flag=True, help="Write boxes around clusters to /seaclutter/scene, for 3D panels.")
@label_options(required=False)
@click.option(
    "--compression",
    type=click.Choice(list(_COMPRESSIONS)),
    help="Of the output; by default that of the input, or zstd.",
)
@output_options
def command(logs: tuple[str, ...], output: Path, **options: Any) -> None:
    """Stream each frame of LOGS through the filter and write filtered MCAP files.

    LOGS are MCAP files, ROS bags, rosbag2 folders, captures of packets (PCAP, PCAPNG), folders of frames, or globs.
    Every other topic, attachment and metadata record is copied untouched, so the output is a drop-in for the input.
    """
    from seaclutter_cli.commands.outputs import plan_outputs, refuse_overwriting
    from seaclutter_cli.sinks import CsvSink
    from seaclutter_cli.sources import find_recordings

    job = Job.of(options)
    recordings = find_recordings(logs)
    targets = plan_outputs(recordings, output)
    labels = _labels(recordings, options)
    csv_file: Path | None = options["csv_file"]
    refuse_overwriting([*targets, *([csv_file] if csv_file else [])], recordings, force=options["force"])
    with ExitStack() as stack:
        rings = len(job.config.ring_edges[1:])
        sinks = [stack.enter_context(CsvSink(csv_file, rings, scenes=job.config.has_scenes))] if csv_file else []
        jobs = zip(recordings, targets, labels, strict=True)
        outcomes = [job.run(recording, target, sinks, truth) for recording, target, truth in jobs]
    if options["as_json"]:
        click.echo(json.dumps([outcome.as_dict() for outcome in outcomes], indent=2))
    elif done := [outcome.as_text() for outcome in outcomes if not outcome.error]:
        click.echo("\n\n".join(done))
    if any(outcome.error for outcome in outcomes):
        raise click.exceptions.Exit(1)
    if any(outcome.damage for outcome in outcomes):
        raise click.exceptions.Exit(3)


def _labels(recordings: Sequence["Recording"], options: Mapping[str, Any]) -> "Sequence[Labels | None]":
    """Return the labels of the recordings; None for all where there are none."""
    from seaclutter_cli.commands.truths import labels_for

    if not options["label_paths"]:
        return [None] * len(recordings)
    if not options["with_scene"]:
        raise UsageError("--labels: a filter run needs none; they are for the boxes of --with-scene")
    return labels_for(recordings, options["label_paths"], options)


@dataclass(frozen=True)
class Job:
    """All that is the same for every recording of a run."""

    config: "Config"
    selection: "Selection"
    file_options: "McapOptions"
    with_scene: bool
    decoding: "DecoderOptions"
    rate_hz: float
    quiet: bool
    verbose: bool

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> "Job":
        """Make a job of command-line options."""
        from seaclutter_cli.config import load_config
        from seaclutter_cli.pipeline import Selection
        from seaclutter_cli.sinks import McapOptions

        config = load_config(options["config_file"], method=options["method"], overrides=options["overrides"])
        chosen = ("topics", "start_s", "end_s", "frames", "intensity_field")
        written = ("keep_raw", "with_removed", "keep_organized", "diagnostics")
        return cls(
            config,
            Selection(**{name: options[name] for name in chosen}),
            McapOptions(
                **{name: options[name] for name in written},
                compression=_COMPRESSIONS.get(options["compression"]),
                config=config.to_yaml(),
            ),
            options["with_scene"],
            decoding_options(options),
            *(options[name] for name in ("rate_hz", "quiet", "verbose")),
        )

    def run(
        self, recording: "Recording", target: Path, sinks: Sequence["Sink"], labels: "Labels | None" = None
    ) -> "Outcome":
        """Filter one recording; an error of its own is told and kept, so that the others are filtered all the same."""
        from seaclutter_cli.commands.outcome import Outcome

        outcome = Outcome(recording.name, target, self.config.ring_edges)
        with (
            told_errors(outcome),
            closing(recording.open(rate_hz=self.rate_hz, decoding=self.decoding)) as source,
        ):
            self._stream(source, outcome, sinks, labels)
            outcome.damage = source.damage
            report_damage(source.damage, verbose=self.verbose)
        return outcome

    def _stream(self, source: "Source", outcome: "Outcome", sinks: Sequence["Sink"], labels: "Labels | None") -> None:
        from seaclutter_cli.filters.fit import IntensityFit
        from seaclutter_cli.pipeline import cloud_channels, is_remainder, run
        from seaclutter_cli.sinks import McapSink

        clouds = cloud_channels(source, self.selection.topics)
        if labels and len({channel.topic for channel in clouds}) > 1:
            raise UsageError(f"{source.name}: labels are of one topic; choose one with -t")
        if self.config.method != "none" and is_remainder(source, self.selection.topics):
            warn(f"{source.name}: was filtered already; this filters what was left of it", quiet=self.quiet)
        told = len(source.warnings)
        for text in source.warnings:
            warn(text, quiet=self.quiet)
        if self.verbose:
            topics = ", ".join(channel.topic for channel in clouds)
            click.echo(f"{source.name}: {source.format}, method {self.config.method} on {printable(topics)}", err=True)
        fits = {channel.topic: IntensityFit() for channel in clouds}
        total = sum(source.counts.get(channel.id, 0) for channel in clouds)
        progress = Progress(self.selection.frames or total or None, source.name, quiet=self.quiet)

        def on_frame(result: "FilterResult") -> None:
            progress.step()
            self._warn(fits[result.frame.topic].add(result), result.frame.topic)

        with progress, McapSink(outcome.output, self._options_of_file(labels)) as sink:
            outcome.topics = run(source, self.config.make_filter, [sink, *sinks], self.selection, on_frame)
            if not outcome.frames and source.damage:
                raise InputError(f"{source.name}: no frame can be read; {source.damage[0]}")
        for text in (*source.warnings[told:], *mismatches(self.config.sensor, source)):
            warn(text, quiet=self.quiet)
        for topic, fit in fits.items():
            self._warn(fit.verdict() or _nothing_left(outcome.topics[topic]), topic)

    def _options_of_file(self, labels: "Labels | None") -> "McapOptions":
        if not self.with_scene:
            return self.file_options
        from seaclutter_cli.reporting.scene import scene_maker

        return replace(self.file_options, scene=scene_maker(self.config.evaluation, labels))

    def _warn(self, text: str | None, topic: str) -> None:
        if text:
            warn(f"{topic}: {text}", quiet=self.quiet)


def _nothing_left(tally: "TopicTally") -> str | None:
    """Return a warning if not one point of a topic was kept."""
    from seaclutter_cli.frame import Reason

    most = Reason(int(tally.counts.argmax()))
    if not tally.points_in or tally.counts[Reason.KEPT]:
        return None
    what = most.name.lower().replace("_", " ")
    return f"no point is left; {share(int(tally.counts[most]), tally.points_in)} were removed as {what}"
