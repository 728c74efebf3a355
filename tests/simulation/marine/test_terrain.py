import numpy as np
import pytest

from seaclutter_cli.simulation.lidar import Echoes, Shots
from seaclutter_cli.simulation.marine.recording import Renderer
from seaclutter_cli.simulation.marine.scene import load_scene, parse_scene
from seaclutter_cli.simulation.marine.terrain import Ground, GroundParams
from seaclutter_cli.truth import IGNORED


def ground(**params):
    return Ground(GroundParams(**params), 3)


def test_the_ground_has_its_roughness():
    x, y = np.random.default_rng(1).uniform(-500, 500, (2, 20_000))
    height, slope_x, slope_y = ground(roughness_m=0.05).height_and_slopes(x, y)
    assert height.std() == pytest.approx(0.05, rel=0.1)
    step = 1e-5
    there, _, _ = ground(roughness_m=0.05).height_and_slopes(x + step, y)
    np.testing.assert_allclose((there - height) / step, slope_x, atol=1e-4)
    there, _, _ = ground(roughness_m=0.05).height_and_slopes(x, y + step)
    np.testing.assert_allclose((there - height) / step, slope_y, atol=1e-4)


def test_shots_hit_the_ground_at_its_height():
    angles = np.linspace(-0.5, 0.1, 500)
    directions = np.stack((np.cos(angles), np.zeros(500), np.sin(angles)), axis=1)
    shots = Shots(np.tile([0.0, 0.0, 1.0], (500, 1)), directions, np.zeros(500))
    echoes = Echoes.empty(500)
    uneven = ground(roughness_m=0.02)
    uneven.add_echoes(shots, echoes, np.random.default_rng(1))
    met = np.isfinite(echoes.range_m)
    assert np.array_equal(met, angles < 0)
    steep = met & (angles < -0.1)
    positions = shots.origins[steep] + echoes.range_m[steep, None] * directions[steep]
    np.testing.assert_allclose(
        positions[:, 2], uneven.height_and_slopes(positions[:, 0], positions[:, 1])[0], atol=0.01
    )
    assert set(echoes.label[met].tolist()) == {IGNORED}


def test_a_scene_on_land_has_no_water():
    raw = load_scene("poplar").with_recording(lidar="OS1-64").as_dict() | {"noise": {}}
    frame = Renderer(parse_scene(raw, "test")).frame(0)
    assert IGNORED in frame.points["label"]
    assert len(np.unique(frame.points["label"])) > 20
    assert not (frame.points["label"] == 0).any()
    assert frame.boxes.classes[:2] == ("ignore", "ignore")  # the vehicle and the ground
    assert "ground" in raw
    assert "sea" not in raw


def test_the_ground_is_the_same_at_any_time():
    uneven = ground()
    assert uneven.at(0.0) is uneven.at(9.0)
