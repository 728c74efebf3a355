"""``seaclutter report``: what a filter did and how well, as one page that opens offline."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.console import warn
from seaclutter_cli.commands.options import (
    force_option,
    logs_argument,
    methods_options,
    output_options,
    selection_options,
)
from seaclutter_cli.commands.truths import label_options

if TYPE_CHECKING:
    from seaclutter_cli.commands.reported import Reported


@click.command(name="report", short_help="Show what a filter did, and how well, in one page.")
@logs_argument
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="REPORT.html",
    help="The page: one file that opens in any browser, without a network.",
)
@force_option
@click.option(
    "--figures",
    "figure_folder",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Also write every figure as a picture for print.",
)
@click.option(
    "--figure-format",
    type=click.Choice(["svg", "png"]),
    default="svg",
    show_default=True,
    help="Format of --figures.",
)
@click.option(
    "--show",
    "shown",
    type=click.IntRange(1, 100),
    default=12,
    metavar="N",
    show_default=True,
    help="Frames whose points go into the page.",
)
@click.option(
    "--pick", "picks", multiple=True, type=click.IntRange(min=0), metavar="K", help="Show frame K too; repeatable."
)
@label_options(required=False)
@methods_options
@selection_options
@output_options
def command(logs: tuple[str, ...], **options: Any) -> None:
    """Write a page that shows what a filter did to LOGS and, with labels, how well.

    LOGS are raw logs, which are filtered for the report; or logs that `filter --keep-raw --with-removed` has written,
    of which nothing is computed again. The page shows points of some frames: of the worst, the best, and of some evenly
    spread between.
    """
    from seaclutter_cli.sinks.atomic import AtomicFile

    reported = _run(logs, options)
    if missing := reported.missing(options["picks"]):
        warn(f"no log has a frame {', '.join(map(str, missing))}: --pick counts from 0", quiet=options["quiet"])
    files = {} if all(outcome.error for outcome in reported.outcomes) else {options["output"]: reported.page()}
    if files and options["figure_folder"]:
        files |= reported.pictures(options["figure_folder"], options["figure_format"])
    for path, content in files.items():
        with AtomicFile(path) as file:
            file.stream.write(content)
    sizes = {path: len(content) for path, content in files.items()}
    click.echo(json.dumps(reported.as_dict(sizes), indent=2) if options["as_json"] else reported.as_text(sizes))
    if any(outcome.error for outcome in reported.outcomes):
        raise click.exceptions.Exit(1)
    if any(outcome.damage for outcome in reported.outcomes):
        raise click.exceptions.Exit(3)


def _run(logs: tuple[str, ...], options: Mapping[str, Any]) -> "Reported":
    """Look at all recordings."""
    from seaclutter_cli.commands.outputs import refuse_overwriting
    from seaclutter_cli.commands.reported import picture_names, replayed, run_methods
    from seaclutter_cli.commands.truths import labels_for
    from seaclutter_cli.errors import UsageError
    from seaclutter_cli.plots.figure import check_target
    from seaclutter_cli.sources import find_recordings

    recordings = find_recordings(logs)
    folder: Path | None = options["figure_folder"]
    targets = [options["output"]]
    if folder:
        if folder.exists() and not folder.is_dir():
            raise UsageError(f"{folder}: is a file; --figures takes a folder")
        targets += [folder / name for name in picture_names(options["figure_format"])]
        check_target(targets[-1])
    refuse_overwriting(targets, recordings, force=options["force"])
    if options["output"].resolve() in {path.resolve() for path in options["label_paths"]}:
        raise UsageError(f"{options['output']}: these are the labels; choose another output")
    labels = labels_for(recordings, options["label_paths"], options) if options["label_paths"] else None
    chosen = any(options[name] for name in ("config_file", "methods", "comparisons", "overrides"))
    found = None if chosen else replayed(recordings, labels, options)
    return found or run_methods(recordings, labels, options)
