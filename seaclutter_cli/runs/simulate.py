"""Simulations: a recording of a lidar at sea or on land, or an airborne tile, as the output's name has it."""

from pathlib import Path

from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.recordings import PathLike
from seaclutter_cli.runs.simulation import SimulateOptions, SimulationResult, TileSimulationResult

TILE_SUFFIXES = (".las", ".laz")


def simulate_scene(
    scene: PathLike, output: Path, options: SimulateOptions | None = None, observer: Observer = SILENT
) -> SimulationResult | TileSimulationResult:
    """Make a labelled recording of a scene, or a tile where the output is a LAS or LAZ file.

    Parameters
    ----------
    scene : path or str
        Scene file (YAML), or the name of a built-in scene, layout or tile scene.
    output : Path
        The file.
    options : SimulateOptions, optional
        What differs from the scene.
    observer : Observer, optional
        Receives progress.

    Raises
    ------
    ConfigError
        If anything is wrong with the scene.
    UsageError
        If an output has no name that fits its format, or may not be written.
    """
    if output.suffix.lower() in TILE_SUFFIXES:
        from seaclutter_cli.runs.simulate_tile import simulate_tile

        return simulate_tile(scene, output, options)
    from seaclutter_cli.runs.simulate_recording import simulate_recording

    return simulate_recording(scene, output, options, observer)
