"""Simulated lidar recordings, with the true class of every point."""

from pathlib import Path
from time import perf_counter

from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import prepare_outputs
from seaclutter_cli.runs.recordings import PathLike
from seaclutter_cli.runs.simulation import PointTally, SimulateOptions, SimulationResult
from seaclutter_cli.simulation.airborne.scene import is_tile_scene
from seaclutter_cli.simulation.layouts import find_scene
from seaclutter_cli.simulation.marine.formats import FORMATS
from seaclutter_cli.simulation.marine.recording import record
from seaclutter_cli.simulation.marine.render import SimulatedFrame
from seaclutter_cli.simulation.marine.scene import save_scene
from seaclutter_cli.sinks.atomic import OutputGroup


def simulate_recording(
    scene: PathLike, output: Path, options: SimulateOptions | None = None, observer: Observer = SILENT
) -> SimulationResult:
    """Simulate a labelled recording of a scene.

    Parameters
    ----------
    scene : path or str
        Scene file (YAML), or the name of a built-in scene or layout.
    output : Path
        File of the recording; the labels are written beside it, with the suffix ``.labels.csv``.
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
    options = options or SimulateOptions()
    name = str(scene)
    if is_tile_scene(name):
        raise UsageError(f"{output}: {name} is an airborne tile; the name of its file must end in .las or .laz")
    chosen = find_scene(name, options.seed).with_recording(frames=options.frames, lidar=options.lidar)
    _check_name(output, options.form)
    labels = output.with_suffix(".labels.csv")
    targets = {"-o": output, "the labels of -o": labels, "--scene-file": options.scene_file}
    prepare_outputs(targets, {"SCENE": Path(name)}, force=options.force, observer=observer)
    tally = PointTally()
    started = perf_counter()
    with OutputGroup(replace=options.force) as files, observer.progress(output.stem, chosen.recording.frames) as step:
        if options.scene_file:
            save_scene(chosen, options.scene_file, files)

        def on_frame(frame: SimulatedFrame) -> None:
            tally.add(frame)
            step()

        record(chosen, output, labels, on_frame, files)
    return SimulationResult(chosen, tally, output, labels, perf_counter() - started)


def _check_name(output: Path, chosen: str | None) -> None:
    form = chosen or output.suffix.removeprefix(".")
    if form not in FORMATS or output.suffix != f".{form}":
        endings = " or ".join(f".{name}" for name in ([form] if chosen else FORMATS))
        raise UsageError(f"{output}: the name of the recording must end in {endings}")
