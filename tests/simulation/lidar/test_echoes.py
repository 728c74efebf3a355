import numpy as np
import pytest

from seaclutter_cli.simulation.lidar import Echoes, NoiseParams, add_mixed_pixels, false_returns
from seaclutter_cli.simulation.marine.recording import Renderer
from seaclutter_cli.simulation.marine.scene import load_scene, parse_scene

POST = {"track_id": 1, "shape": "pile", "size_m": [0.6, 0.6, 4], "path": [[8, 0]], "wave_response": 0}
WALL = {
    "track_id": 2,
    "shape": "quay_wall",
    "size_m": [1, 60, 6],
    "path": [[14.5, 0]],
    "reflectivity": 0.9,
    "wave_response": 0,
}


def points(noise, *objects):
    raw = {
        "recording": {"lidar": "CE30-D", "dropout": 0},
        "ground": {"roughness_m": 0.0},
        "vessel": {"wave_response": 0.0, "lidar_height_m": 1.0, "lidar_forward_m": 4.0},
        "noise": noise,
        "objects": list(objects),
    }
    return Renderer(parse_scene(raw, "test")).frame(0).points


def ranges(cloud):
    return np.sqrt(sum(cloud[axis].astype(float) ** 2 for axis in "xyz"))


def edge(first, second, reflectances=(0.5, 0.5), count=4000):
    """Return echoes of neighbouring shots on two surfaces, each pair followed by a shot without an echo."""
    range_m = np.tile([first, second, np.inf], count).astype(float)
    reflectance = np.tile([*reflectances, 0.0], count)
    return Echoes(range_m, reflectance, np.tile(np.array([1, 2, 0], np.uint16), count))


def test_mixed_pixels_are_between_the_surfaces_and_clutter():
    echoes = edge(5.0, 9.0)
    add_mixed_pixels(echoes, 12000, NoiseParams(mixed_pixel_share=1.0), np.random.default_rng(1))
    mixed = np.flatnonzero(echoes.label[np.arange(12000) % 3 < 2] == 0)
    found = echoes.range_m[(echoes.label == 0) & np.isfinite(echoes.range_m)]
    assert 2000 < len(mixed) == len(found) <= 4000  # one per edge, if it is far enough from both surfaces
    assert 5.1 < found.min() < found.max() < 8.9
    # The near surface returns (9/5)² times the power of the far one, so mixed pixels gather near it.
    assert np.median(found) < 6.5


def test_mixed_pixels_have_the_power_of_both_parts():
    echoes = edge(5.0, 9.0, (0.2, 0.8))
    add_mixed_pixels(echoes, 12000, NoiseParams(mixed_pixel_share=1.0), np.random.default_rng(1))
    mixed = (echoes.label == 0) & np.isfinite(echoes.range_m)
    power = echoes.reflectance[mixed] / echoes.range_m[mixed] ** 2
    near, far = 0.2 / 25, 0.8 / 81
    assert near <= power.min() <= power.max() <= far
    share = (power - far) / (near - far)
    np.testing.assert_allclose(echoes.range_m[mixed], (share * near * 5 + (1 - share) * far * 9) / power)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_the_share_of_mixed_pixels_is_the_parameter(share):
    echoes = edge(5.0, 20.0, (0.1, 0.9))
    add_mixed_pixels(echoes, 12000, NoiseParams(mixed_pixel_share=share), np.random.default_rng(1))
    mixed = ((echoes.label == 0) & np.isfinite(echoes.range_m)).sum()
    assert mixed == 0 if share == 0 else 0.9 * share < mixed / 4000 < 1.05 * share


def test_a_slope_or_sky_behind_is_not_an_edge():
    slope = Echoes(np.arange(5, 25, 0.1), np.full(200, 0.5), np.ones(200, np.uint16))
    sky = Echoes(np.tile([5.0, np.inf], 100), np.tile([0.5, 0.0], 100), np.ones(200, np.uint16))
    for echoes in (slope, sky):
        before = echoes.range_m.copy()
        add_mixed_pixels(echoes, 200, NoiseParams(mixed_pixel_share=1.0), np.random.default_rng(1))
        np.testing.assert_array_equal(echoes.range_m, before)


def test_false_returns_have_the_share_and_reach_of_the_parameters():
    silent = np.arange(7, 50_007)
    noise = NoiseParams(false_return_share=0.2, false_return_reach_m=0.6)
    shots, detected = Echoes.empty(50_007), np.arange(7)
    lost, range_m, intensity = false_returns(shots, detected, 0.4, noise, np.random.default_rng(1))
    assert len(lost) / len(silent) == pytest.approx(0.2, rel=0.05)
    assert set(lost.tolist()) <= set(silent.tolist())
    assert range_m.min() >= 0.4
    assert range_m.mean() == pytest.approx(1.0, rel=0.05)
    assert set(intensity.tolist()) == {1, 2, 3}
    assert len(false_returns(shots, detected, 0.4, NoiseParams(), np.random.default_rng(1))[0]) == 0


def test_a_frame_has_mixed_pixels_only_at_the_edges_of_a_post():
    clean, noisy = points({}, POST, WALL), points({"mixed_pixel_share": 1.0}, POST, WALL)
    assert not (clean["label"] == 0).any()
    escaped = noisy[noisy["label"] == 0]
    assert len(escaped) >= 20
    near, far = ranges(clean[clean["label"] == 1]), ranges(clean[clean["label"] == 2])
    assert near.min() < ranges(escaped).min() < ranges(escaped).max() < far.max()
    half = np.degrees(np.arctan2(0.3, 4.0))
    bearing = np.degrees(np.abs(np.arctan2(escaped["y"], escaped["x"])))
    np.testing.assert_allclose(bearing, half, atol=0.4)


def test_a_frame_has_false_returns_in_empty_directions():
    clean, noisy = points({}, POST), points({"false_return_share": 0.5}, POST)
    post = (noisy["label"] == 1).sum()
    assert post == pytest.approx((clean["label"] == 1).sum(), abs=3)
    lost = noisy[noisy["label"] == 0]
    assert len(lost) == pytest.approx(0.5 * (6400 - len(clean)), rel=0.06)
    assert np.median(ranges(lost)) < 1.2
    assert (np.diff(noisy["timestamp"]) == 0).all()


def test_the_noise_of_the_scene_overrides_that_of_the_lidar():
    scene = load_scene("poplar")
    assert scene.noise is not None
    silent = parse_scene(scene.as_dict() | {"noise": {}}, "test")
    assert not (Renderer(silent).frame(0).points["label"] == 0).any()
    raw = scene.as_dict()
    del raw["noise"]
    own = parse_scene(raw, "test")
    assert own.noise is None
    assert (Renderer(own).frame(0).points["label"] == 0).any()
    assert "noise" not in own.as_dict()
