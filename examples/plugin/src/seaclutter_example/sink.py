"""An output: each frame as a table of text."""

from typing import BinaryIO

import numpy as np

from seaclutter.plugins import Cloud, OutputFormat


def write_table(stream: BinaryIO, cloud: Cloud) -> None:
    """Write a frame."""
    points = cloud.points
    np.savetxt(stream, np.stack([points[axis] for axis in "xyz"], axis=1), "%.4f")


FORM = OutputFormat("text tables", write_table, ".tab")
