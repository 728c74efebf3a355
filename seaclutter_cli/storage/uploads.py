"""Upload of complete files. Unlike the last request, which lets an object appear, it may be interrupted."""

from pathlib import Path

from seaclutter_cli.errors import OutputError
from seaclutter_cli.storage.objects import PendingFolder, PendingObject
from seaclutter_cli.urls import Url

_PIECE = 4 * 2**20


def send(file: Path, url: Url) -> PendingObject:
    """Send a file to an object, which does not appear yet.

    Raise `OutputError` if it cannot be sent; nothing is left of it then.
    """
    pending = PendingObject(url, file.stat().st_size)
    try:
        with file.open("rb") as stream:
            while piece := stream.read(_PIECE):
                pending.write(piece)
    except OSError as error:
        pending.abort()
        raise OutputError(f"{url}: the copy in the scratch folder cannot be read ({error.strerror})") from error
    except BaseException:
        pending.abort()
        raise
    return pending


def send_folder(folder: Path, url: Url, last: str) -> PendingFolder:
    """Send the files in a folder; ``last`` shows that the folder is complete. See `send` for errors."""
    pending = PendingFolder(url)
    try:
        for file in sorted(folder.iterdir(), key=lambda file: (file.name == last, file.name)):
            pending.files[url / file.name] = send(file, url / file.name)
    except BaseException:
        pending.abort()
        raise
    return pending
