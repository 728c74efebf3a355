"""Sending of files to object storage. Unlike the last request, which lets an object appear, it may be interrupted."""

from pathlib import Path
from typing import TYPE_CHECKING

from seaclutter_cli.errors import OutputError
from seaclutter_cli.storage.stores import explained
from seaclutter_cli.urls import Url

if TYPE_CHECKING:
    from obstore import WritableFile

_PIECE = 4 * 2**20


def send(file: Path, url: Url, writer: "WritableFile") -> None:
    """Send a file to an object, which does not appear yet; `OutputError` if it cannot be sent."""
    with file.open("rb") as stream:
        while piece := stream.read(_PIECE):
            with explained(url, OutputError):
                writer.write(piece)
