"""A program of a user, which mypy checks with the package: public names are typed, and a wrong argument is an error.

No test runs it. That an error is ignored without need is an error, too.
"""

from typing import assert_type

import numpy as np
from numpy.typing import NDArray

import seaclutter
from seaclutter_cli.evaluation.scores import Summary


def use() -> None:
    with seaclutter.open_log("log.mcap") as log:
        for frame in log.frames("/points"):
            assert_type(frame.xyz, NDArray[np.float64])
            assert_type(seaclutter.filter_points(frame.xyz, frame.intensity).keep, NDArray[np.bool_])
    assert_type(seaclutter.evaluate("log.mcap", "labels.csv").totals(), dict[str, Summary])
    seaclutter.filter_log("log.mcap", 5)  # type: ignore[arg-type]
