"""``seaclutter config``: show and check configurations, list what is built in."""

from seaclutter_cli.commands.lazy import LazyGroup

command = LazyGroup(
    "config",
    commands={
        "show": "Print the effective configuration, ready to be saved and changed.",
        "check": "Tell whether configuration files are valid, with everything that is wrong.",
        "sensors": "List what is built in: sensors, methods, formats, configurations, scenes, lidars.",
    },
    help="Show and check configurations; list what is built in.",
)
