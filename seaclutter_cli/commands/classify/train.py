"""``seaclutter classify train``: training of a random forest on labelled tiles."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.classify.options import settings_options, tiles_argument
from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, force_option, grouped
from seaclutter_cli.commands.places import output_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.classify.train import TrainForestOptions

_OPTIONS = (
    output_option("-o", "--output", metavar="MODEL", required=True, help="Model file to write."),
    click.option(
        "--class-field",
        default="object_class",
        metavar="NAME",
        show_default=True,
        help="Field with the class of each point, 1 to 8; 0 for none.",
    ),
    click.option(
        "--object-field",
        default="object_id",
        metavar="NAME",
        show_default=True,
        help="Field with object numbers; without it, clusters of a class are objects.",
    ),
    output_option("--plot", "plot_file", help="Draw the confusion matrix, as PNG or SVG."),
    force_option,
    settings_options,
)


@click.command(name="train", short_help="Train a random forest on labelled tiles.")
@tiles_argument
@grouped("options", "runs.classify.train:TrainForestOptions", _OPTIONS)
@console_options
def command(tiles: tuple[str, ...], options: "TrainForestOptions", console: Console) -> None:
    """Train a random forest on labelled TILEs to classify objects.

    Part of the tiles, or of the objects if there are fewer than four tiles, is held out for a test, which the report
    shows. Classes are 1 ship, 2 reef, 3 shoal, 4 aquaculture, 5 seaweed, 6 island, 7 fishing fence, 8 garbage patch.
    Needs the extra classify.
    """
    from seaclutter_cli.runs.classify.train import train_forest

    console.finish(train_forest(tiles, options, console))
