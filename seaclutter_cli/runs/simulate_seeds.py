"""Simulations of a scene with several seeds."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.batch import BatchOptions, Work, run_batch
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import prepare_outputs
from seaclutter_cli.runs.recordings import Outcome, PathLike, RecordingsResult, statuses, storing_errors
from seaclutter_cli.runs.simulate import (
    TILE_SUFFIXES,
    SimulateOptions,
    SimulationResult,
    TileSimulationResult,
    simulate_scene,
)
from seaclutter_cli.simulation.airborne.scene import is_tile_scene
from seaclutter_cli.sources import Recording
from seaclutter_cli.text import printable

_RANGE = re.compile(r"\s*(\d{1,9})(?:\s*(?:\.\.|-)\s*(\d{1,9}))?\s*")
_MAX_SEEDS = 100_000


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds that numbers and ranges describe, each once.

    Raises
    ------
    UsageError
        If the text has another form, or there are more than 100,000.

    Examples
    --------
    >>> parse_seeds("1..4,9"), parse_seeds("7-8")
    ((1, 2, 3, 4, 9), (7, 8))
    """
    seeds: dict[int, None] = {}
    for part in text.split(","):
        found = _RANGE.fullmatch(part)
        first = int(found[1]) if found else 0
        last = int(found[2] or first) if found else -1
        if not 0 <= last - first < _MAX_SEEDS - len(seeds):
            raise UsageError(f"--seeds {text}: write numbers and ranges, such as 1..5 or 1,2,7; at most {_MAX_SEEDS:,}")
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return tuple(seeds)


def simulate_seeds(
    scene: PathLike,
    output: PathLike,
    seeds: Sequence[int],
    options: SimulateOptions | None = None,
    batch: BatchOptions | None = None,
    observer: Observer = SILENT,
) -> "SeedsResult":
    """Simulate a recording or tile for each seed, as ``SCENE_SEED.mcap`` or ``.laz`` in a folder.

    Parameters
    ----------
    scene : path or str
        Scene file (YAML), or the name of a built-in scene, layout or tile scene.
    output : path
        Folder.
    seeds : sequence of int
        Seeds.
    options : SimulateOptions, optional
        Values that replace those of the scene, and output options.
    batch : BatchOptions, optional
        How many are simulated at the same time.
    observer : Observer, optional
        Receives progress.

    Raises
    ------
    ConfigError
        If the scene is not valid.
    UsageError
        If an option is for a single recording, or files may not be written.

    Examples
    --------
    >>> import seaclutter
    >>> few = seaclutter.SimulateOptions(frames=1)
    >>> made = seaclutter.simulate_seeds("calm", folder / "seeds", [1, 2], few)
    >>> [(one.recording, one.status) for one in made.outcomes]
    [('calm_1', 'done'), ('calm_2', 'done')]
    """
    options, folder = options or SimulateOptions(), Path(output)
    if options.scene_file:
        raise UsageError("--scene-file: is for a single recording; leave out --seeds")
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{output}: is a file, but --seeds needs a folder")
    suffix = TILE_SUFFIXES[1] if is_tile_scene(str(scene)) else f".{options.form or 'mcap'}"
    logs = [folder / f"{Path(scene).stem}_{seed}{suffix}" for seed in seeds]
    labels = [] if suffix in TILE_SUFFIXES else [log.with_suffix(".labels.csv") for log in logs]
    targets = {"-o": logs, "the labels of -o": labels}
    prepare_outputs(targets, {"SCENE": Path(scene)}, force=options.force, observer=observer)
    works = [_SimulateWork(str(scene), log, replace(options, seed=seed)) for seed, log in zip(seeds, logs, strict=True)]
    return SeedsResult(run_batch(works, batch or BatchOptions(), observer))


@dataclass(kw_only=True)
class _Simulated(Outcome):
    """Outcome of a simulation; without a result after an error."""

    seed: int
    result: SimulationResult | TileSimulationResult | None = None

    def figures(self) -> str:
        """Return output and duration, for a line about the outcome."""
        done = self.result
        path = done.log if isinstance(done, SimulationResult) else done.output if done else ""
        return f"{self.seconds:.1f} s -> {printable(str(path))}"

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome as JSON-compatible data."""
        return {"seed": self.seed, "error": self.error, **(self.result.as_dict() if self.result else {})}


@dataclass(frozen=True)
class _SimulateWork(Work[_Simulated]):
    """Simulation with the seed of the options."""

    scene: str
    output: Path
    options: SimulateOptions

    @property
    def recording(self) -> Recording:  # type: ignore[override]
        """The recording that is made."""
        return Recording((self.output,))

    @property
    def reads(self) -> Sequence[Path]:
        """The scene, if it is a file."""
        return (Path(self.scene),) if Path(self.scene).is_file() else ()

    @property
    def writes(self) -> Sequence[Path]:
        """The recording or tile."""
        return (self.output,)

    def run(self, observer: Observer) -> _Simulated:
        """Simulate; store an error in the outcome."""
        outcome = self.without_result(None)
        with storing_errors(outcome, observer):
            outcome.result = simulate_scene(self.scene, self.output, self.options, observer)
        return outcome

    def without_result(self, reason: str | None) -> _Simulated:
        """Return an outcome without a result."""
        return _Simulated(recording=self.output.stem, seed=self.options.seed or 0, error=reason)


@dataclass(frozen=True)
class SeedsResult(RecordingsResult):
    """Outcomes of simulations, one for each seed."""

    is_summary = True

    outcomes: Sequence[_Simulated]

    def as_dict(self) -> list[dict[str, Any]]:
        """Return the outcomes as JSON-compatible data."""
        return [outcome.as_dict() for outcome in self.outcomes]

    def as_text(self) -> str:
        """Return how many were simulated."""
        return statuses(self.outcomes)

    def details(self) -> str:
        """Return the results as human-readable text."""
        return "\n\n".join(outcome.result.as_text() for outcome in self.outcomes if outcome.result)
