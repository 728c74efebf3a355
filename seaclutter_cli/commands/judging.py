"""An evaluation of recordings against labels: what `evaluate` and `tune` have in common."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import click

from seaclutter_cli.commands.console import Progress, report_damage, told_errors, warn
from seaclutter_cli.commands.options import decoding_options
from seaclutter_cli.commands.sensor_facts import mismatches
from seaclutter_cli.errors import InputError
from seaclutter_cli.text import printable

if TYPE_CHECKING:
    from seaclutter_cli.commands.comparison import Evaluated
    from seaclutter_cli.commands.frame_table import FrameTable
    from seaclutter_cli.commands.variants import Variant
    from seaclutter_cli.evaluation.scores import FrameScore
    from seaclutter_cli.frame import FilterResult, Frame
    from seaclutter_cli.interfaces import Labels, Source
    from seaclutter_cli.pipeline import Selection
    from seaclutter_cli.sensors.packets import DecoderOptions
    from seaclutter_cli.sources import Recording
    from seaclutter_cli.truth import Truth


class Watcher(Protocol):
    """Looks on while frames are evaluated."""

    def see(
        self,
        frame: "Frame",
        results: "Sequence[FilterResult | None]",
        truth: "Truth | None",
        scores: "Sequence[FrameScore | None]",
    ) -> None:
        """Take a frame, what each method made of it, its truth, and how each method did."""
        ...


@dataclass(frozen=True)
class Job:
    """All that is the same for every recording of a run."""

    variants: "Sequence[Variant]"
    selection: "Selection"
    decoding: "DecoderOptions"
    rate_hz: float
    quiet: bool
    verbose: bool

    @classmethod
    def of(cls, options: Mapping[str, Any], variants: "Sequence[Variant]") -> "Job":
        """Make a job of variants and command-line options."""
        from seaclutter_cli.pipeline import Selection

        chosen = ("topics", "start_s", "end_s", "frames", "intensity_field")
        return cls(
            variants,
            Selection(**{name: options[name] for name in chosen}),
            decoding_options(options),
            *(options[name] for name in ("rate_hz", "quiet", "verbose")),
        )

    def run(
        self,
        recording: "Recording",
        labels: "Labels | None",
        tables: "Sequence[FrameTable]" = (),
        watchers: "Sequence[Watcher]" = (),
    ) -> "Evaluated":
        """Evaluate one recording; an error of its own is told and kept, so that the others are evaluated too.

        Without labels, clusters are counted and nothing is compared.
        """
        from seaclutter_cli.commands.comparison import Evaluated
        from seaclutter_cli.evaluation.scores import Summary

        outcome = Evaluated(recording.name, {variant.name: Summary() for variant in self.variants})
        with told_errors(outcome):
            with closing(recording.open(rate_hz=self.rate_hz, decoding=self.decoding)) as source:
                judge = _Judge(self, labels, outcome, [table.begin(recording.name) for table in tables], watchers)
                self._stream(source, judge)
                self._finish(source, labels, outcome)
                judge.finish()
                outcome.damage = source.damage
                report_damage(source.damage, verbose=self.verbose)
            for table in tables:
                table.end()
        return outcome

    def _stream(self, source: "Source", judge: "_Judge") -> None:
        from seaclutter_cli.pipeline import cloud_channels, is_remainder, run_each

        clouds = cloud_channels(source, self.selection.topics)
        if any(variant.config.method != "none" for variant in self.variants) and is_remainder(
            source, self.selection.topics
        ):
            text = "was filtered already; this filters what was left of it, and a target that was lost is not visible"
            warn(f"{source.name}: {text}", quiet=self.quiet)
        told = len(source.warnings)
        for text in source.warnings:
            warn(text, quiet=self.quiet)
        if self.verbose:
            methods = ", ".join(variant.name for variant in self.variants)
            click.echo(f"{source.name}: {source.format}, {methods} on {printable(clouds[0].topic)}", err=True)
        total = sum(source.counts.get(channel.id, 0) for channel in clouds)
        progress = Progress(self.selection.frames or total or None, source.name, quiet=self.quiet)
        filters = [variant.config.make_filter() for variant in self.variants]
        with progress:

            def on_frame(frame: "Frame", results: "Sequence[FilterResult | None]", seconds: Sequence[float]) -> None:
                judge.add(frame, results, seconds)
                progress.step()

            run_each(source, filters, self.selection, on_frame)
        for text in (*source.warnings[told:], *mismatches(self.variants[0].config.sensor, source)):
            warn(text, quiet=self.quiet)

    def _finish(self, source: "Source", labels: "Labels | None", outcome: "Evaluated") -> None:
        """Check that a whole recording has been compared with all of its labels."""
        if not outcome.frames and source.damage:
            raise InputError(f"{source.name}: no frame can be read; {source.damage[0]}")
        if labels is None:
            return
        part = (self.selection.start_s, self.selection.end_s, self.selection.frames)
        if part == (None, None, None) and not source.damage:
            labels.finish()
        if outcome.frames and not any(summary.frames for summary in outcome.methods.values()):
            warn(f"{source.name}: none of its frames is labelled", quiet=self.quiet)


class _Judge:
    """Compares the frames of one recording with its labels."""

    def __init__(
        self,
        job: Job,
        labels: "Labels | None",
        outcome: "Evaluated",
        tables: "Sequence[FrameTable]",
        watchers: "Sequence[Watcher]",
    ) -> None:
        from seaclutter_cli.filters.fit import IntensityFit

        self._job, self._labels, self._outcome = job, labels, outcome
        self._tables, self._watchers = tables, watchers
        # A method that finds its threshold in the log itself cannot have a wrong one.
        given = [variant.name for variant in job.variants if not variant.config.make_filter().needs_first_pass]
        self._fits = {name: IntensityFit() for name in given}
        self._told: set[str] = set()

    def add(self, frame: "Frame", results: "Sequence[FilterResult | None]", seconds: Sequence[float]) -> None:
        """Count a frame for every method that could use it."""
        from seaclutter_cli.evaluation.scores import score_frame

        truth = self._labels.truth(frame) if self._labels else None
        scores = score_frame(frame, results, truth, self._job.variants[0].config.evaluation)
        for watcher in self._watchers:
            watcher.see(frame, results, truth, scores)
        for variant, result, found, spent in zip(self._job.variants, results, scores, seconds, strict=True):
            if result is None or found is None:
                continue
            self._outcome.methods[variant.name].add(found, spent)
            for table in self._tables:
                table.write(variant.name, frame, found)
            if variant.name in self._fits:
                self._warn(self._fits[variant.name].add(result))

    def finish(self) -> None:
        """Warn of thresholds that fit none of the few frames there were."""
        for fit in self._fits.values():
            self._warn(fit.verdict())

    def _warn(self, text: str | None) -> None:
        if text and text not in self._told:
            self._told.add(text)
            warn(f"{self._outcome.recording}: {text}", quiet=self._job.quiet)
