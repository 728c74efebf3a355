"""Channel angles of a Hesai sensor, from the unit's angle correction file."""

import csv

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.text import count

_NOT_ANGLES = "{}: not a Hesai angle correction file (Laser id,Elevation,Azimuth): {}"


def parse_angles(data: bytes, name: str, channels: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the elevation and azimuth offset of each channel, shape (channels,), in degrees.

    Parameters
    ----------
    data : bytes
        Content of an angle correction file: lines of ``Laser id,Elevation,Azimuth`` in degrees, with channels numbered
        from 1.
    name : str
        Name of the file, for errors.
    channels : int
        Number of channels.

    Raises
    ------
    InputError
        If it is another file, or does not list exactly these channels.
    """
    try:
        lines = data.decode("utf-8-sig").splitlines()
        rows = [row for row in csv.reader(lines) if row and row[0].strip().isdecimal()]
        angles = {int(row[0]): (float(row[1]), float(row[2])) for row in rows}
    except (UnicodeDecodeError, ValueError, IndexError, csv.Error) as error:
        raise InputError(_NOT_ANGLES.format(name, error)) from error
    if sorted(angles) != list(range(1, channels + 1)) or not np.isfinite(list(angles.values())).all():
        raise InputError(
            f"{name}: expected finite angles of channels 1 to {channels}, got {count(len(angles), 'channel')}"
        )
    table = np.array([angles[channel] for channel in sorted(angles)])
    return table[:, 0], table[:, 1]
