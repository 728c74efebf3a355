"""Proposal of a mask of own ship's structure from recordings."""

from dataclasses import dataclass

import numpy as np

from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.errors import TopicError
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.pipeline import map_frames
from seaclutter_cli.plots.clouds import draw_mask
from seaclutter_cli.plots.figure import render
from seaclutter_cli.runs.batch import RecordingWork, prepared
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import MaskOptions
from seaclutter_cli.runs.outputs import Contents, write_files
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult
from seaclutter_cli.selection import cloud_channels
from seaclutter_cli.structure.search import MIN_FRAMES, FoundStructure, StructureSearch
from seaclutter_cli.text import count


@use_case_of(MaskOptions)
def find_mask(options: MaskOptions) -> "MaskResult":
    """Find own ship's structure, which is constant while the vessel moves, and write a mask of it.

    Examples
    --------
    >>> import seaclutter
    >>> result = seaclutter.find_mask("samples/sea.mcap")
    >>> result.found.frames, len(result.found.mask.sectors) > 0
    (60, True)
    """
    observer = options.watching
    pairs = prepared(options, observer)
    search = StructureSearch(options.reach_m)
    outcomes = [_MaskWork(options.reading, *each, search).run(observer) for each in pairs]
    result = MaskResult(outcomes, search.found(), options.reach_m)
    for warning in result.warnings:
        observer.warn(warning)
    mask = result.found.mask
    if options.output and not mask.sectors:
        observer.warn(f"{options.output}: not written, because there is nothing to mask")
    files: Contents = {
        options.output if mask.sectors else None: mask.as_csv().encode(),
        options.plot_file: lambda it: it.stream.write(
            render(draw_mask, it.path.suffix, aspect=1.45, mask=mask, reach_m=options.reach_m)
        ),
    }
    write_files(files, replace=options.force, outcomes=outcomes, observer=observer)
    return result


@dataclass(frozen=True)
class _MaskWork(RecordingWork[Outcome]):
    """Search of one recording, which adds to that of the others in this process."""

    search: StructureSearch

    def study(self, source: Source, labels: Labels | None, outcome: Outcome, observer: Observer) -> None:  # noqa: ARG002
        selection = self.reading.selection
        if len({channel.topic for channel in cloud_channels(source, selection.topics)}) > 1:
            raise TopicError(f"{source.name}: each lidar needs a mask of its own; choose one topic with -t")
        frames = map_frames(source, selection, self.search.add)
        self.finish(source, labels, sum(1 for _ in self.stepped(frames, source, observer)))


@dataclass(frozen=True)
class MaskResult(RecordingsResult[Outcome]):
    """Proposed mask: the structure within a range."""

    data = "recordings=outcomes frames=found.frames at_rest=found.at_rest share=found.share sectors=found.mask.sectors"

    found: FoundStructure
    reach_m: float

    @property
    def warnings(self) -> list[str]:
        """What stands against the result."""
        found, reach = self.found, f"{self.reach_m:g} m"
        if found.frames < MIN_FRAMES:
            return [f"only {count(found.frames, 'frame')}; what is constant shows in {MIN_FRAMES} and more"]
        if found.is_at_rest and found.at_rest is not None:
            text = (
                f"{found.at_rest:.0%} of what is beyond {reach} is constant too, as for a vessel at rest or between "
                "straight walls: a quay looks like own ship; use a log under way in open water"
            )
            return [text]
        if found.mask.sectors and found.at_rest is None:
            text = (
                f"too little rises out of the water beyond {reach} to show that the vessel moved; check that the mask "
                "contains own ship only"
            )
            return [text]
        return []

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        sectors, frames = self.found.mask.sectors, count(self.found.frames, "frame")
        if not sectors:
            return f"No own structure found within {self.reach_m:g} m in {frames}."
        nearest, farthest = min(s.range_min_m for s in sectors), max(s.range_max_m for s in sectors)
        found = (
            f"Own structure in {count(len(sectors), 'direction')} ({self.found.share:.1%} of those with returns), "
            f"{nearest:.1f} to {farthest:.1f} m away, from {frames}."
        )
        starts = np.unique([one.azimuth_min_deg for one in sectors])  # of sectors of 1°
        spans = np.split(starts, np.flatnonzero(np.diff(starts) != 1) + 1)
        return f"{found}\nAzimuths: {', '.join(f'{span[0]:g}° to {span[-1] + 1:g}°' for span in spans)}"
