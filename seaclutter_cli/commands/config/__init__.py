"""``seaclutter config``: configurations, and lists of built-in sensors, methods and scenes."""

from seaclutter_cli.commands.lazy import LazyGroup

command = LazyGroup(
    "config",
    commands={
        "show": "Print the effective configuration, ready to save and edit.",
        "check": "Check configuration files and list all errors.",
        "list": "List built-in sensors, methods, formats, configurations, scenes and lidars.",
    },
    former={"sensors": "list"},
    help="Show and check configurations; list built-in sensors, methods and scenes.",
)
