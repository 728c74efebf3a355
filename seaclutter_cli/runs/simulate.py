"""Simulation of a labelled lidar recording, or of an airborne tile if the output is a LAS or LAZ file."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import indent
from time import perf_counter
from typing import Any

import numpy as np

from seaclutter_cli.arrays import Rows
from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.batch import Work, run_all
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import SimulateOptions
from seaclutter_cli.runs.outputs import prepare_outputs
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, Result, statuses
from seaclutter_cli.simulation.airborne.scene import TileScene, is_tile_scene, load_tile_scene, save_tile_scene
from seaclutter_cli.simulation.marine.recording import SimulatedFrame
from seaclutter_cli.simulation.marine.scene import Scene, save_scene
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.text import count, named_folder, printable, table
from seaclutter_cli.truth import CLUTTER, IGNORED, OBJECT_CLASSES

_TILE_SUFFIXES = (".las", ".laz")
_MAX_TARGETS = 12


@use_case_of(SimulateOptions)
def simulate(options: SimulateOptions) -> "SimulationResult | TileSimulationResult | SeedsResult":
    """Simulate a labelled recording of a scene, or with seeds one for each of them.

    Returns
    -------
    SimulationResult, TileSimulationResult or SeedsResult
        Written files, and number of points by label; with ``seeds``, one outcome for each.

    Raises
    ------
    ConfigError
        If the scene is not valid.
    UsageError
        If the name of an output does not fit its format, or the file exists.

    Examples
    --------
    >>> import seaclutter
    >>> made = seaclutter.simulate("calm", folder / "calm.mcap", frames=2)
    >>> made.frames, made.labels.name
    (2, 'calm.labels.csv')
    >>> several = seaclutter.simulate("calm", folder / "seeds", frames=1, seeds=[1, 2])
    >>> [(one.recording, one.status) for one in several.outcomes]
    [('calm_1', 'done'), ('calm_2', 'done')]
    """
    output = options.output
    if options.seeds is not None:
        return _simulate_seeds(options, options.seeds)
    if named_folder(output):
        raise UsageError(f"{output}: names a folder by the slash at its end; -o takes a file, or a folder with --seeds")
    return _SimulateWork(Recording((Path(output),)), options).simulate(options.observer)


def _simulate_recording(name: str, output: Path, options: SimulateOptions, observer: Observer) -> "SimulationResult":
    from seaclutter_cli.simulation.layouts import find_scene
    from seaclutter_cli.simulation.marine.recording import FORMATS, record

    if is_tile_scene(name):
        raise UsageError(f"{output}: {name} is an airborne tile; the name of its file must end in .las or .laz")
    found = find_scene(name, options.seed, wide=options.physics == "wide")
    scene = found.with_recording(frames=options.frames, lidar=options.lidar)
    endings = [f".{name}" for name in ([options.form] if options.form else FORMATS)]
    if output.suffix not in endings:
        raise UsageError(f"{output}: the name of the recording must end in {' or '.join(endings)}")
    labels = output.with_suffix(".labels.csv")
    targets = {"-o": output, "the labels of -o": labels, **options.outputs}
    prepare_outputs(targets, {"SCENE": Path(name)}, force=options.force, observer=observer)
    points, started = Counter[int](), perf_counter()
    with OutputGroup(replace=options.force) as files, observer.progress(output.stem, scene.recording.frames) as step:
        if options.scene_file:
            save_scene(scene, options.scene_file, files)

        def on_frame(frame: SimulatedFrame) -> None:
            points.update(frame.points["label"].tolist())
            step()

        record(scene, output, labels, on_frame, files)
    return SimulationResult(scene, points, scene.recording.frames, output, labels, perf_counter() - started)


def _simulate_tile(name: str, output: Path, options: SimulateOptions, observer: Observer) -> "TileSimulationResult":
    from seaclutter_cli.simulation.airborne.coast import LAND_CODES
    from seaclutter_cli.simulation.airborne.recording import record_tile

    named = {"frames": options.frames, "lidar": options.lidar, "format": options.form, "physics": options.physics}
    for option, value in named.items():
        if value is not None:
            remedy = "set height, density and returns in the scene's section lidar"
            raise UsageError(f"--{option}: not available for tiles; {remedy}")
    scene = load_tile_scene(name).with_tile(seed=options.seed)
    prepare_outputs({"-o": output, **options.outputs}, {"SCENE": Path(name)}, force=options.force, observer=observer)
    land, points = 0, Counter[int]()
    started = perf_counter()

    def on_strip(strip: Rows) -> None:
        nonlocal land
        on_land = np.isin(strip["classification"], LAND_CODES)
        land += int(on_land.sum())
        points.update(dict(enumerate(np.bincount(strip["object_class"][~on_land]).tolist())))

    with OutputGroup(replace=options.force) as files:
        if options.scene_file:
            save_tile_scene(scene, options.scene_file, files)
        record_tile(scene, output, on_strip, files)
    return TileSimulationResult(scene, points, land, output, perf_counter() - started)


@dataclass(frozen=True)
class SimulationResult(Result):
    """A simulated recording: its scene, points by label, number of frames, and files."""

    is_summary = True
    data = "output labels frames points=listed"

    scene: Scene
    points: Counter[int]
    frames: int
    output: Path
    labels: Path
    seconds: float

    def listed(self) -> list[dict[str, Any]]:
        """Return the points by label; those of many targets by class."""
        targets = [item for item in self.scene.objects if not item.ignore]
        names = [item.class_name or item.shape for item in targets]
        shown = [(f"{name}, track {item.track_id}", item.track_id) for name, item in zip(names, targets, strict=True)]
        rows = [(name, self.points[track_id]) for name, track_id in shown]
        if len(rows) > _MAX_TARGETS:
            points, objects = Counter[str](), Counter(names)
            for name, item in zip(names, targets, strict=True):
                points[name] += self.points[item.track_id]
            rows = [(f"{name} ({count(number, 'object')})", points[name]) for name, number in sorted(objects.items())]
        rows = [("clutter", self.points[CLUTTER]), *rows, ("own ship or ignored", self.points[IGNORED])]
        return [{"label": name, "points": points} for name, points in rows]

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        rows = [(one["label"], f"{one['points'] / self.frames:,.0f}") for one in self.listed()]
        pace = f"{count(self.frames, 'frame')} in {self.seconds:.1f} s ({self.frames / self.seconds:.0f} frames/s)"
        files = printable(f"{self.output}, {self.labels}")
        return f"{files}\n{indent(table(('label', 'points per frame'), rows), '  ')}\n{pace}"


@dataclass(frozen=True)
class TileSimulationResult(Result):
    """A simulated tile: its scene, points by class code (0 is the sea) and on land, and file."""

    is_summary = True
    data = "output sea land objects=listed"

    scene: TileScene
    points: Counter[int]
    land: int
    output: Path
    seconds: float

    @property
    def sea(self) -> int:
        """Number of points of the sea."""
        return self.points[0]

    def listed(self) -> list[dict[str, Any]]:
        """Return objects and points by class."""
        objects, named = Counter(item.kind for item in self.scene.objects), enumerate(OBJECT_CLASSES, 1)
        rows = ((name, objects[name], self.points[code]) for code, name in named if objects[name])
        return [dict(zip(("class", "objects", "points"), row, strict=True)) for row in rows]

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        rows = [(one["class"], one["objects"], f"{one['points']:,}") for one in self.listed()]
        land = [("land", "", f"{self.land:,}")] if self.scene.land else []
        shown = table(("class", "objects", "points"), [("sea", "", f"{self.sea:,}"), *land, *rows])
        output, total = printable(str(self.output)), self.points.total() + self.land
        return f"{output}\n{indent(shown, '  ')}\n{count(total, 'point')} in {self.seconds:.1f} s"


def _simulate_seeds(options: SimulateOptions, seeds: Sequence[int]) -> "SeedsResult":
    """Simulate a recording or tile for each seed, as ``SCENE_SEED.mcap`` or ``.laz`` in a folder."""
    scene, folder = str(options.scene), Path(options.output)
    if options.seed is not None:
        raise UsageError("--seed and --seeds: give one of them")
    if options.scene_file:
        raise UsageError("--scene-file: is for a single recording; leave out --seeds")
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{options.output}: is a file, but --seeds needs a folder")
    suffix = _TILE_SUFFIXES[1] if is_tile_scene(scene) else f".{options.form or 'mcap'}"
    logs = [folder / f"{Path(scene).stem}_{seed}{suffix}" for seed in seeds]
    labels = [] if suffix in _TILE_SUFFIXES else [log.with_suffix(".labels.csv") for log in logs]
    targets = {"-o": logs, "the labels of -o": labels}
    prepare_outputs(targets, {"SCENE": Path(scene)}, force=options.force, observer=options.observer)
    each = [replace(options, seeds=None, seed=seed) for seed in seeds]
    works = [_SimulateWork(Recording((log,)), one) for log, one in zip(logs, each, strict=True)]
    return SeedsResult(run_all(works, options, options.observer))


@dataclass(kw_only=True)
class _Simulated(Outcome):
    """Outcome of a simulation; without a result after an error."""

    seed: int
    output: Path
    result: SimulationResult | TileSimulationResult | None = None

    def figures(self) -> str:
        return f"{self.seconds:.1f} s -> {printable(str(self.output))}"

    def as_dict(self) -> dict[str, Any]:
        return {"seed": self.seed, "error": self.error, **(self.result.as_dict() if self.result else {})}

    def as_text(self) -> str:
        return self.result.as_text() if self.result else ""


@dataclass(frozen=True)
class _SimulateWork(Work[_Simulated]):
    recording: Recording
    options: SimulateOptions

    @property
    def reads(self) -> Sequence[Path]:
        scene = Path(self.options.scene)
        return (scene,) if scene.is_file() else ()

    @property
    def writes(self) -> Sequence[Path]:
        return self.recording.paths

    def fill(self, outcome: _Simulated, observer: Observer) -> None:
        outcome.result = self.simulate(observer)

    def simulate(self, observer: Observer) -> SimulationResult | TileSimulationResult:
        (output,) = self.recording.paths
        simulate_one = _simulate_tile if output.suffix.lower() in _TILE_SUFFIXES else _simulate_recording
        return simulate_one(str(self.options.scene), output, self.options, observer)

    def without_result(self, reason: str | None) -> _Simulated:
        (output,) = self.recording.paths
        return _Simulated(recording=output.stem, seed=self.options.seed or 0, output=output, error=reason)


class SeedsResult(RecordingsResult[_Simulated]):
    """Outcomes of simulations, one for each seed."""

    is_summary = True

    def as_text(self) -> str:
        """Return how many were simulated."""
        return statuses(self.outcomes)
