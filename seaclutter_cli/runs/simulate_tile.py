"""Simulated airborne tiles, with the truth of every point."""

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
    """Make a labelled airborne tile of a scene.

    Parameters
    ----------
    scene : path or str
        Scene file (YAML), or the name of a built-in tile scene.
    output : Path
        LAS or LAZ file.
    options : SimulateOptions, optional
        What differs from the scene.

    Raises
    ------
    ConfigError
        If anything is wrong with the scene.
    UsageError
        If an option is for recordings only, or an output may not be written.
    """
    options, name = options or SimulateOptions(), str(scene)
    for option, value in (("frames", options.frames), ("lidar", options.lidar), ("format", options.form)):
        if value is not None:
            raise UsageError(
                f"--{option}: tiles have none; height, density and returns stand in the scene's lidar section"
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
