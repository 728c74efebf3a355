"""Groups of cells across blocks."""

import numpy as np
from scipy import ndimage

from seaclutter_cli.grids.cells import joined_cells
from seaclutter_cli.grids.elevation import BLOCK, ElevationGrid


def test_joined_cells_are_those_that_touch_also_across_blocks():
    image = np.random.default_rng(5).random((4 * BLOCK, 3 * BLOCK)) < 0.3
    for row, column in np.argwhere(np.ones((3, 2))) + 1:  # each corner of blocks is crossed by one of both diagonals
        corner = image[row * BLOCK - 2 : row * BLOCK + 2, column * BLOCK - 2 : column * BLOCK + 2]
        corner[:] = np.eye(4) if (row + column) % 2 else np.eye(4)[::-1]
    labels, _ = ndimage.label(image, np.ones((3, 3)))
    grid = ElevationGrid(1.0)
    column, row = BLOCK * np.indices((4, 3)).reshape(2, -1)
    grid.add(np.stack((column - 2.0 * BLOCK, row + 1000.0 * BLOCK, np.zeros(12))))
    mask = image.reshape(4, BLOCK, 3, BLOCK).swapaxes(1, 2).reshape(-1, BLOCK, BLOCK)
    part, group = joined_cells(grid, mask)
    found = group[part].reshape(4, 3, BLOCK, BLOCK).swapaxes(1, 2).reshape(image.shape)
    pairs = set(zip(found.ravel().tolist(), labels.ravel().tolist(), strict=True))
    assert len(pairs) == len(set(found.ravel().tolist())) == len(set(labels.ravel().tolist()))
    np.testing.assert_array_equal(part > 0, mask)
