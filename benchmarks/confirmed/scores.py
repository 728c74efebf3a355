"""Runs of filters over recordings in memory, and the counts of their results."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from recordings import LabelledFrame, Recording, calibrated_thresholds, simulate
from variants import ABLATIONS, CALIBRATED, Variant

from seaclutter_cli.evaluation import IDEAL, EvaluationParams
from seaclutter_cli.evaluation.matching import FrameTargets, Matches, finder_of, match_clusters, targets_of
from seaclutter_cli.evaluation.scores import Summary, ideal, score_frame
from seaclutter_cli.frame import FilterResult
from seaclutter_cli.simulation.layouts import scene_class

RANGES_M = (0, 15, 30, 45, 60, np.inf)
ECHOES = (0, 5, 10, 30, 100, np.inf)
HEIGHTS_M = (0, 0.5, 1, 2, 4, np.inf)
BINS: Mapping[str, Sequence[float]] = {"range": RANGES_M, "echoes": ECHOES, "height": HEIGHTS_M}
EVALUATION = EvaluationParams()


@dataclass(frozen=True)
class Job:
    """Variants to run over one recording.

    Parameters
    ----------
    recording : Recording
        The recording.
    variants : tuple of Variant
        The variants.
    by_target : bool
        Also count by range and by size of the targets.
    """

    recording: Recording
    variants: tuple[Variant, ...]
    by_target: bool = False


def run(job: Job) -> list[dict[str, Any]]:
    """Return the scores of each variant as JSON data."""
    scene = job.recording.description()
    frames = simulate(scene)
    uses_calibrated = any(one.thresholds == CALIBRATED for one in job.variants)
    thresholds = calibrated_thresholds(frames) if uses_calibrated else ()
    runs = [filtered(variant, frames, thresholds, scene_class(scene)) for variant in job.variants]
    summaries, counts = [Summary() for _ in runs], [TargetCounts() for _ in runs]
    for one, *results in zip(frames, *runs, strict=True):
        for summary, score in zip(summaries, score_frame(one.frame, results, one.truth, EVALUATION), strict=True):
            assert score is not None
            summary.add(score, None)
        if job.by_target:
            for count, result in zip(counts, results, strict=True):
                count.add(one, result)
    return [
        {
            "scene": job.recording.scene,
            "seed": job.recording.seed,
            "lidar": scene.recording.lidar,
            "method": variant.name,
            "thresholds": variant.thresholds,
            "values": list(thresholds) if variant.thresholds == CALIBRATED else None,
            "scores": {name: value for name, value in summary.as_dict().items() if name != "filter_ms"},
            **({"by_target": count.as_dict()} if job.by_target else {}),
        }
        for variant, summary, count in zip(job.variants, summaries, counts, strict=True)
    ]


def filtered(
    variant: Variant, frames: Sequence[LabelledFrame], thresholds: Sequence[float], kind: str | None
) -> list[FilterResult]:
    """Return the results of the frames of a recording."""
    if variant.method == IDEAL:
        return [ideal(one.frame, one.truth, EVALUATION) for one in frames]
    with ABLATIONS[variant.ablation]() if variant.ablation else nullcontext():
        method = variant.make_filter(thresholds, kind)
        if method.needs_first_pass:
            for one in frames:
                method.observe(one.frame)
        results = [result for one in frames for result in method.process(one.frame)]
        return [*results, *method.flush()]


def matched(one: LabelledFrame, result: FilterResult) -> tuple[FrameTargets, NDArray[np.int64], Matches]:
    """Return the targets of a frame, the cluster of each point, and how they match."""
    targets = targets_of(one.frame, one.truth, EVALUATION)
    finder = finder_of(one.frame, [result.keep], EVALUATION)
    clusters = finder.clusters(result.keep & one.frame.valid, EVALUATION.min_cluster_points)
    return targets, clusters, match_clusters(clusters, targets, EVALUATION)


class TargetCounts:
    """Visible targets, detected ones, their echoes and those kept, and false alarms, by range and by size."""

    def __init__(self) -> None:
        self.counts = {name: np.zeros((len(edges) - 1, 4), np.int64) for name, edges in BINS.items()}
        self.false_alarms = np.zeros(len(RANGES_M) - 1, np.int64)
        self.frames = 0

    def add(self, one: LabelledFrame, result: FilterResult) -> None:
        """Add a frame. The range of a target is the mean over its echoes; clutter beside it is no echo of it."""
        frame, boxes = one.frame, one.truth.targets
        assert boxes is not None
        assert one.truth.points is not None
        targets, clusters, matches = matched(one, result)
        for k in np.flatnonzero(targets.visible):
            own = (one.truth.points == int(boxes.tracks[k])) & frame.valid
            echoes = int(np.count_nonzero(own))
            distance = frame.range_m[own].mean() if echoes else np.hypot(*boxes.centers[k, :2])
            values = {"range": distance, "echoes": echoes, "height": boxes.sizes[k, 2]}
            counts = (1, int(matches.detected[k]), echoes, int(np.count_nonzero(own & result.keep)))
            for name, value in values.items():
                self.counts[name][_bin(BINS[name], value)] += counts
        for number in np.flatnonzero(~matches.belongs):
            self.false_alarms[_bin(RANGES_M, frame.range_m[clusters == number].mean())] += 1
        self.frames += 1

    def as_dict(self) -> dict[str, Any]:
        """Return the counts as JSON data."""
        counts = {name: values.tolist() for name, values in self.counts.items()}
        return {**counts, "false_alarms": self.false_alarms.tolist(), "frames": self.frames}


def _bin(edges: Sequence[float], value: float) -> int:
    return int(np.searchsorted(edges, value, side="right")) - 1
