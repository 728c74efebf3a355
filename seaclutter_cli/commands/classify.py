"""``seaclutter classify``: sea and objects in airborne lidar tiles."""

from seaclutter_cli.commands.groups import CommandGroup
from seaclutter_cli.commands.options import command
from seaclutter_cli.options import Anything, Place, option
from seaclutter_cli.runs.options.tiles import ClassifyTilesOptions, SeparateTilesOptions, TrainForestOptions

_TILES = option("TILE...", kind=Anything(), help="Tiles.")
_OUTPUT = option(
    "-o --output OUT",
    kind=Place(output=True, or_folder=True),
    help="Output file for one tile; folder for several, or with a slash at its end: LAS, LAZ, PCD, PLY or MCAP.",
)

_CLASSIFY = [
    command(
        "classify separate",
        "runs.classify.separate:separate_tiles",
        {"tiles": _TILES, "output": _OUTPUT, "options": SeparateTilesOptions},
        """Separate each TILE into sea and non-sea points by morphological opening; on rough water, follow the waves.

        Sea points get the ASPRS class 9 (water), all others 1; land is recognised by its level, flatness and echoes.
        Everything else in a LAS or LAZ file is kept; a record says which waves were found. Several tiles are a survey:
        each is separated with a margin from its neighbours. TILE is a LAS or LAZ file, or a
        PCD, PLY, NPY, KITTI or CSV file in metres with z upwards, or a folder or glob of such files.
        """,
        short_help="Separate tiles into sea and non-sea points.",
    ),
    command(
        "classify train",
        "runs.classify.train:train_forest",
        {"tiles": _TILES, "options": TrainForestOptions},
        """Train a random forest on labelled TILEs to classify objects.

        Part of the tiles, or of the objects if there are fewer than four tiles, is held out for a test, which the
        report shows. Classes are 1 ship, 2 reef, 3 shoal, 4 aquaculture, 5 seaweed, 6 island, 7 fishing fence, 8
        garbage patch. Needs the extra classify.
        """,
        short_help="Train a random forest on labelled tiles.",
    ),
    command(
        "classify predict",
        "runs.classify.predict:classify_tiles",
        {"tiles": _TILES, "output": _OUTPUT, "options": ClassifyTilesOptions},
        """Classify the non-sea points of each TILE with a trained model, and find the objects.

        Each point gets the additional dimensions predicted_class (0 for none, otherwise as in train), probability and
        predicted_object, and the same classification as by separate. The CSV table has the coordinates of the tile;
        GeoJSON and GeoPackage are in WGS 84 if the tile states its coordinate reference system.
        """,
        short_help="Classify points and objects with a trained model.",
    ),
]

COMMANDS = (CommandGroup("classify", _CLASSIFY),)
