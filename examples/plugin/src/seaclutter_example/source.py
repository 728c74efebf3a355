"""A log format: text with a line ``time x y z intensity`` for each point, in the order of time."""

from pathlib import Path

import numpy as np

from seaclutter.plugins import Cloud, CloudSource, InputError, from_array

POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])


class TextSource(CloudSource):
    """A text file of points."""

    format = "example text"
    suffixes = (".points.txt",)

    def __init__(self, path: Path) -> None:
        try:
            rows = np.loadtxt(path, np.float64, ndmin=2).reshape(-1, 5)
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: not a text of points ({error})") from error
        self._times_s, starts = np.unique(rows[:, 0], return_index=True)
        self._clouds = np.split(rows[:, 1:], starts[1:]) if len(rows) else []
        super().__init__(path.name.removesuffix(".points.txt"), [round(1e9 * time) for time in self._times_s.tolist()])

    def cloud(self, index: int) -> Cloud:
        """Return the cloud with a number."""
        points = np.zeros(len(self._clouds[index]), POINT)
        for name, column in zip(POINT.names or (), self._clouds[index].T, strict=True):
            points[name] = column
        return from_array(points, stamp_ns=round(1e9 * float(self._times_s[index])))
