"""A method of one's own: seaclutter filter LOG -o OUT -m examples/mine.py:above_the_surface."""

import numpy as np


def above_the_surface(frame):
    """Keep what is more than 0.8 m above the median of all points."""
    z = frame.xyz[:, 2]
    return z > np.nanmedian(z) + 0.8
