"""A report's making: methods run over logs, or filtered logs read back, into one collection of what is to be seen."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from seaclutter_cli.commands.comparison import Comparison, Evaluated
from seaclutter_cli.commands.console import Progress, count, fail, report_damage, warn
from seaclutter_cli.commands.judging import Job
from seaclutter_cli.commands.options import decoding_options
from seaclutter_cli.commands.variants import COMPARISONS, Variant, choose_variants
from seaclutter_cli.config import parse_config
from seaclutter_cli.errors import ConfigError, InputError, SeaclutterError, UsageError, printable
from seaclutter_cli.evaluation.scores import Summary, score_frame
from seaclutter_cli.plots.report import FIGURES, draw_figures
from seaclutter_cli.reporting.collector import Collector, Method
from seaclutter_cli.reporting.data import report_data
from seaclutter_cli.reporting.page import render_page
from seaclutter_cli.reporting.replay import Replayed, filtered_topics, recorded_config, replay, was_filtered

if TYPE_CHECKING:
    from seaclutter_cli.interfaces import Labels, Source
    from seaclutter_cli.sources import Recording


@dataclass(frozen=True)
class Reported:
    """What a report is made of.

    Parameters
    ----------
    comparison : Comparison
        Figures of each method and recording.
    collected : Collector
        Numbers of all frames and points of some.
    """

    comparison: Comparison
    collected: Collector

    @property
    def outcomes(self) -> Sequence[Evaluated]:
        """What became of each recording."""
        return self.comparison.recordings

    @property
    def frames(self) -> int:
        """Frames of all recordings."""
        return len(self.collected.timeline.frame)

    def page(self) -> bytes:
        """Return the page; times are not in it, so that the same input gives the same bytes."""
        summaries = {name: summary.as_dict() for name, summary in self.comparison.totals().items()}
        for summary in summaries.values():
            del summary["filter_ms"]
        return render_page(report_data(self.collected, summaries, self._notes()))

    def pictures(self, folder: Path, form: str) -> dict[Path, bytes]:
        """Return the files of the figures that there is something to draw in."""
        return {folder / name: content for name, content in draw_figures(self.collected, form).items()}

    def _notes(self) -> list[str]:
        notes = [f"{outcome.recording} is left out: {outcome.error}" for outcome in self.outcomes if outcome.error]
        return notes + [f"Damaged: {item}" for outcome in self.outcomes for item in outcome.damage[:20]]

    def as_dict(self, sizes: Mapping[Path, int]) -> dict[str, Any]:
        """Return the outcome as JSON holds it."""
        timeline = self.collected.timeline
        shown = [
            {
                "recording": self.collected.recordings[timeline.recording[one.row]],
                "frame": one.item.frame,
                "why": one.why,
            }
            for one in self.collected.chosen
        ]
        files = [{"path": str(path), "bytes": size} for path, size in sizes.items()]
        return {"files": files, "frames": self.frames, "shown": shown, **self.comparison.as_dict()}

    def as_text(self, sizes: Mapping[Path, int]) -> str:
        """Return the outcome as people read it."""
        lines = [f"{printable(str(path))}: {size / 1e6:.1f} MB" for path, size in sizes.items()]
        lines.append(f"{count(self.frames)}, {len(self.collected.chosen)} of them to look at")
        return "\n".join(lines)


def picture_names(form: str) -> list[str]:
    """Return the names of all files that `Reported.pictures` can write."""
    return [f"{name}.{form}" for name in FIGURES]


def run_methods(
    recordings: "Sequence[Recording]", labels: "Sequence[Labels] | None", options: Mapping[str, Any]
) -> Reported:
    """Filter recordings by the methods that the command line names, all in one pass."""
    names = [name for comparison in options["comparisons"] for name in COMPARISONS[comparison]]
    variants = choose_variants([*names, *options["methods"]], options["config_file"], options["overrides"])
    job = Job.of(options, variants)
    collected = _collector(variants, options, labelled=labels is not None)
    outcomes = []
    for number, recording in enumerate(recordings):
        collected.begin(recording.name)
        outcomes.append(job.run(recording, labels[number] if labels else None, [], [collected]))
    return Reported(Comparison(variants, outcomes), collected)


def replayed(
    recordings: "Sequence[Recording]", labels: "Sequence[Labels] | None", options: Mapping[str, Any]
) -> Reported | None:
    """Read filtered logs back; None if the recordings are raw logs."""
    runs = [_filter_run(recording, options) for recording in recordings]
    if not any(runs):
        return None
    for recording, run in zip(recordings, runs, strict=True):
        if run is None or run[1] != runs[0][1]:  # type: ignore[index] # there is one, and UsageError is raised if not for all
            raise UsageError(f"{recording.name}: was not filtered as {recordings[0].name} was: make a report of each")
    topics, configs = zip(*(run for run in runs if run), strict=True)
    try:
        config = parse_config(configs[0], f"{recordings[0].name}, recorded configuration")
    except ConfigError as error:
        raise InputError(str(error)) from error
    variants = [Variant(config.method, config)]
    collected = _collector(variants, options, labelled=labels is not None)
    reader = _Reader(Job.of(options, variants), collected)
    outcomes = [
        reader.run(recording, topic, labels[number] if labels else None)
        for number, (recording, topic) in enumerate(zip(recordings, topics, strict=True))
    ]
    return Reported(Comparison(variants, outcomes), collected)


def _collector(variants: Sequence[Variant], options: Mapping[str, Any], *, labelled: bool) -> Collector:
    methods = [Method(one.name, one.config.ring_edges, one.config.to_yaml()) for one in variants]
    return Collector(
        methods, variants[0].config.evaluation, labelled=labelled, frames=options["shown"], picks=options["picks"]
    )


def _filter_run(recording: "Recording", options: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the raw topic and the configuration of a filtered log; None of a raw one."""
    with closing(recording.open(rate_hz=options["rate_hz"], decoding=decoding_options(options))) as source:
        topics = [topic for topic in filtered_topics(source) if not options["topics"] or topic in options["topics"]]
        if not topics:
            if was_filtered(source):
                text = "was filtered already, without --keep-raw --with-removed: only what is left can be looked at"
                warn(f"{source.name}: {text}", quiet=options["quiet"])
            return None
        if len(topics) > 1:
            raise UsageError(f"{source.name}: several filtered topics; choose from: -t {' -t '.join(topics)}")
        return topics[0], recorded_config(source) or ""


class _Reader:
    """Reads filtered logs, and compares them with labels if there are any."""

    def __init__(self, job: Job, collected: Collector) -> None:
        self._job, self._collected = job, collected
        self._variant = job.variants[0]

    def run(self, recording: "Recording", topic: str, labels: "Labels | None") -> Evaluated:
        """Read one recording; an error of its own is told and kept."""
        outcome = Evaluated(recording.name, {self._variant.name: Summary()})
        self._collected.begin(recording.name)
        started = perf_counter()
        try:
            with closing(recording.open(rate_hz=self._job.rate_hz, decoding=self._job.decoding)) as source:
                self._stream(source, topic, labels, outcome.methods[self._variant.name])
                outcome.damage = source.damage
                report_damage(source.damage, verbose=self._job.verbose)
        except UsageError:
            raise
        except SeaclutterError as error:
            outcome.error = str(error)
            fail(error)
        outcome.seconds = perf_counter() - started
        return outcome

    def _stream(self, source: "Source", topic: str, labels: "Labels | None", summary: Summary) -> None:
        selection = self._job.selection
        total = sum(source.counts.get(channel.id, 0) for channel in source.channels if channel.topic == topic)
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
        self._collected.add(one.frame, [one.numbers], truth, [score], lambda: [one.result])
