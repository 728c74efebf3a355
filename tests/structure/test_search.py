"""The search for own structure on simulated vessels: under way, without structure, and moored."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seaclutter_cli.cloud import from_array
from seaclutter_cli.frame import Frame
from seaclutter_cli.simulation.marine.recording import Renderer
from seaclutter_cli.simulation.marine.scene import load_scene
from seaclutter_cli.structure.search import MIN_FRAMES, StructureSearch, _connected
from seaclutter_cli.truth import IGNORED

FRAMES, EVERY = 20, 5
LONG = {"length_m": 26.0, "width_m": 6.0, "lidar_forward_m": -8.0, "lidar_height_m": 5.0}
"""A foredeck that reaches 18 m ahead of the lidar."""
HIDDEN = {"length_m": 0.2, "width_m": 0.2, "lidar_forward_m": 0.0}
"""A hull that the lidar does not see."""


@cache
def simulated(scene, changes):
    whole = load_scene(scene)
    recording = replace(whole.recording, lidar="VLP-16")
    renderer = Renderer(replace(whole, recording=recording, vessel=replace(whole.vessel, **dict(changes))))
    return [renderer.frame(number * EVERY).points for number in range(FRAMES)]


def frames(scene, *, ring=True, **changes):
    for number, points in enumerate(simulated(scene, tuple(changes.items()))):
        kept = [name for name in points.dtype.names if ring or name != "ring"]
        chosen = np.empty(len(points), [(name, points.dtype[name]) for name in kept])
        for name in kept:
            chosen[name] = points[name]
        stamp_ns = 10**9 + number * EVERY * 10**8
        yield Frame(from_array(chosen, stamp_ns=stamp_ns), stamp_ns=stamp_ns, index=number), points["label"]


def found(scene, *, ring=True, reach_m=20.0, **changes):
    search = StructureSearch(reach_m)
    for frame, _ in frames(scene, ring=ring, **changes):
        search.add(frame)
    return search.found()


@pytest.mark.parametrize(("scene", "ring"), [("rough", True), ("narrow_channel", False)])
def test_a_foredeck_is_masked_and_nothing_else(scene, ring):
    mask = found(scene, ring=ring, **LONG).mask
    assert mask.sectors
    for frame, label in frames(scene, ring=ring, **LONG):
        inside = mask.contains(frame.coordinates, frame.range_m)
        x, y, _ = frame.coordinates
        own = (label == IGNORED) & (x > -6) & (x < 20) & (abs(y) < 3.2)  # walls are ignored, too
        assert inside[own].mean() > 0.9  # not the edges that come and go
        assert not inside[~own].any()


@pytest.mark.parametrize(("scene", "ring"), [("departure", False), ("narrow_channel", True)])
def test_without_own_structure_nothing_is_proposed(scene, ring):
    result = found(scene, ring=ring, **HIDDEN)
    assert (result.mask.sectors, result.share, result.frames) == ((), 0.0, FRAMES)
    assert not result.is_at_rest


def test_calm_water_is_no_structure():
    assert found("calm", speed_ms=2.0, path=((0.0, 0.0), (90.0, 0.0)), **HIDDEN).mask.sectors == ()


@pytest.mark.parametrize("scene", ["harbour", "lock"])
def test_a_moored_vessel_masks_no_quay(scene):
    result = found(scene, reach_m=30.0, speed_ms=0.0, **LONG)
    assert result.is_at_rest
    assert result.mask.sectors == ()


def test_an_empty_sea_does_not_tell_whether_the_vessel_moved():
    result = found("clutter_only")
    assert result.at_rest is None
    assert result.mask.sectors


def test_too_few_frames_show_nothing():
    search = StructureSearch(20.0)
    for frame, _ in list(frames("rough", **LONG))[: MIN_FRAMES - 1]:
        search.add(frame)
    result = search.found()
    assert (result.mask.sectors, result.frames, result.at_rest) == ((), MIN_FRAMES - 1, None)
    empty = StructureSearch(20.0)
    empty.add(Frame.of_arrays(np.zeros((0, 3))))
    assert empty.found().frames == 0


def rod(azimuth_deg, *, every=1, noise_m=0.02, sea=200):
    """Yield frames with an upright rod 12 m away at an azimuth, in each ``every``-th frame, over a moving scene."""
    rng = np.random.default_rng(1)
    up = np.radians(np.arange(-4, 4.1, 0.5))
    for number in range(40):
        azimuth = np.radians(azimuth_deg + rng.uniform(-0.4, 0.4, (2, len(up))))
        range_m = 12 + rng.normal(0, noise_m, azimuth.shape)
        xyz = [range_m * np.cos(up) * np.cos(azimuth), range_m * np.cos(up) * np.sin(azimuth), range_m * np.sin(up)]
        rods = np.stack([axis.ravel() for axis in xyz], axis=1)
        if number % every:
            rods = rods[:0]
        others = rng.uniform((-80, -80, 2), (80, 80, 9), (sea, 3))
        yield Frame.of_arrays(np.concatenate((rods, others)), stamp_ns=number * 10**8 + 1, index=number)


def searched(shown):
    search = StructureSearch(20.0)
    for frame in shown:
        search.add(frame)
    return search.found().mask


@pytest.mark.parametrize("azimuth_deg", [0.5, -179.5, 180.0, 90.0])
def test_a_rod_is_found_at_every_azimuth(azimuth_deg):
    mask = searched(rod(azimuth_deg))
    assert mask.sectors
    assert {round(one.range_min_m) for one in mask.sectors} == {12}
    assert all(abs((one.azimuth_min_deg + 0.5 - azimuth_deg + 180) % 360 - 180) < 2.5 for one in mask.sectors)


def test_what_is_there_in_half_of_the_frames_or_moves_is_no_structure():
    assert searched(rod(30.5, every=2)).sectors == ()
    assert searched(rod(30.5, noise_m=1.0)).sectors == ()


def test_a_part_that_touches_several_across_180_degrees_is_kept_with_any_of_them():
    weak, strong = np.zeros((2, 3, 360, 12), np.bool_)
    weak[1, 0, [4, 8]] = weak[1, 1, 4:9] = True  # one part, which touches the next two
    weak[1, -2:, 4] = strong[1, -2:, 4] = weak[1, -1, 8] = True
    parts = _connected(strong, weak)
    assert (parts[1, 1, 4:9] > 0).all()
    assert not _connected(np.zeros_like(strong), weak).any()
