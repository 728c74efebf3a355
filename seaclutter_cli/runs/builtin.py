"""Names of built-in sensors, methods, formats, configurations, scenes, layouts, tiles and lidars to simulate."""

import textwrap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from seaclutter_cli.filters import FILTERS
from seaclutter_cli.registry import package, plugins
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.recordings import Result
from seaclutter_cli.sensors.catalog import SENSORS, SensorModel
from seaclutter_cli.simulation.airborne.scene import builtin_tiles
from seaclutter_cli.simulation.layouts import LAYOUTS, RANDOM
from seaclutter_cli.simulation.lidar import LIDARS
from seaclutter_cli.simulation.marine.scene import builtin_scenes
from seaclutter_cli.sources.formats import SOURCES
from seaclutter_cli.sources.frame_files import FRAME_READERS
from seaclutter_cli.text import table
from seaclutter_cli.validation import builtin_files


def list_builtin(kinds: Collection[str], observer: Observer) -> "Builtin":  # noqa: ARG001
    """Return built-in items of some kinds, or of all."""
    methods = {name: (kind.__doc__ or "").partition("\n")[0] for name, kind in FILTERS.items()}
    lists: dict[str, Any] = {
        "sensors": SENSORS,
        "methods": methods,
        "formats": [form.title for form in SOURCES.values()] + [f"*{suffix}" for suffix in FRAME_READERS],
        "configs": [path.name for path in builtin_files().values()],
        "scenes": list(builtin_scenes()),
        "layouts": [*LAYOUTS, RANDOM],
        "tiles": list(builtin_tiles()),
        "lidars": list(LIDARS),
        "plugins": [f"{one.name} ({kind}, {package(one)})" for kind, points in plugins().items() for one in points],
    }
    wanted = {kind: items for kind, items in lists.items() if not kinds or kind in kinds}
    return Builtin(wanted.pop("sensors", {}), wanted.pop("methods", {}), wanted)


@dataclass(frozen=True)
class Builtin(Result):
    """Built-in sensors, methods with a line about each, and names of other built-in items by kind."""

    sensors: Mapping[str, SensorModel]
    methods: Mapping[str, str]
    lists: Mapping[str, Sequence[str]]

    def as_dict(self) -> dict[str, Any]:
        """Return the lists as JSON-compatible data."""
        sensors = {name: {"maker": s.maker, "beams": s.beams, "columns": s.columns} for name, s in self.sensors.items()}
        return {"sensors": sensors, "methods": self.methods, **self.lists}

    def as_text(self) -> str:
        """Return the lists as human-readable text."""
        rows = [(name, s.maker, s.beams, s.columns, s.intensity) for name, s in self.sensors.items()]
        sensors = table(("sensor", "maker", "beams", "columns", "intensity"), rows) if rows else ""
        methods = table(("method", ""), [(f"{name:<24}{summary}", "") for name, summary in self.methods.items()])
        lines = (f"{name:<9} {', '.join(values)}" for name, values in self.lists.items() if values)
        lists = "\n".join(textwrap.fill(line, 79, subsequent_indent=" " * 10) for line in lines)
        return "\n\n".join(filter(None, (sensors, methods if self.methods else "", lists)))
