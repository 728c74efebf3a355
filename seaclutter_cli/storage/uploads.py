"""Upload of complete files. Unlike the last request, which lets an object appear, it may be interrupted."""

from pathlib import Path

from seaclutter_cli.errors import OutputError
from seaclutter_cli.storage.locations import Url
from seaclutter_cli.storage.objects import PendingObject

_PIECE = 4 * 2**20


def send(file: Path, url: Url) -> PendingObject:
    """Send a file to an object, which does not appear yet.

    Raises
    ------
    OutputError
        If it cannot be sent; nothing is left of it then.
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
