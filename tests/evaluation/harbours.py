"""Boats on a rough sea, with labels: points on the sides of boxes, and clutter everywhere."""

import numpy as np

from seaclutter_cli.truth import Boxes, Truth
from tests.evaluation.scenes import frame_of

BOATS = np.array(
    [  # x, y, z, length, width, height, yaw
        [22.0, 8.0, 0.0, 9.0, 3.0, 2.4, 0.4],
        [-15.0, 31.0, 0.6, 14.0, 4.0, 4.0, 2.2],
        [40.0, -28.0, 0.2, 11.0, 3.2, 3.0, -1.1],
        [12.0, -17.0, -0.4, 1.0, 1.0, 1.4, 0.0],
    ]
)
CLASSES = ("speedboat", "sailing boat", "boat", "buoy")


def sides_of(row, random, count=400):
    """Return points on the sides of a box and on its deck, shape (count, 3)."""
    center, size, yaw = row[:3], row[3:6], row[6]
    unit = random.uniform(-0.5, 0.5, (count, 3))
    side = random.integers(0, 3, count)
    unit[np.arange(count), side] = np.where(side == 2, 0.5, np.sign(unit[np.arange(count), side]) / 2)
    x, y, z = (unit * size).T
    turned = np.column_stack([np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x + np.cos(yaw) * y, z])
    return turned + center


def boxes_of(rows, classes=CLASSES):
    rows = np.asarray(rows, float)
    names = tuple(str(number) for number in range(len(rows)))
    return Boxes(names, tuple(classes), rows[:, :3], rows[:, 3:6], rows[:, 6])


def harbour(number, change=lambda rows: rows, classes=CLASSES):
    """Return a frame, and its truth after a change of the rows of `BOATS`."""
    random = np.random.default_rng(number)
    rows = BOATS.copy()
    rows[:, :2] += 0.3 * number
    sea = np.column_stack([random.uniform(-60, 60, (1500, 2)), random.normal(-0.8, 0.1, 1500)])
    frame = frame_of(sea, *(sides_of(row, random) for row in rows), index=number)
    return frame, Truth(boxes_of(change(rows.copy()), classes))
