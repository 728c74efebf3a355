"""A report's making: methods run over logs, or filtered logs read back, into one collection of what is to be seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seaclutter_cli.commands.comparison import Comparison, Evaluated
from seaclutter_cli.commands.console import count
from seaclutter_cli.commands.judging import Job
from seaclutter_cli.commands.replaying import Reader, filter_run
from seaclutter_cli.commands.variants import COMPARISONS, Variant, choose_variants
from seaclutter_cli.config import load_config
from seaclutter_cli.plots.report import FIGURES, draw_figures
from seaclutter_cli.reporting.collector import Collector, Method
from seaclutter_cli.reporting.data import report_data
from seaclutter_cli.reporting.page import render_page
from seaclutter_cli.text import printable

if TYPE_CHECKING:
    from seaclutter_cli.interfaces import Labels
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

    def missing(self, picks: Sequence[int]) -> list[int]:
        """Return the frames asked for that no recording has."""
        return sorted(set(picks) - {one.item.frame for one in self.collected.chosen if one.why == "picked"})

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
        lines = [f"{printable(str(path))}: {_size(size)}" for path, size in sizes.items()]
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
    first = options["methods"] or _configured(options["config_file"], names)
    variants = choose_variants([*first, *names], options["config_file"], options["overrides"])
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
    run = filter_run(recordings, options)
    if run is None:
        return None
    collected = _collector([run.variant], options, labelled=labels is not None)
    reader = Reader(Job.of(options, [run.variant]), collected)
    outcomes = []
    for number, (recording, topic) in enumerate(zip(recordings, run.topics, strict=True)):
        collected.begin(recording.name)
        outcomes.append(reader.run(recording, topic, labels[number] if labels else None))
    return Reported(Comparison([run.variant], outcomes), collected)


def _configured(config_file: Path | None, names: Sequence[str]) -> list[str]:
    """Return the method of a configuration if it is among those compared: it is the one to look at first."""
    method = load_config(config_file).method if names else ""
    return [method] if method in names else []


def _size(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{max(round(size / 1e3), 1)} kB"


def _collector(variants: Sequence[Variant], options: Mapping[str, Any], *, labelled: bool) -> Collector:
    methods = [Method(one.name, one.config.ring_edges, one.config.to_yaml()) for one in variants]
    return Collector(
        methods, variants[0].config.evaluation, labelled=labelled, frames=options["shown"], picks=options["picks"]
    )
