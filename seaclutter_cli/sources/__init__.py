"""Logs in every supported format, each opened as a `Source`."""

from seaclutter_cli.sources.formats import SOURCES, Format, open_source
from seaclutter_cli.sources.recordings import (
    Recording,
    Search,
    find_recordings,
    has_metadata_beside,
    metadata_beside,
    require_one,
)

__all__ = [
    "SOURCES",
    "Format",
    "Recording",
    "Search",
    "find_recordings",
    "has_metadata_beside",
    "metadata_beside",
    "open_source",
    "require_one",
]
