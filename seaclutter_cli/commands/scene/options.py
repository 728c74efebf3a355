"""Options shared by the scene commands."""

from pathlib import Path

import click

from seaclutter_cli.commands.options import force_option, grouped
from seaclutter_cli.commands.places import output_option

labelled_logs = grouped(
    "logs",
    "runs.scene.logs:LabelledLogs",
    (
        click.argument("folders", metavar="[FOLDERS]...", nargs=-1, type=click.Path(path_type=Path)),
        click.option(
            "--scene",
            "scenes",
            multiple=True,
            metavar="CLASS=LOGS",
            help="A class, and the file, folder or glob of its logs; repeatable.",
        ),
    ),
)
"""Logs by the class of their scene; passed as ``logs``."""

classifier_options = grouped(
    "options",
    "runs.scene.logs:ClassifierOptions",
    (
        click.option(
            "--model",
            metavar="FILE",
            default="open_confined",
            show_default=True,
            help="ONNX file of a classifier, or the name of a built-in one.",
        ),
        click.option(
            "--every",
            type=click.IntRange(min=1),
            default=1,
            metavar="N",
            show_default=True,
            help="Classify one frame in N; the others keep its scene.",
        ),
        click.option(
            "--hold",
            type=click.IntRange(min=1),
            default=1,
            metavar="M",
            show_default=True,
            help="Change the scene only after M consecutive classifications agree on another one.",
        ),
        output_option("--csv", "csv_file", help="Write a CSV table with a line for each frame."),
        force_option,
    ),
)
"""Options of a trained classifier; passed as ``options``."""
