from functools import cache

import numpy as np
import pytest

from seaclutter_cli.simulation.layouts import LAYOUTS
from seaclutter_cli.simulation.lidar import LIDARS
from seaclutter_cli.simulation.marine.recording import Renderer
from seaclutter_cli.simulation.marine.scene import builtin_scenes, load_scene, parse_scene
from seaclutter_cli.simulation.marine.sea import SeaParams
from seaclutter_cli.truth import IGNORED
from tests.pairs import covering

FLAT = {"sea_state": 0, "reflectivity": 0, "visibility_km": 1000}
WALL = {
    "track_id": 1,
    "shape": "quay_wall",
    "size_m": [2, 60, 8],
    "path": [[31, 0]],
    "reflectivity": 0.4,
    "wave_response": 0,
}


def scene(*objects, sea=FLAT, vessel=None, **recording):
    raw = {"recording": {"dropout": 0} | recording, "sea": dict(sea), "vessel": vessel or {}, "objects": list(objects)}
    return parse_scene(raw, "test")


def ranges(points):
    return np.sqrt(sum(points[axis].astype(float) ** 2 for axis in "xyz"))


def assert_labels_fit_boxes(frame, within=1.0):
    """Check that points are in the box of their label, with tolerances.

    The lower face of a box is at the height of the sea at its centre, but waves of a metre expose some of a long hull
    below it. Objects ahead are seen at the start and at the end of a revolution, by beams with different azimuths.
    """
    points = frame.points
    xyz = np.array([points[axis] for axis in "xyz"], float)
    tight, wide = (frame.boxes.members(xyz, margin_m) for margin_m in (0.25, 0.5))
    ignored = np.zeros(len(points), bool)
    for track, kind, inside, near in zip(frame.boxes.tracks, frame.boxes.classes, tight, wide, strict=True):
        own = points["label"] == int(track)
        if kind == "ignore":
            ignored[near] = True
        elif own.any():
            assert own[inside].sum() > 0.85 * within * own.sum()
            assert own[near].sum() >= within * own.sum()
    assert not (points["label"] == IGNORED).any() or ignored[points["label"] == IGNORED].mean() >= within
    assert {str(label) for label in np.unique(points["label"])} <= {*frame.boxes.tracks, "0"}


@cache
def rendered(name, index):
    return Renderer(load_scene(name)).frame(index)


EXAMPLES = covering(builtin_scenes(), (0, 60))


@pytest.mark.parametrize(("name", "index"), EXAMPLES)
def test_points_of_a_target_are_in_its_box(name, index):
    assert_labels_fit_boxes(rendered(name, index))


@pytest.mark.parametrize("name", LAYOUTS)
def test_points_of_a_target_are_in_its_box_in_random_scenes(name):
    scene = LAYOUTS[name].make(np.random.default_rng(1))
    rough = isinstance(scene.terrain, SeaParams) and scene.terrain.sea_state > 3
    assert_labels_fit_boxes(Renderer(scene).frame(3), within=0.8 if rough else 1.0)


@pytest.mark.parametrize(("name", "index"), EXAMPLES)
def test_points_have_the_ranges_and_units_of_the_sensor(name, index):
    points = rendered(name, index).points
    lidar = LIDARS[load_scene(name).recording.lidar]
    assert 1000 < len(points) < lidar.columns * len(lidar.elevations_deg)
    assert np.array_equal(points["intensity"], np.floor(points["intensity"]))
    assert points["intensity"].min() >= 1
    assert points["intensity"].max() <= 255
    assert ranges(points).max() < lidar.max_range_m + 0.2
    assert points["ring"].max() < len(lidar.elevations_deg)
    assert (np.diff(points["timestamp"]) > -50e-6).all()
    first, last = points["timestamp"].min() * lidar.rate_hz, points["timestamp"].max() * lidar.rate_hz
    assert index <= first <= last < index + 1


@pytest.mark.parametrize("lidar", [name for name, lidar in LIDARS.items() if lidar.rotates])
def test_every_rotating_lidar_sees_the_sea_and_a_target(lidar):
    points = Renderer(load_scene("calm").with_recording(lidar=lidar)).frame(0).points
    assert {0, 1, 2, IGNORED} <= set(points["label"].tolist())


def test_frames_can_be_rendered_in_any_order():
    chosen = load_scene("departure")
    one, other = Renderer(chosen), Renderer(chosen)
    later = other.frame(7)
    other.frame(2)
    one.frame(0)
    assert np.array_equal(one.frame(7).points, later.points)
    assert not np.array_equal(one.frame(7).points, Renderer(chosen.with_recording(seed=2)).frame(7).points)


def test_intensity_is_that_of_the_lidar_equation():
    points = Renderer(scene(WALL)).frame(0).points
    wall = points[points["label"] == 1]
    ahead = wall[(np.abs(wall["y"]) < 3) & (np.abs(wall["z"]) < 1)]
    assert len(ahead) > 100
    r = ranges(ahead)
    np.testing.assert_allclose(ahead["x"], 30 - 2.5, atol=0.2)
    expected = LIDARS["RS-LiDAR-32"].gain * 0.4 * (ahead["x"] / r) / r**2
    np.testing.assert_allclose(ahead["intensity"] + 0.5, expected, rtol=0.15)


def test_air_attenuates_echoes():
    clear = Renderer(scene(WALL)).frame(0).points
    hazy = Renderer(scene(WALL, sea=FLAT | {"visibility_km": 1.0})).frame(0).points
    ratio = np.median(hazy["intensity"][hazy["label"] == 1]) / np.median(clear["intensity"][clear["label"] == 1])
    assert ratio == pytest.approx(np.exp(-2 * 3.912e-3 * 28), rel=0.1)


def test_a_wall_hides_what_is_behind_it():
    boat = {"track_id": 2, "shape": "speedboat", "size_m": [8, 3, 2], "path": [[45, 0]], "reflectivity": 0.9}
    alone = Renderer(scene(boat)).frame(0).points
    hidden = Renderer(scene(boat, WALL)).frame(0).points
    assert (alone["label"] == 2).sum() > 50
    assert (hidden["label"] == 2).sum() == 0


def test_waves_hide_low_objects():
    kayak = {
        "track_id": 2,
        "shape": "kayak",
        "size_m": [5, 0.8, 0.5],
        "path": [[45, 0]],
        "reflectivity": 0.9,
        "wave_response": 0,
    }
    rough = FLAT | {"sea_state": 4}
    calm = sum((Renderer(scene(kayak)).frame(k).points["label"] == 2).sum() for k in (0, 9, 18))
    waves = sum((Renderer(scene(kayak, sea=rough)).frame(k).points["label"] == 2).sum() for k in (0, 9, 18))
    assert waves < calm


def test_a_flat_black_sea_gives_no_clutter():
    assert not (Renderer(scene(WALL)).frame(0).points["label"] == 0).any()


def test_clutter_is_on_the_water():
    points = Renderer(scene(sea={"sea_state": 0}, vessel={"wave_response": 0.0})).frame(0).points
    clutter = points[points["label"] == 0]
    assert len(clutter) > 500
    np.testing.assert_allclose(clutter["z"], -2.5, atol=0.12)


def test_clutter_gets_sparser_and_weaker_with_range():
    renderer = Renderer(load_scene("clutter_only"))
    points = np.concatenate([renderer.frame(k).points for k in range(4)])
    clutter = points[points["label"] == 0]
    r = ranges(clutter)
    intensities = [clutter["intensity"][(r >= low) & (r < low + 15)] for low in (10, 25, 40)]
    counts = [len(values) / (2 * low + 15) for values, low in zip(intensities, (10, 25, 40), strict=True)]
    assert counts == sorted(counts, reverse=True)
    brightest = [np.quantile(values, 0.98) for values in intensities]
    assert brightest == sorted(brightest, reverse=True)


def test_own_ship_rolls_with_the_sea():
    vessel = {"wave_response": 1.0, "length_m": 2.0}
    still = Renderer(scene(WALL, vessel=vessel)).frame(0)
    rolling = [Renderer(scene(WALL, sea=FLAT | {"sea_state": 3}, vessel=vessel)).frame(k) for k in (0, 7, 14)]
    heights = [frame.boxes.centers[1, 2] for frame in rolling]
    assert np.ptp(heights) > 0.2
    assert still.boxes.centers[1, 2] == pytest.approx(8 / 2 - 2.5)


def test_a_moving_target_moves():
    boat = {"track_id": 2, "shape": "speedboat", "size_m": [8, 3, 2], "path": [[20, -30], [20, 30]], "speed_ms": 10}
    renderer = Renderer(scene(boat))
    positions = np.array([renderer.frame(k).boxes.centers[1] for k in (0, 10, 20)])
    np.testing.assert_allclose(np.diff(positions[:, 1]), 10, atol=0.5)
    assert renderer.frame(10).boxes.yaws[1] == pytest.approx(np.pi / 2, abs=0.01)


def test_a_speedboat_leaves_clutter_behind():
    boat = {"track_id": 2, "shape": "speedboat", "size_m": [8, 3, 2], "path": [[20, -60], [20, 60]], "speed_ms": 10}
    renderer = Renderer(scene(boat, sea=FLAT | {"foam_reflectivity": 0.3}))
    before, after = renderer.frame(10).points, renderer.frame(75).points
    wake = [(p["label"] == 0) & (np.abs(p["y"]) < 8) & (np.abs(p["x"] - 17.5) < 4) for p in (before, after)]
    assert wake[0].sum() == 0
    assert wake[1].sum() > 20
