"""What the echoes of a tile look like, by square and by cell."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cell_echoes import cell_variation
from seaclutter_cli.airborne.echoes import Echoes, echoes_of
from seaclutter_cli.airborne.gridded import GriddedPoints
from seaclutter_cli.airborne.squares import Squares
from seaclutter_cli.airborne.strips import Column

Cells = NDArray[np.float64]


@dataclass(frozen=True)
class EchoReader:
    """Reads the echoes of a tile up to an elevation of each cell.

    Parameters
    ----------
    points : GriddedPoints
        The points.
    column : callable
        Returns an attribute of all points.
    change_m : ndarray or None
        By how much the level of each square of all blocks differs between two strips.
    trusted : collection of int
        ASPRS classes of the points, 2 or 9, that are right.
    """

    points: GriddedPoints
    column: Column
    change_m: NDArray[np.float64] | None
    trusted: Collection[int] = ()

    def squares(self, squares: Squares, top: Cells) -> Echoes:
        """Return the echoes of squares (`echoes_of`)."""
        return echoes_of(squares, self.points, top, self.column, self.change_m, self.trusted)

    def cell_variation(self, top: Cells) -> Cells | None:
        """Return the variation of the intensities around each cell (`cell_echoes.cell_variation`)."""
        return cell_variation(self.points, top, self.column)
