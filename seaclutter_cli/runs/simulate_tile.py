"""Simulated airborne tiles, with the true class of every point."""

from collections import Counter
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.outputs import check_outputs
from seaclutter_cli.runs.recordings import PathLike
from seaclutter_cli.runs.simulation import SimulateOptions, TileSimulationResult
from seaclutter_cli.simulation.airborne.recording import record_tile
from seaclutter_cli.simulation.airborne.scene import load_tile_scene
from seaclutter_cli.simulation.marine.scene import write_scene


def simulate_tile(scene: PathLike, output: Path, options: SimulateOptions | None = None) -> TileSimulationResult:
    """Simulate a labelled airborne tile of a scene.

    Parameters
    ----------
    scene : path or str
        Scene file (YAML), or the name of a built-in tile scene.
    output : Path
        LAS or LAZ file.
    options : SimulateOptions, optional
        Values that replace those of the scene, and output options.

    Raises
    ------
    ConfigError
        If the scene is not valid.
    UsageError
        If an option only applies to recordings, or an output may not be written.
    """
    options, name = options or SimulateOptions(), str(scene)
    for option, value in (("frames", options.frames), ("lidar", options.lidar), ("format", options.form)):
        if value is not None:
            raise UsageError(
                f"--{option}: not available for tiles; set height, density and returns in the scene's section lidar"
            )
    chosen = load_tile_scene(name).with_tile(seed=options.seed)
    inputs = [Path(name)] if Path(name).exists() else []
    check_outputs([output, options.scene_file], inputs, force=options.force)
    if options.scene_file:
        write_scene(chosen.as_dict(), options.scene_file)
    points: Counter[int] = Counter()
    started = perf_counter()

    def on_strip(echoes: NDArray[np.void]) -> None:
        points.update(dict(enumerate(np.bincount(echoes["object_class"]).tolist())))

    record_tile(chosen, output, on_strip)
    return TileSimulationResult(chosen, points, output, perf_counter() - started)
