import numpy as np
import pytest

from seaclutter_cli.simulation.lidar import Echoes, Shots
from seaclutter_cli.simulation.marine.bodies import PlacedBody, bearings
from seaclutter_cli.simulation.marine.motion import Pose, rotations
from seaclutter_cli.simulation.marine.shapes import SHAPES


def shots():
    rng = np.random.default_rng(3)
    directions = rng.normal(0, (1, 1, 0.1), (6000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = rng.uniform(-0.5, 0.5, (6000, 3)) * (1, 1, 0) + (3, -2, 2)
    return Shots(origins, directions, np.arctan2(directions[:, 1], directions[:, 0]))


@pytest.mark.parametrize("shape", SHAPES)
def test_no_shot_that_hits_a_body_is_left_out(shape):
    fired, rng = shots(), np.random.default_rng(7)
    for _ in range(4):
        mesh = SHAPES[shape].scaled(*rng.uniform((2, 1, 1), (60, 12, 6)).tolist())
        position = np.append(rng.uniform(-40, 40, 2), 0.0)
        pose = Pose(position, rotations(float(rng.uniform(-4, 4)), 0.1, -0.1))
        every, some = Echoes.empty(len(fired)), Echoes.empty(len(fired))
        body = PlacedBody(mesh, 0.5, 1, pose, pose, 0.0)
        body.add_echoes(fired, every, np.arange(len(fired)))
        first, last = bearings(fired, [body])
        body.add_echoes(fired, some, fired.between(float(first[0]), float(last[0])))
        np.testing.assert_allclose(some.range_m, every.range_m, rtol=1e-12)
