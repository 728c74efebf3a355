"""Tables of a filter run, with a row for each frame."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from seaclutter_cli.config import Config
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.csv import CsvSink


def frame_table(config: Config, path: Path, group: OutputGroup | None = None) -> CsvSink:
    """Return the table for the frames of recordings."""
    rings = len(config.ring_edges[1:])
    return CsvSink(path, rings, scenes=config.has_scenes, water=config.has_water, group=group)


@contextmanager
def own_table(config: Config) -> Iterator[CsvSink]:
    """Return a table for the frames of one recording, which is removed at the end."""
    with TemporaryDirectory(prefix="seaclutter-") as folder, frame_table(config, Path(folder, "t.csv")) as own:
        yield own
