import numpy as np
import pytest
from scipy.special import gamma, kv

from seaclutter_cli.simulation.marine.physics import (
    PhysicsParams,
    absorption,
    facet_reflectance,
    fresnel,
    mirror_share,
    water_reflectance,
    whitecap_share,
)
from seaclutter_cli.simulation.marine.recording import Renderer
from seaclutter_cli.simulation.marine.scene import parse_scene

CALM = {"sea_state": 0, "visibility_km": 1000}
STILL = {"wind_ms": 0, "wake_m": 0}
WALL = {"track_id": 1, "shape": "quay_wall", "size_m": [2, 60, 3], "path": [[26, 0]], "wave_response": 0}


def scene(*objects, sea=CALM, physics=STILL, vessel=None, **recording):
    recording = {"dropout": 0, "lidar": "OS1-64"} | recording
    vessel = {"lidar_height_m": 2.0, "wave_response": 0} | (vessel or {})
    raw = {"recording": recording, "sea": sea, "physics": STILL | physics, "vessel": vessel, "objects": list(objects)}
    return parse_scene(raw, "test")


def frame(*objects, index=0, **values):
    return Renderer(scene(*objects, **values)).frame(index).points


def clutter(points):
    return points[points["label"] == 0]


def range_of(points):
    return np.sqrt(sum(points[axis].astype(float) ** 2 for axis in "xyz"))


class TestOptics:
    def test_water_reflects_two_percent_at_normal_and_all_at_grazing_incidence(self):
        np.testing.assert_allclose(fresnel(np.array([1.0, 0.0]), 1.328), [0.0199, 1.0], atol=1e-4)

    def test_along_polarised_light_vanishes_at_brewsters_angle(self):
        cosine = np.cos(np.arctan(1.33))
        across = (cosine**2 - np.sin(np.arctan(1.33)) ** 2) ** 2  # of Fresnel's sin²(a - b), a + b = 90°
        np.testing.assert_allclose(fresnel(np.array([cosine]), 1.33), across / 2, rtol=1e-6)

    def test_water_ends_at_17_m_for_a_lidar_1_2_m_up_and_below_40_m_for_one_5_m_up(self):
        ranges = np.linspace(3, 60, 6000)
        low, high = (water_reflectance(height / ranges, 905, 0.05) / ranges**2 for height in (1.2, 5.0))
        least = np.interp(17, ranges, low)
        assert 36 < ranges[high > least].max() < 40  # 17 m times (5 / 1.2) ** (3 / 5) at grazing incidence

    def test_water_is_black_at_1550_nm(self):
        assert absorption(1550) > 100 * absorption(905)
        assert water_reflectance(np.ones(1), 1550, 0.1) < 0.01 * water_reflectance(np.ones(1), 905, 0.1)

    def test_slopes_and_whitecaps_follow_the_published_formulas(self):
        assert PhysicsParams(wind_ms=10).ripple_variance == pytest.approx(0.0542)
        assert whitecap_share(10) == pytest.approx(0.00987, abs=1e-5)

    def test_facets_integrate_to_the_reflection_of_the_normal(self):
        # Power over all slopes: the integral of the density of slopes is 1.
        variance, tangent = 0.02, np.linspace(0, 2, 20001)
        cosine = 1 / np.sqrt(1 + tangent**2)
        density = facet_reflectance(cosine, 905, variance) * 4 * cosine**5 / np.pi
        assert np.trapezoid(density * 2 * np.pi * tangent, tangent) == pytest.approx(0.0199, abs=1e-4)

    def test_ripples_dim_a_mirror(self):
        shares = [mirror_share(np.array([0.2]), variance)[0] for variance in (0.0, 1e-5, 1e-3)]
        assert shares[0] == pytest.approx(1)
        assert (np.diff(shares) < 0).all()


def test_the_share_of_echoes_is_that_of_the_k_distribution():
    physics = {"backscatter": 0.3, "least_reflectivity": 1e-6, "patch_m": 0.01, "shelter": 0.01}
    values = {"sea": CALM | {"spikiness": 0.5}, "physics": physics, "lidar": "PandarXT-32"}
    renderer = Renderer(scene(**values))
    found, mean = [], []
    for index in range(6):
        points = clutter(renderer.frame(index).points)
        found.append(np.count_nonzero((points["ring"] == 6) & (np.abs(points["y"]) > 2)))
    elevation = np.radians(-10)
    distance = 2.0 / np.sin(-elevation)
    mean = renderer.lidar.gain * water_reflectance(np.array([np.sin(-elevation)]), 905, 0.3)[0] / distance**2
    thresholds = 1 + 0.25 * np.random.default_rng(1).standard_normal(4000)
    argument = 0.5 * np.maximum(thresholds, 1e-6) / mean
    expected = np.mean(2 / gamma(0.5) * argument**0.25 * kv(0.5, 2 * np.sqrt(argument)))
    sides = 1 - 2 * np.degrees(np.arcsin(2 / (distance * np.cos(elevation)))) / 180
    assert np.mean(found) / renderer.lidar.columns / sides == pytest.approx(expected, rel=0.08)


class TestMirrors:
    def test_a_wall_is_mirrored_below_the_water_and_below_itself(self):
        points = frame(WALL, physics={"shelter": 0.001, "backscatter": 1e-6, "least_reflectivity": 1e-5})
        mirrored = clutter(points)
        assert len(mirrored) > 500
        depth = mirrored["z"] + 2.0
        assert depth.max() < 0.05
        assert np.median(depth) > -3.2
        np.testing.assert_allclose(np.median(mirrored["x"]) + 2.5, 25, atol=0.5)

    def test_rough_water_does_not_mirror(self):
        rough = {"wind_ms": 8, "backscatter": 1e-6}
        points = frame(WALL, physics=rough, sea={"sea_state": 2, "visibility_km": 1000})
        assert np.count_nonzero(clutter(points)["z"] < -2.8) < 20


def test_whitecaps_cover_the_published_share():
    water = Renderer(scene(physics={"wind_ms": 15, "shelter": 1.0}))._terrain
    x, y = np.random.default_rng(2).uniform(-500, 500, (2, 200_000))
    cover = np.mean([water.at(time_s).whitecaps(x, y).mean() for time_s in (0.0, 7.0, 19.0)])
    assert cover == pytest.approx(whitecap_share(15), rel=0.05)


def test_a_bird_leaves_no_wake():
    bird = {"track_id": 1, "shape": "bird", "size_m": [0.5, 1, 4], "path": [[10, 0], [900, 0]], "speed_ms": 9}
    physics = {"wake_m": 100, "wake_cover": 1.0, "wake_reflectivity": 0.5, "backscatter": 1e-6}
    assert len(clutter(frame(bird | {"ignore": True}, physics=physics, index=20))) < 10


def test_a_turbulent_wake_has_echoes_at_heights_with_an_exponential_distribution():
    boat = {"track_id": 1, "shape": "cruise_ship", "size_m": [20, 5, 5], "path": [[-30, 25], [900, 25]], "speed_ms": 6}
    physics = {"wake_m": 100, "wake_cover": 0.5, "wake_reflectivity": 0.5, "backscatter": 1e-6}
    sea = CALM | {"foam_reflectivity": 0}
    points = np.concatenate(
        [clutter(frame(boat, sea=sea, physics=physics, index=60 + k, lidar="OS1-128")) for k in (0, 9)]
    )
    heights = points["z"].astype(float) + 2.0
    heights = heights[heights > 0.05] - 0.05  # memoryless
    assert len(heights) > 200
    assert heights.mean() == pytest.approx(0.12, rel=0.2)
    assert np.mean(heights > 0.12) == pytest.approx(np.exp(-1), abs=0.08)


class TestWeather:
    @pytest.mark.parametrize(
        ("sea", "physics"), [({}, {"rain_mm_h": 30}), ({"visibility_km": 0.08}, {})], ids=["rain", "fog"]
    )
    def test_echoes_of_the_air_are_near_and_all_around(self, sea, physics):
        dark = {"backscatter": 1e-6}
        points = clutter(frame(sea=CALM | sea, physics=physics | dark))
        assert len(points) > 100
        assert np.quantile(range_of(points), 0.95) < 25
        assert (points["z"] > 0).mean() > 0.2

    def test_fog_hides_what_is_far(self):
        near, far = ({**WALL, "path": [[x, 0]]} for x in (12, 90))
        seen = [(frame(wall, sea=CALM | {"visibility_km": 0.06})["label"] == 1).any() for wall in (near, far)]
        assert seen == [True, False]


def test_a_retro_reflector_blooms():
    pile = {"track_id": 1, "shape": "pile", "size_m": [0.5, 0.5, 3], "path": [[20, 0]], "wave_response": 0}
    quiet, bright = ({"backscatter": 1e-6, "retro_tracks": tracks} for tracks in ([], [1]))
    dark, halo = (clutter(frame(pile, physics=physics)) for physics in (quiet, bright))
    assert len(dark) < 5
    assert len(halo) > 10
    assert np.count_nonzero(np.abs(range_of(halo) - np.median(range_of(halo))) < 0.3) > 10


def test_own_ship_rolls_and_turns():
    wall = WALL | {"path": [[40, 0]]}
    angles = 2 * np.pi / 36 * np.arange(40)
    circle = np.stack((2 * np.sin(angles), 2 - 2 * np.cos(angles)), axis=1).round(3).tolist()
    vessel = {"path": circle, "speed_ms": round(2 * 2 * np.pi / 36 * 2, 3), "lidar_forward_m": 0.0}
    renderer = Renderer(scene(wall, vessel=vessel, physics={"roll_deg": 8, "roll_s": 4}))
    yaws, rolls = [], []
    for time_s in np.arange(1, 7, 0.25):
        rotation = renderer._ride.lidar(time_s).rotation
        yaws.append(np.arctan2(rotation[1, 0], rotation[0, 0]))
        rolls.append(np.degrees(np.arcsin(rotation[2, 1])))
    np.testing.assert_allclose(np.degrees(np.diff(np.unwrap(yaws))) / 0.25, 20, rtol=0.05)
    assert max(rolls) == pytest.approx(8, abs=0.3)
    assert min(rolls) == pytest.approx(-8, abs=0.3)


def test_frames_with_physics_can_be_rendered_in_any_order():
    values = {"physics": {"spray": 5, "wind_ms": 12, "rain_mm_h": 10, "wake_m": 60}, "vessel": {"speed_ms": 0}}
    one, other = Renderer(scene(WALL, **values)), Renderer(scene(WALL, **values))
    later = other.frame(7)
    other.frame(2)
    assert np.array_equal(one.frame(7).points, later.points)
