"""``seaclutter calibrate``: thresholds and the far limit from recordings that hold clutter."""

import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.console import Progress, count, report_damage, warn
from seaclutter_cli.commands.options import (
    config_options,
    decoding_options,
    force_option,
    logs_argument,
    output_options,
    selection_options,
)
from seaclutter_cli.commands.sensor_facts import facts_of
from seaclutter_cli.commands.truths import label_options
from seaclutter_cli.errors import InputError, LabelError, UsageError

if TYPE_CHECKING:
    from seaclutter_cli.calibration import Thresholds
    from seaclutter_cli.commands.calibrated import Calibrated
    from seaclutter_cli.config import Config
    from seaclutter_cli.frame import FilterResult
    from seaclutter_cli.interfaces import Labels, Source
    from seaclutter_cli.sources import Recording


@click.command(short_help="Find thresholds and the far limit for a sensor, and write a configuration.")
@logs_argument
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="CONFIG",
    help="Configuration to write, for filter -c.",
)
@force_option
@click.option(
    "--filter-rate",
    type=click.FloatRange(min=0, max=1, min_open=True),
    default=0.8,
    metavar="SHARE",
    show_default=True,
    help="Share of the clutter points of each ring that are to be below its threshold.",
)
@click.option(
    "--keep-end",
    is_flag=True,
    help="Keep the configuration's far limit, end_m. -s filter.end_m=METRES does so too.",
)
@click.option(
    "--plot",
    "plot_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Also draw clutter and thresholds over range; .png or .svg.",
)
@label_options(required=False)
@config_options
@selection_options
@output_options
def command(logs: tuple[str, ...], output: Path, **options: Any) -> None:
    """Find the thresholds of each ring and the far limit of clutter in LOGS, and write a configuration.

    LOGS should hold sea clutter seen by your sensor, and no targets; where there are some, --labels leaves them out.
    The configuration given with -c is the starting point, for the rings and all that is not found here.
    """
    from seaclutter_cli.commands.outputs import refuse_overwriting
    from seaclutter_cli.sinks.atomic import AtomicFile
    from seaclutter_cli.sources import find_recordings

    config = _config(options)
    recordings = find_recordings(logs)
    plot_file: Path | None = options["plot_file"]
    refuse_overwriting([output, *([plot_file] if plot_file else [])], recordings, force=options["force"])
    _check_plot(plot_file, output)
    job = Job(config, recordings, options)
    calibrated = job.run()
    text = calibrated.config_text()
    pictures = {plot_file: job.picture(calibrated.found, plot_file.suffix)} if plot_file else {}
    for path, data in {output: text.encode(), **pictures}.items():
        with AtomicFile(path) as file:
            file.stream.write(data)
    click.echo(json.dumps(calibrated.as_dict(output), indent=2) if options["as_json"] else calibrated.as_text(output))
    if calibrated.damage:
        raise click.exceptions.Exit(3)


def _config(options: Mapping[str, Any]) -> "Config":
    """Return the configuration to start from; its thresholds are open."""
    from seaclutter_cli.config import load_config
    from seaclutter_cli.filters import FILTERS
    from seaclutter_cli.filters.joint import RingIntensityParams

    config = load_config(
        options["config_file"], method=options["method"], overrides=options["overrides"], open_thresholds=True
    )
    if not isinstance(config.filter, RingIntensityParams):
        fitting = (name for name, kind in FILTERS.items() if issubclass(kind.Params, RingIntensityParams))
        raise UsageError(f"method {config.method} has no ring thresholds to find; choose -m {', -m '.join(fitting)}")
    return config


def _check_plot(plot_file: Path | None, output: Path) -> None:
    from seaclutter_cli.plots.figure import check_target

    if plot_file:
        check_target(plot_file)
        if plot_file.resolve() == output.resolve():
            raise UsageError(f"{plot_file}: cannot be the configuration and the picture")


class Job:
    """One calibration over all recordings of a run."""

    def __init__(self, config: "Config", recordings: Sequence["Recording"], options: Mapping[str, Any]) -> None:
        from seaclutter_cli.calibration import Calibration
        from seaclutter_cli.commands.truths import labels_for
        from seaclutter_cli.filters.zones import MAX_RINGS
        from seaclutter_cli.pipeline import Selection
        from seaclutter_cli.plots.clutter import ClutterDensity

        self._config, self._recordings, self._options = config, recordings, options
        chosen = ("topics", "start_s", "end_s", "frames", "intensity_field")
        self._selection = Selection(**{name: options[name] for name in chosen})
        self._labels: Sequence[Labels | None] = [None] * len(recordings)
        if options["label_paths"]:
            self._labels = labels_for(recordings, options["label_paths"], options)
        given = any(override.partition("=")[0].strip() == "filter.end_m" for override in options["overrides"])
        params = config.filter
        self._calibration = Calibration(
            params, filter_rate=options["filter_rate"], keep_end=options["keep_end"] or given
        )
        self._density: ClutterDensity | None = None
        if options["plot_file"]:
            self._density = ClutterDensity(params.start_m, params.ring_width_m, MAX_RINGS)

    def run(self) -> "Calibrated":
        """Read all recordings and return what comes of them."""
        from seaclutter_cli.commands.calibrated import Calibrated

        calibrated = Calibrated(self._config, self._options["filter_rate"], labelled=self._labels[0] is not None)
        for recording, labels in zip(self._recordings, self._labels, strict=True):
            decoding = decoding_options(self._options)
            with closing(recording.open(rate_hz=self._options["rate_hz"], decoding=decoding)) as source:
                self._read(source, labels, calibrated)
                calibrated.damage += source.damage
                report_damage(source.damage, verbose=self._options["verbose"])
        if calibrated.unlabelled and not calibrated.frames:
            raise LabelError(f"not one of {count(calibrated.unlabelled)} is labelled: nothing tells what is clutter")
        calibrated.kept_end = self._calibration.keep_end
        calibrated.points, calibrated.intensity = self._calibration.points, self._calibration.intensity
        calibrated.found = self._calibration.thresholds()
        return calibrated

    def picture(self, found: "Thresholds", suffix: str) -> bytes:
        """Return the file of the picture."""
        from seaclutter_cli.plots.clutter import draw_clutter
        from seaclutter_cli.plots.figure import render

        density = self._density
        assert density is not None  # noqa: S101 - there is one if a picture is asked for
        return render(lambda figure: draw_clutter(figure, density, found), suffix)

    def _take(self, range_m: Any, intensity: Any) -> None:
        self._calibration.add(range_m, intensity)
        if self._density is not None:
            self._density.add(range_m, intensity)

    def _read(self, source: "Source", labels: "Labels | None", calibrated: "Calibrated") -> None:
        from seaclutter_cli.calibration import ClutterReader
        from seaclutter_cli.pipeline import cloud_channels, run

        clouds = cloud_channels(source, self._selection.topics)
        topics = sorted({channel.topic for channel in clouds})
        if labels and len(topics) > 1:
            raise UsageError(f"{source.name}: labels are of one topic; choose from: -t {' -t '.join(topics)}")
        told = len(source.warnings)
        for text in source.warnings:
            warn(text, quiet=self._options["quiet"])
        margin_m = self._config.evaluation.box_margin_m
        reader = ClutterReader(self._config.filter, self._take, labels, margin_m)
        total = sum(source.counts.get(channel.id, 0) for channel in clouds)
        progress = Progress(self._selection.frames or total or None, source.name, quiet=self._options["quiet"])

        def on_frame(result: "FilterResult") -> None:
            progress.step()
            calibrated.look_at(source.name, result.frame)

        with progress:
            run(source, lambda: reader, [], self._selection, on_frame)
        for text in source.warnings[told:]:
            warn(text, quiet=self._options["quiet"])
        if not reader.frames + reader.unlabelled and source.damage:
            raise InputError(f"{source.name}: no frame can be read; {source.damage[0]}")
        if labels and not source.damage and self._is_whole:
            labels.finish()
        calibrated.facts += [facts for topic, facts in facts_of(source).items() if topic in topics]
        calibrated.count(source.name, reader)

    @property
    def _is_whole(self) -> bool:
        """Whether recordings are read from their first frame to the last."""
        chosen = self._selection
        return chosen.start_s is None and chosen.end_s is None and chosen.frames is None
