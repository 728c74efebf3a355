"""Simulation of a lidar recording or of an airborne tile, by the suffix of the output."""

from pathlib import Path

from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.recordings import PathLike
from seaclutter_cli.runs.simulation import SimulateOptions, SimulationResult, TileSimulationResult

TILE_SUFFIXES = (".las", ".laz")


def simulate_scene(
    scene: PathLike, output: Path, options: SimulateOptions | None = None, observer: Observer = SILENT
) -> SimulationResult | TileSimulationResult:
    """Simulate a labelled recording of a scene, or a tile if the output is a LAS or LAZ file.

    Parameters
    ----------
    scene : path or str
        Scene file (YAML), or the name of a built-in scene, layout or tile scene.
    output : Path
        File of the recording or tile.
    options : SimulateOptions, optional
        Values that replace those of the scene, and output options.
    observer : Observer, optional
        Receives progress.

    Raises
    ------
    ConfigError
        If the scene is not valid.
    UsageError
        If the name of an output does not fit its format, or the file may not be written.
    """
    if output.suffix.lower() in TILE_SUFFIXES:
        from seaclutter_cli.runs.simulate_tile import simulate_tile

        return simulate_tile(scene, output, options, observer)
    from seaclutter_cli.runs.simulate_recording import simulate_recording

    return simulate_recording(scene, output, options, observer)
