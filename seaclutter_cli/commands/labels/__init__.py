"""``seaclutter labels``: labels of recordings."""

from seaclutter_cli.commands.lazy import LazyGroup

command = LazyGroup(
    "labels",
    commands={"check": "Find mistakes in labels that would give wrong rates without an error."},
    help="Check labels of recordings.",
)
