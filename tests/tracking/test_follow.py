"""Tracks of boxes that move as is known: ids, sizes, positions, velocities."""

import numpy as np
import pytest

from seaclutter_cli.frame import FilterResult, Frame, Reason, WaterState
from seaclutter_cli.tracking.detections import Detections, Pose
from seaclutter_cli.tracking.follow import CANDIDATE, CONFIRMED, LOST, Follower
from seaclutter_cli.water import Mounting

LENGTH_M, WIDTH_M = 8.0, 3.0
SPEED_MS = 2.0
FINE_M = 0.02


def hull(center, yaw, sensor=(0.0, 0.0)):
    """Return points on the two faces of a box that a sensor sees, every 0.2 m, at two heights."""
    along, across = (np.arange(-size / 2 + 0.1, size / 2, 0.2) for size in (LENGTH_M, WIDTH_M))
    cos, sin = np.cos(yaw), np.sin(yaw)
    axes = np.array([[cos, sin], [-sin, cos]])
    seen_from = axes @ (np.asarray(sensor) - center)
    near = np.sign(seen_from) * (LENGTH_M / 2, WIDTH_M / 2)
    side, end = (
        np.column_stack((along, np.full(len(along), near[1]))),
        np.column_stack((np.full(len(across), near[0]), across)),
    )
    xy = np.vstack((side, end)) @ axes + center
    return np.vstack([np.column_stack((xy, np.full(len(xy), z))) for z in (-1.0, 0.5)])


def place(k):
    return np.array([-25.0, 20.0]) + 0.1 * k * SPEED_MS * np.array([np.cos(0.3), np.sin(0.3)])


def frame_of(k, points, reason=None):
    frame = Frame.of_arrays(points, np.full(len(points), 50.0), stamp_ns=10**9 + k * 10**8, index=k)
    return FilterResult(frame, np.zeros(len(points), np.uint8) if reason is None else reason)


def followed(results, poses=None, **options):
    follower = Follower(1.5, 5, **options)
    found = [one for k, result in enumerate(results) for one in follower.add(result, poses and poses[k])]
    return found + list(follower.finish())


def test_box_and_velocity_are_measured():
    found = followed([frame_of(k, hull(place(k), 0.3)) for k in range(40)])
    assert [one.index for one in found] == list(range(40))
    for k, one in enumerate(found):
        assert (one.tracks, one.states) == ([1], [CONFIRMED])
        assert np.allclose(one.centers[0, :2], place(k), atol=0.1)
        assert np.allclose(one.sizes[0], (LENGTH_M, WIDTH_M, 1.5), atol=0.15)
        assert np.allclose(one.velocities[0], SPEED_MS * np.array([np.cos(0.3), np.sin(0.3)]), atol=0.1)
        assert abs((one.yaws[0] - 0.3 + np.pi / 2) % np.pi - np.pi / 2) < 0.03
        assert one.measured[0]
        assert not one.over_ground


def line(start, end, step=0.2):
    """Return points from one place to another, at two heights."""
    count = int(np.hypot(*np.subtract(end, start)) / step) + 1
    xy = np.linspace(start, end, count)
    return np.vstack([np.column_stack((xy, np.full(count, z))) for z in (-1.0, 0.5)])


def test_boats_beside_each_other_and_a_quay_are_apart():
    boats = [hull(np.array([x, 20.0]), np.pi / 2) for x in (-7.0, -3.5, 0.0)]
    scene = np.vstack([*boats, line((-40, 25.5), (40, 25.5)), line((0.5, 24.8), (1.5, 24.8))])
    (one,) = followed([frame_of(k, scene) for k in range(20)])[10:11]
    assert np.allclose(sorted(one.sizes[:, 0]), [8, 8, 8, 80], atol=0.6)
    for x in (-7.0, -3.5, 0.0):
        assert np.hypot(*(one.centers[:, :2] - (x, 20.0)).T).min() < 0.3


def test_narrow_boats_beside_each_other_are_not_one():
    sides = [line((x, 20), (x, 25)) for x in (-1.7, 0, 0.5, 2.2)]
    ends = [line((x, 20), (x + 1.7, 20)) for x in (-1.7, 0.5)]
    (one,) = followed([frame_of(k, np.vstack(sides + ends)) for k in range(20)])[10:11]
    assert np.allclose(one.sizes[:, 0], 5, atol=0.3)
    assert len(one.tracks) == 2


def test_the_far_end_of_a_boat_is_hidden_in_a_view_along_it():
    stern = np.vstack([line((x, 40), (x + dx, 40 + dy), FINE_M) for x, dx, dy in ((-1, 2, 0), (-1, 0, 3), (1, 0, 3))])
    for shift, length_m in ((0, 5.7), (30, 3)):
        found = followed([frame_of(k, np.add(stern, (shift, 0, 0))) for k in range(20)])
        assert found[10].sizes[0, 0] == pytest.approx(length_m, abs=0.2)
        assert found[10].centers[0, 1] == pytest.approx(40 + length_m / 2, abs=0.1)


@pytest.mark.parametrize("step_deg", [0.1, 0.4])
@pytest.mark.parametrize("distance_m", [15, 60])
def test_the_width_of_a_face_does_not_depend_on_the_step_between_directions(distance_m, step_deg):
    widths_m = []
    for phase in np.linspace(0, 1, 20, endpoint=False):
        y = distance_m * np.tan(np.radians(step_deg) * (np.arange(-300, 300) + phase))
        face = np.vstack([np.column_stack((np.full(600, distance_m), y, np.full(600, z))) for z in (-1, 0.5)])
        shown = frame_of(0, face[np.abs(face[:, 1]) < WIDTH_M / 2])
        found = Detections.of(shown, 1.0, 3)
        widths_m.append(np.ptp(found.outlines[0, :, 1]))
        assert np.ptp(found.hulls[0, :, 1]) < WIDTH_M
    assert np.mean(widths_m) == pytest.approx(WIDTH_M, abs=0.02)


@pytest.mark.parametrize(("front", "length_m"), [((11, 9), 8), ((19, 9), 4)])
def test_the_far_end_of_a_boat_may_be_behind_something_nearer(front, length_m):
    boat = np.vstack([line((10, 12), (14, 12), FINE_M), line((10, 12), (10, 14.8), FINE_M)])
    found = followed([frame_of(k, np.vstack((boat, line(front, (25, 9))))) for k in range(20)])
    at = found[10].centers[:, 1].argmax()
    assert found[10].sizes[at, 0] == pytest.approx(length_m, abs=0.2)
    assert found[10].centers[at, 0] == pytest.approx(10 + length_m / 2, abs=0.1)


def test_a_boat_seen_in_pieces_beside_others_is_one():
    pieces = [line((20, y), (20, y + 1.5), FINE_M) for y in (0, 2.3, 4.6, 6.9)]
    beside = [line((x, 0), (x, 9), FINE_M) for x in (21.4, 22.8, 24.2)]
    (one,) = followed([frame_of(k, np.vstack(pieces + beside)) for k in range(20)])[10:11]
    assert sorted(one.sizes[:, 0].round(1)) == [8.4, 9, 9, 9]


@pytest.mark.parametrize(("distance_m", "objects"), [(20, 4), (90, 1)])
def test_far_objects_have_wider_gaps(distance_m, objects):
    faces = np.vstack([line((x, distance_m), (x + 9, distance_m)) for x in (-20, -10, 0, 10)])
    assert len(followed([frame_of(k, faces) for k in range(20)])[10].tracks) == objects


def test_the_beam_of_a_ship_of_which_one_side_is_seen_is_not_a_third_of_its_length():
    found = followed([frame_of(k, line((-20, 20), (20, 20))) for k in range(20)])
    assert not found[10].measured[0]
    assert 6 < found[10].sizes[0, 1] < 9


def test_a_wall_is_straight_at_any_angle_and_step():
    wall = line((-5, 55), (5, 65), 0.8)
    assert followed([frame_of(k, wall) for k in range(20)])[10].kinds == ["structure"]


@pytest.mark.parametrize(("curve_m", "kind"), [(0, "structure"), (2, "vessel")])
def test_walls_are_straight_and_hulls_curve(curve_m, kind):
    face = line((-15, 20), (15, 20))
    face[:, 1] += curve_m * (face[:, 0] / 15) ** 4
    assert followed([frame_of(k, face) for k in range(20)])[10].kinds == [kind]


def test_a_few_echoes_of_wash_beside_a_boat_do_not_make_it_larger():
    boat = np.vstack([line((-3, 20), (3, 20), FINE_M), line((3, 20), (3, 22), FINE_M)])
    wash = np.vstack([line((-4.8, 20), (-3.8, 20), 0.5), line((-3, 21.3), (2, 21.3), 0.5)])
    found = followed([frame_of(k, np.vstack((boat, wash))) for k in range(20)])
    assert np.allclose(found[10].sizes[0, :2], (6, 2), atol=0.1)


@pytest.mark.parametrize("beside_m", [1.2, 1.9])
def test_an_echo_beside_a_buoy_in_some_frames_does_not_make_it_longer(beside_m):
    angles = np.linspace(np.pi / 2, 3 * np.pi / 2, 15)
    buoy = np.column_stack((20 + 0.6 * np.cos(angles), 0.6 * np.sin(angles)))
    points = np.vstack([np.column_stack((buoy, np.full(15, z))) for z in (-1.0, -0.5)])
    beside = np.vstack((points, (20.0, beside_m, -1.0)))
    found = followed([frame_of(k, beside if k % 4 == 0 else points) for k in range(40)])
    assert np.allclose([one.sizes[0, :2] for one in found], 1.2, atol=0.15)


def test_the_length_of_a_buoy_is_not_less_than_its_width():
    """The far half is hidden in most frames; in some, more is seen, so along and across are like each other."""
    results = []
    for k in range(40):
        deep = 0.6 if k % 4 else 1.3
        xy = np.array([[20 + dx, dy] for dx in np.linspace(0, deep, 5) for dy in np.linspace(-0.65, 0.65, 26)])
        results.append(frame_of(k, np.vstack([np.column_stack((xy, np.full(len(xy), z))) for z in (-1.0, -0.5)])))
    assert followed(results)[20].sizes[0, :2] == pytest.approx([1.3, 1.3], abs=0.15)


def test_ids_survive_two_seconds_without_the_object():
    hidden = range(15, 35)
    empty = np.array([[60.0, 60, 0]])
    found = followed([frame_of(k, empty if k in hidden else hull(place(k), 0.3)) for k in range(60)])
    assert {track for one in found for track in one.tracks} == {1}
    assert [one.index for one in found if one.states == [LOST]] == list(hidden)
    assert all(np.allclose(one.centers[0, :2], place(one.index), atol=0.3) for one in found)


@pytest.mark.parametrize("speed_ms", [2, 4])
@pytest.mark.parametrize("hidden_m", [8, 12.5])
def test_ids_and_boxes_survive_what_hides_an_object_bit_by_bit(speed_ms, hidden_m):
    """A wall hides a boat from its bow on, and shows it again from its bow on; at 8 m, never the whole."""
    wall, shadow = line((0, 10), (0.4 * hidden_m, 10)), (0, hidden_m)
    results, places = [], [np.array([-12 + 0.1 * k * speed_ms, 25.0]) for k in range(360 // speed_ms)]
    for k, at in enumerate(places):
        boat = hull(at, 0)
        shade_m = 25 * boat[:, 0] / boat[:, 1]
        boat = boat[(shade_m < shadow[0]) | (shade_m > shadow[1])]
        results.append(frame_of(k, np.vstack((wall, boat))))
    for one, at in zip(followed(results), places, strict=True):
        assert one.tracks == [1, 2]
        assert np.hypot(*(one.centers[:, :2] - at).T).min() < 1


def test_what_is_seen_for_a_moment_is_a_candidate():
    found = followed([frame_of(k, hull(place(0), 0.3) if k < 3 else np.array([[60.0, 60, 0]])) for k in range(9)])
    assert [one.states for one in found if one.tracks] == [[CANDIDATE]] * 3


@pytest.mark.parametrize(("seen", "states"), [(40, {CONFIRMED}), (15, {CANDIDATE})])
def test_what_was_seen_for_seconds_and_went_out_of_sight_is_no_candidate(seen, states):
    empty = np.array([[60.0, 60, 0]])
    found = followed([frame_of(k, hull(place(k), 0.3) if k < seen else empty) for k in range(150)])
    assert [one.index for one in found if one.tracks] == list(range(seen))
    assert {state for one in found for state in one.states} == states


def test_removed_points_continue_an_object_but_begin_none():
    unconfirmed = np.full(len(hull(place(0), 0.3)), Reason.UNCONFIRMED, np.uint8)

    def results(removed):
        for k in range(30):
            one = frame_of(k, hull(place(k), 0.3), unconfirmed if k in removed else None)
            yield FilterResult(one.frame, one.reason, rings=object())

    continued = followed(results(range(20, 25)))
    assert [one.index for one in continued if one.states == [CANDIDATE]] == list(range(20, 25))
    assert not any(one.tracks for one in followed(results(range(30))))


def test_velocity_is_over_ground_where_the_pose_is_known():
    poses = [Pose(0.5 * k, -0.2 * k, 0.05 * k) for k in range(40)]
    clouds = []
    for k, pose in enumerate(poses):
        points = hull(place(k), 0.3, pose[:2])
        points[:, :2] = pose.undone(points[:, :2])
        clouds.append(frame_of(k, points))
    for one, pose in zip(followed(clouds, poses), poses, strict=True):
        assert one.over_ground
        assert np.allclose(pose.applied(one.centers[:, :2]), place(one.index), atol=0.15)
        assert np.allclose(pose.turned(one.velocities), SPEED_MS * np.array([[np.cos(0.3), np.sin(0.3)]]), atol=0.1)


@pytest.mark.parametrize("live", [False, True])
def test_ids_survive_where_the_pose_comes_and_goes(live):
    poses = [Pose(100 + 0.5 * k, -0.2 * k, 1 + 0.01 * k) if k in range(20, 40) else None for k in range(60)]
    clouds = []
    for k in range(60):
        pose = Pose(100 + 0.5 * k, -0.2 * k, 1 + 0.01 * k)
        points = hull(place(k + 500), 0.3, pose[:2])
        points[:, :2] = pose.undone(points[:, :2])
        clouds.append(frame_of(k, points))
    found = followed(clouds, poses, live=live)
    assert [one.tracks for one in found] == [[1]] * 60
    assert [one.over_ground for one in found] == [pose is not None for pose in poses]
    assert all(abs(one.sizes[0, :2] - (LENGTH_M, WIDTH_M)).max() < 0.3 for one in found[30:])


def test_spray_behind_a_boat_in_some_frames_does_not_move_it():
    astern = np.array((np.cos(0.3), np.sin(0.3)))
    views = [[hull(place(k), 0.3)] + [hull(place(k) - astern, 0.3)] * (k % 24 in {5, 6}) for k in range(60)]
    for one in followed([frame_of(k, np.vstack(view)) for k, view in enumerate(views)]):
        assert np.allclose(one.centers[:, :2], place(one.index), atol=0.1)
        assert np.hypot(*one.velocities.T) == pytest.approx(SPEED_MS, abs=0.1)


@pytest.mark.parametrize("jump", [(2, 4, 0), (400, 0, 0), (0, 0, 0.5)])
@pytest.mark.parametrize("times", [{30}, {20, 21}])
def test_ids_survive_where_the_pose_jumps(jump, times):
    """An estimate of the pose that is corrected, or wrong for a frame, does not move what is around."""
    at, poses, clouds = np.zeros(3), [], []
    for k in range(60):
        at = at + jump if k in times and not at.any() else np.zeros(3) if k in times else at
        poses.append(Pose(*at))
        clouds.append(frame_of(k, hull(place(k), 0.3)))
    found = followed(clouds, poses)
    assert [one.tracks for one in found] == [[1]] * 60
    speeds = [np.hypot(*one.velocities[0]) for one in found[10:] if one.index not in times]
    assert np.allclose(speeds, SPEED_MS, atol=0.3)


@pytest.mark.parametrize("every", [2, 5])
def test_frames_without_any_echo_miss_nothing(every):
    nothing = np.empty((0, 3))
    found = followed([frame_of(k, nothing if k % every else hull(place(k), 0.3)) for k in range(60)])
    assert {name for one in found[: -every + 1] for name in one.states} == {CONFIRMED, "lost"}
    assert min(one.scores[0] for one in found[: -every + 1]) > 0.9


@pytest.mark.parametrize("frames", [400])
def test_frames_are_complete_after_a_limited_time(frames):
    follower = Follower(1.5, 5, context_s=1.0)
    waiting = []
    done = 0
    for k in range(frames):
        done += len(list(follower.add(frame_of(k, hull(place(0), 0.3)), None)))
        waiting.append(k + 1 - done)
    assert max(waiting) <= 21
    assert done + len(list(follower.finish())) == frames


def test_a_gap_ends_all_tracks():
    results = [frame_of(k + (100 if k >= 20 else 0), hull(place(0), 0.3)) for k in range(40)]
    found = followed(results)
    assert [one.tracks for one in found] == [[1]] * 20 + [[2]] * 20


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(8, 0), (180, 0), (0, -8), (175, 5)])
def test_heights_do_not_depend_on_the_mounting(roll_deg, pitch_deg):
    """Results know the water against the lidar as it is mounted, clouds are in its own axes."""
    mounting = Mounting(roll_deg, pitch_deg)
    tops = []
    for one in (Mounting(), mounting):
        results = []
        for k in range(20):
            level = frame_of(k, one.unlevelled(hull(place(k), 0.3).T).T)
            results.append(FilterResult(level.frame, level.reason, water=WaterState(-1.5, 2.0, -1.0, 0.1, 0.1)))
        found = followed(results, mounting=one)
        assert {name for frame in found for name in frame.states} == {CONFIRMED}
        tops.append(np.median([frame.tops_m for frame in found]))
    assert tops[1] == pytest.approx(tops[0], abs=0.4)  # a tilted box is not upright in the cloud


def states_above_water(body_of, beams=64):
    """Return the states of what is in front of a sea two metres below the lidar."""
    elevation = np.radians(np.linspace(-20, 5, beams))[:, None]
    azimuth = np.radians(np.arange(100, 200, 2))
    sea = np.stack([20 * np.cos(elevation) * np.cos(azimuth), 20 * np.cos(elevation) * np.sin(azimuth)])
    sea = np.vstack((sea.reshape(2, -1), np.broadcast_to(20 * np.sin(elevation), (beams, 50)).reshape(-1))).T
    results = []
    for k in range(30):
        body = body_of(k)
        reason = np.repeat(np.array([Reason.OUTLIER, 0], np.uint8), (len(sea), len(body)))
        one = frame_of(k, np.vstack((sea, body)), reason)
        results.append(FilterResult(one.frame, one.reason, water=WaterState(-2.0, 0.0, 0.0, 0.1, 0.1)))
    return [set(one.states) for one in followed(results)]


@pytest.mark.parametrize(
    ("bottom_m", "beams", "state"), [(1.0, 64, CANDIDATE), (0.0, 64, CONFIRMED), (1.0, 8, CONFIRMED)]
)
def test_what_does_not_reach_down_to_the_water_is_a_candidate(bottom_m, beams, state):
    """With eight beams, the next one passes below what is a metre above the water at 30 m."""
    states = states_above_water(lambda k: hull(place(k), 0.3) * (1, 1, 0.5) + (0, 0, bottom_m - 1.5), beams)
    assert set.union(*states) == {state}


@pytest.mark.parametrize(("front_x", "state"), [(0, CONFIRMED), (12, CANDIDATE)])
def test_a_sail_of_which_the_hull_is_hidden_is_a_boat(front_x, state):
    sail = line((-3, 30), (3, 31)) * (1, 1, 3) + (0, 0, 3)
    front = hull(np.array([front_x, 20.0]), 0.1) * (1, 1, 2)
    assert states_above_water(lambda _: np.vstack((front, sail)))[10] == {CONFIRMED, state}
    found = followed([frame_of(k, sail) for k in range(20)])
    assert found[10].sizes[0, 1] == pytest.approx(1.8, abs=0.1)


def test_a_boat_of_which_both_ends_are_hidden_stays_where_it_is():
    center, front = np.array([15.0, 20.0]), [line((4.9, 9.3), (6.3, 9.3)), line((8.7, 9.3), (10.1, 9.3))]
    boat = hull(center, 0.0)
    middle = boat[(np.abs(boat[:, 0] - center[0]) < 2.4) & (boat[:, 1] < center[1])]
    scenes = [boat] * 30 + [np.vstack((middle, *front))] * 20
    for one in followed([frame_of(k, scene) for k, scene in enumerate(scenes)])[30:]:
        assert np.hypot(*(one.centers[one.tracks.index(1), :2] - center)) < 0.4
