"""Simulated airborne tiles, with the true class of every point."""

from collections import Counter
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import prepare_outputs
from seaclutter_cli.runs.recordings import PathLike
from seaclutter_cli.runs.simulation import SimulateOptions, TileSimulationResult
from seaclutter_cli.simulation.airborne.coast import LAND_CODES
from seaclutter_cli.simulation.airborne.recording import record_tile
from seaclutter_cli.simulation.airborne.scene import load_tile_scene, save_tile_scene
from seaclutter_cli.sinks.atomic import OutputGroup


def simulate_tile(
    scene: PathLike, output: Path, options: SimulateOptions | None = None, observer: Observer = SILENT
) -> TileSimulationResult:
    """Simulate a labelled airborne tile of a scene.

    Parameters
    ----------
    scene : path or str
        Scene file (YAML), or the name of a built-in tile scene.
    output : Path
        LAS or LAZ file.
    options : SimulateOptions, optional
        Values that replace those of the scene, and output options.
    observer : Observer, optional
        Receives notes.

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
    targets = {"-o": output, "--scene-file": options.scene_file}
    prepare_outputs(targets, {"SCENE": Path(name)}, force=options.force, observer=observer)
    points: Counter[int] = Counter()
    land = 0
    started = perf_counter()

    def on_strip(echoes: NDArray[np.void]) -> None:
        nonlocal land
        on_land = np.isin(echoes["classification"], LAND_CODES)
        land += int(on_land.sum())
        points.update(dict(enumerate(np.bincount(echoes["object_class"][~on_land]).tolist())))

    with OutputGroup(replace=options.force) as files:
        if options.scene_file:
            save_tile_scene(chosen, options.scene_file, files)
        record_tile(chosen, output, on_strip, files)
    return TileSimulationResult(chosen, points, land, output, perf_counter() - started)
