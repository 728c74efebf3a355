"""The studies: which variants run over which recordings, and the tables of their scores."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from recordings import SEA_LAYOUTS, Recording, marine_scenes
from scores import Job
from tables import (
    Record,
    both_rates,
    by_lidar,
    by_scene,
    by_target,
    false_alarms,
    grouped,
    lost,
    matrix,
    over_seeds,
    recall,
    summary,
)
from variants import CALIBRATED, IDEAL, PAPER, UNUSED, ablations, all_methods, some_methods

from seaclutter_cli.simulation.lidar import LIDARS

Section = tuple[str, str]
LIDAR_SCENES = ("passing_speedboat", "departure", "rough", "harbour")
CROWDED = ("moored_rows", "narrow_channel")
"""Scenes with dozens of targets in a frame: there, object recall says more than R_FN, and means leave them out."""
TITLES = {PAPER: "thresholds of the paper", CALIBRATED: "calibrated thresholds"}


@dataclass(frozen=True)
class Options:
    """Options of a study: seeds of the recordings, their maximum number of frames, and scenes; all if empty."""

    seeds: Sequence[int]
    frames: int | None
    scenes: Sequence[str] = ()

    def recordings(self, scenes: Sequence[str], lidars: Sequence[str | None] = (None,)) -> list[Recording]:
        """Return the recordings of scenes with all seeds and lidars."""
        chosen = [scene for scene in scenes if not self.scenes or scene in self.scenes]
        return [
            Recording(scene, seed, lidar, self.frames) for lidar in lidars for scene in chosen for seed in self.seeds
        ]


def scenes_jobs(options: Options) -> list[Job]:
    return [Job(one, all_methods()) for one in options.recordings(marine_scenes())]


def scenes_tables(records: Sequence[Record]) -> Iterator[Section]:
    for thresholds, title in TITLES.items():
        of_set = [one for one in records if one["thresholds"] in (thresholds, UNUSED)]
        yield f"Means over the scenes with few targets, {title}", summary(_few_targets(of_set), by_scene)
        yield f"R_FP / R_FN in % of frames, {title}", matrix(of_set, by_scene, both_rates)
        yield f"Object recall in %, {title}", matrix(of_set, by_scene, recall)
        yield f"Target points lost in %, {title}", matrix(of_set, by_scene, lost)
        chosen, floor = ([one for one in of_set if one["method"] == name] for name in ("confirmed", IDEAL))
        yield f"`confirmed` by scene, {title}", over_seeds(chosen, floor)


def _few_targets(records: Sequence[Record]) -> list[Record]:
    """Return the records of the scenes with targets, but not with dozens of them."""
    crowded_or_empty = {one["scene"] for one in records if not one["scores"]["targets"]} | {*CROWDED}
    return [one for one in records if one["scene"] not in crowded_or_empty]


def layouts_jobs(options: Options) -> list[Job]:
    variants = some_methods("joint", "ring_intensity_outlier", "adaptive_radius", "confirmed", "none")
    return [Job(one, variants) for one in options.recordings(SEA_LAYOUTS)]


def layouts_tables(records: Sequence[Record]) -> Iterator[Section]:
    drawn = len({(one["scene"], one["seed"]) for one in records})
    yield f"Means over {len({*map(by_scene, records)})} layouts, {drawn} scenes", summary(records, by_scene, "layout")
    yield "R_FP / R_FN in % of frames", matrix(records, by_scene, both_rates)
    yield "Object recall in %", matrix(records, by_scene, recall)
    yield "Target points lost in %", matrix(records, by_scene, lost)


def ablations_jobs(options: Options) -> list[Job]:
    return [Job(one, ablations()) for one in options.recordings(marine_scenes())]


def ablations_tables(records: Sequence[Record]) -> Iterator[Section]:
    yield "Means over the scenes with few targets", summary(_few_targets(records), by_scene)
    yield "R_FP / R_FN in % of frames", matrix(records, by_scene, both_rates)
    yield "Object recall in %", matrix(records, by_scene, recall)
    yield "Target points lost in %", matrix(records, by_scene, lost)


def breakdown_jobs(options: Options) -> list[Job]:
    variants = some_methods("joint", "adaptive_radius", "confirmed")
    return [Job(one, variants, by_target=True) for one in options.recordings(marine_scenes())]


def breakdown_tables(records: Sequence[Record]) -> Iterator[Section]:
    yield "By range in m", by_target(records, "range")
    yield "By number of echoes", by_target(records, "echoes")
    yield "By height above the waterline in m", by_target(records, "height")
    yield "False alarms in 100 frames by range in m", false_alarms(records)


def lidars_jobs(options: Options) -> list[Job]:
    variants = some_methods("joint", "adaptive_radius", "confirmed", "none")
    return [Job(one, variants) for one in options.recordings(LIDAR_SCENES, list(LIDARS))]


def lidars_tables(records: Sequence[Record]) -> Iterator[Section]:
    yield "Means over the lidars", summary(records, by_lidar, "lidar")
    yield "R_FP / R_FN in % of frames", matrix(records, by_lidar, both_rates)
    yield "Object recall in %", matrix(records, by_lidar, recall)
    yield "Target points lost in %", matrix(records, by_lidar, lost)
    for lidar, group in grouped(records, by_lidar).items():
        yield f"{lidar}, R_FP / R_FN in % of frames", matrix(group, by_scene, both_rates)


@dataclass(frozen=True)
class Study:
    """A study: its description, default number of seeds, jobs, and the tables of their records."""

    about: str
    seeds: int
    jobs: Callable[[Options], list[Job]]
    tables: Callable[[Sequence[dict[str, Any]]], Iterator[Section]]


STUDIES = {
    "scenes": Study("all methods on all scenes at sea", 5, scenes_jobs, scenes_tables),
    "layouts": Study("random scenes of all layouts at sea", 4, layouts_jobs, layouts_tables),
    "ablations": Study("the method without its parts", 1, ablations_jobs, ablations_tables),
    "breakdown": Study("by range and by size of the targets", 2, breakdown_jobs, breakdown_tables),
    "lidars": Study("all lidars on some scenes", 1, lidars_jobs, lidars_tables),
}
