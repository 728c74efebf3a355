"""Groups of cells across blocks."""

import numpy as np
from scipy import ndimage

from seaclutter_cli.grids.cells import joined_cells


def test_joined_cells_are_those_that_touch_also_across_blocks():
    image = np.random.default_rng(5).random((40, 30)) < 0.3
    labels, _ = ndimage.label(image, np.ones((3, 3)))
    side = 5
    blocks = {(i - 2, j + 1000): i * 6 + j for i in range(8) for j in range(6)}
    part, group = joined_cells(image.reshape(8, side, 6, side).swapaxes(1, 2).reshape(-1, side, side), blocks)
    found = group[part].reshape(8, 6, side, side).swapaxes(1, 2).reshape(image.shape)
    pairs = set(zip(found.ravel().tolist(), labels.ravel().tolist(), strict=True))
    assert len(pairs) == len(set(found.ravel().tolist())) == len(set(labels.ravel().tolist()))
    np.testing.assert_array_equal(part > 0, image.reshape(8, side, 6, side).swapaxes(1, 2).reshape(-1, side, side))
