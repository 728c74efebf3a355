"""Own ship's pose and place on earth, from messages that the ``rosbags`` library serialises."""

import math

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from seaclutter_cli.messages.navigation import Fix, Navigation, on_earth
from seaclutter_cli.records import Channel, Message, Schema

STORES = {"cdr": get_typestore(Stores.ROS2_HUMBLE), "ros1": get_typestore(Stores.ROS1_NOETIC)}
STORES["ros1"].register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", "tf2_msgs/msg/TFMessage"))
IMU = "sensor_msgs/msg/Imu"
NAN = math.nan
STAMP_NS = 1_700_000_000_000_000_000


@pytest.fixture(params=STORES)
def send(request):
    """Return a function that gives a message to a navigation."""
    store, encoding = STORES[request.param], request.param
    types = store.types

    def header(frame_id, stamp_ns):
        stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
        number = {"seq": 0} if encoding == "ros1" else {}
        return types["std_msgs/msg/Header"](**number, stamp=stamp, frame_id=frame_id)

    def pose(kinds, at, yaw_deg):
        half = math.radians(yaw_deg) / 2
        place, turn = (types[f"geometry_msgs/msg/{kind}"] for kind in kinds)
        return place(*map(float, at)), turn(0.0, 0.0, math.sin(half), math.cos(half))

    def made(kind, frame_id, stamp_ns, **values):
        head = header(frame_id, stamp_ns)
        if kind == "tf2_msgs/msg/TFMessage":
            transform = types["geometry_msgs/msg/Transform"](
                *pose(("Vector3", "Quaternion"), values["at"], values["yaw"])
            )
            return types[kind]([types["geometry_msgs/msg/TransformStamped"](head, values["child"], transform)])
        if kind in ("nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"):
            placed = types["geometry_msgs/msg/Pose"](*pose(("Point", "Quaternion"), values["at"], values["yaw"]))
            if kind == "geometry_msgs/msg/PoseStamped":
                return types[kind](head, placed)
            zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
            twist = types["geometry_msgs/msg/Twist"](zero, zero)
            uncertain = types["geometry_msgs/msg/PoseWithCovariance"](placed, np.zeros(36))
            return types[kind](
                head, values["child"], uncertain, types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
            )
        if kind == "sensor_msgs/msg/NavSatFix":
            status = types["sensor_msgs/msg/NavSatStatus"](0, 1)
            return types[kind](head, status, *map(float, values["at"]), np.zeros(9), 0)
        zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        turn = pose(("Vector3", "Quaternion"), (0, 0, 0), values["yaw"])[1]
        unset = types["geometry_msgs/msg/Quaternion"](*map(float, values.get("turn", (0, 0, 0, 1))))
        return types[kind](
            head,
            unset if "turn" in values else turn,
            np.full(9, float(values.get("covariance", 0))),
            types["geometry_msgs/msg/Vector3"](0.0, 0.0, math.radians(values.get("rate", 0.0))),
            np.zeros(9),
            zero,
            np.zeros(9),
        )

    def send(navigation, kind, frame_id, stamp_ns, *, topic="/topic", log_time_ns=None, **values):
        message = made(kind, frame_id, stamp_ns, **values)
        serialise = store.serialize_ros1 if encoding == "ros1" else store.serialize_cdr
        name = kind.replace("/msg", "") if encoding == "ros1" else kind
        channel = Channel(1, topic, encoding, Schema(name, "", b""))
        logged_ns = log_time_ns or stamp_ns
        navigation.see(Message(channel, logged_ns, logged_ns, 0, bytes(serialise(message, kind))))

    return send


def test_poses_follow_odometry_and_static_transforms(send):
    navigation = Navigation()
    send(navigation, "tf2_msgs/msg/TFMessage", "base_link", STAMP_NS, child="lidar", at=(1, 0, 2), yaw=90)
    for k in range(3):
        at = (10 + k, 5, 0)
        send(navigation, "nav_msgs/msg/Odometry", "odom", STAMP_NS + k * 10**9, child="base_link", at=at, yaw=30 * k)
    assert np.allclose(navigation.pose("lidar", STAMP_NS), (11, 5, math.pi / 2))
    between = navigation.pose("lidar", STAMP_NS + 1_500_000_000)
    assert np.allclose(between, (11.5 + math.cos(math.pi / 4), 5 + math.sin(math.pi / 4), 3 * math.pi / 4))
    assert navigation.pose("lidar", STAMP_NS + 10 * 10**9) is None


def test_odometry_without_transforms_is_that_of_the_lidar(send):
    navigation = Navigation()
    for k in range(2):
        send(navigation, "nav_msgs/msg/Odometry", "odom", STAMP_NS + k, child="base_link", at=(k, 0, 0), yaw=0)
    assert np.allclose(navigation.pose("lidar", STAMP_NS + 1), (1, 0, 0))


def test_the_frame_of_odometry_does_not_move(send):
    """Clouds after registration are in it."""
    navigation = Navigation()
    for k in range(2):
        send(navigation, "nav_msgs/msg/Odometry", "odom", STAMP_NS + k, child="base_link", at=(k, 0, 0), yaw=30)
    assert navigation.pose("odom", STAMP_NS + 1) == (0, 0, 0)
    assert np.allclose(navigation.pose("lidar", STAMP_NS + 1), (1, 0, math.pi / 6))


ODOMETRY, TF, POSE = "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseStamped"


def test_of_several_topics_the_first_is_own_ships_and_others_are_named(send):
    """Logs of trials also have those of the target, or of a goal."""
    navigation = Navigation()
    for k in range(20):
        assert not navigation.ambiguities or k
        stamp_ns = STAMP_NS + k * 10**7
        for topic, x in ("own", 3.0), ("target", 3.5), ("other", 3.1):
            send(navigation, POSE, "map", stamp_ns, topic=f"{topic}/pose", at=(x + k / 100, 0, 0), yaw=0)
            send(navigation, "sensor_msgs/msg/NavSatFix", "gps", stamp_ns, topic=f"{topic}/fix", at=(x, 5, 0))
            send(navigation, "sensor_msgs/msg/Imu", "imu", stamp_ns, topic=f"{topic}/imu", yaw=10)
        if k:
            assert navigation.pose("lidar", stamp_ns) == pytest.approx((3 + k / 100, 0, 0))
    assert navigation.fix("lidar", stamp_ns)[0] == pytest.approx(3)
    assert navigation.ambiguities == [
        "own/pose and target/pose tell different poses of own ship; that of own/pose is used",
        "fixes on own/fix are taken for own ship's, not those on target/fix, other/fix",
        "headings on own/imu are taken for own ship's, not those on target/imu, other/imu",
    ]


@pytest.mark.parametrize(
    ("first", "second", "counts"),
    [
        ((ODOMETRY, "/wheel/odom", "odom"), (TF, "/tf", "odom"), 1),
        ((ODOMETRY, "/map_odometry", "map"), (ODOMETRY, "/odometry", "usv/odom_combined"), 1),
        ((POSE, "/goal", "map"), (ODOMETRY, "/odometry", "odom"), 1),
        ((ODOMETRY, "/a", "odom"), (ODOMETRY, "/b", "odom"), 0),
    ],
)
def test_of_several_transforms_of_a_frame_the_most_useful_counts(send, first, second, counts):
    navigation = Navigation()
    for k in range(30):
        for n, (kind, topic, frame_id) in enumerate((first, second)):
            at = (k / 10 * (1 + n), 0, 0)
            send(navigation, kind, frame_id, STAMP_NS + k * 10**8, topic=topic, child="base_link", at=at, yaw=0)
    assert navigation.pose("base_link", STAMP_NS + 29 * 10**8)[0] == pytest.approx(2.9 * (1 + counts))


def test_a_goal_that_stands_still_is_no_motion(send):
    navigation = Navigation()
    for k in range(30):
        send(navigation, POSE, "map", STAMP_NS + k * 10**8, topic="/goal", at=(50, 0, 0), yaw=0)
    assert navigation.pose("lidar", STAMP_NS) is None
    for k in range(30, 60):
        send(navigation, POSE, "map", STAMP_NS + k * 10**8, topic="/goal", at=(50, 0, 0), yaw=0)
        send(navigation, ODOMETRY, "odom", STAMP_NS + k * 10**8, topic="/odom", child="base", at=(k, 0, 0), yaw=0)
    assert navigation.pose("lidar", STAMP_NS + 59 * 10**8) == pytest.approx((59, 0, 0))


def test_what_only_turns_does_not_tell_where_own_ship_is(send):
    """A frame that is stabilised to the horizon moves with own ship."""
    navigation = Navigation()
    for k in range(30):
        send(navigation, TF, "base_footprint", STAMP_NS + k * 10**8, topic="/tf", child="lidar", at=(0, 0, k), yaw=k)
    assert navigation.pose("lidar", STAMP_NS) is None
    assert navigation.unmoved == "the lidar turns, but does not move, in 'base_footprint'"
    assert navigation.attitude("lidar", STAMP_NS)


@pytest.mark.parametrize("second_m", [1.0, 1.1, 1 + 1e-12])
def test_of_static_transforms_of_a_frame_the_last_counts(send, second_m):
    navigation = Navigation()
    for k, x in enumerate((1.0, second_m)):
        send(navigation, TF, "base", STAMP_NS + k * 10**7, topic="/tf_static", child="lidar", at=(x, 0, 2), yaw=90)
    poses = odometry(send, navigation, [(2, 1)] * 40)
    assert np.allclose(poses, [(2 + second_m, 1, math.pi / 2)] * 40)


def test_repeated_transforms_with_the_opposite_quaternion_are_no_motion(send):
    navigation = Navigation()
    for k, yaw in enumerate((90, 450, 90, 450)):
        send(navigation, TF, "base", STAMP_NS + k * 10**8, topic="/tf", child="lidar", at=(1, 0, 2), yaw=yaw)
    assert np.allclose(odometry(send, navigation, [(2, 1)] * 10), [(3, 1, math.pi / 2)] * 10)


def test_odometry_of_the_lidar_is_not_moved_by_how_it_is_mounted(send):
    navigation = Navigation()
    send(navigation, TF, "base_link", STAMP_NS, topic="/tf_static", child="lidar", at=(3, 0, 2), yaw=90)
    for k in range(3):
        send(navigation, ODOMETRY, "odom", STAMP_NS + k * 10**8, topic="/odom", child="lidar", at=(k, 0, 0), yaw=0)
    assert navigation.pose("lidar", STAMP_NS + 2 * 10**8) == pytest.approx((2, 0, 0))


def test_odometry_is_not_that_of_a_lidar_without_transforms_once_others_lead_to_its_body(send):
    navigation = Navigation()
    for k in range(20):
        stamp_ns = STAMP_NS + k * 10**8
        send(navigation, ODOMETRY, "odom", stamp_ns, topic="/odom", child="base_link", at=(k, 0, 0), yaw=0)
        assert navigation.pose("rear", stamp_ns) == (None if k > 10 else pytest.approx((k, 0, 0)))
        if k == 10:
            send(navigation, TF, "base_link", stamp_ns, topic="/tf_static", child="lidar", at=(3, 0, 2), yaw=0)
    assert navigation.unmoved == "no transform leads from 'rear' to a fixed frame"
    assert navigation.pose("lidar", stamp_ns) == pytest.approx((22, 0, 0))


def test_odometry_of_a_stranger_is_named(send):
    navigation = Navigation()
    send(navigation, TF, "base_link", STAMP_NS, topic="/tf_static", child="lidar", at=(3, 0, 2), yaw=0)
    for k in range(3):
        send(
            navigation,
            ODOMETRY,
            "odom",
            STAMP_NS + k,
            topic="/sister/odom",
            child="sister/base_link",
            at=(k, 0, 0),
            yaw=0,
        )
    assert navigation.pose("lidar", STAMP_NS + 2)
    (text,) = navigation.ambiguities
    assert text.startswith("poses of 'sister/base_link' on /sister/odom are taken for own ship's, but no transform")


def test_memory_does_not_grow_with_the_names_of_frames(send):
    navigation = Navigation()
    for k in range(400):
        send(navigation, TF, "base", STAMP_NS, topic="/tf", child=f"frame{k}", at=(k, 0, 0), yaw=0)
    assert len(navigation._edges) == 256


def test_odometry_that_is_not_valid_is_named(send):
    navigation = Navigation()
    for k in range(3):
        send(navigation, ODOMETRY, "odom", STAMP_NS + k, topic="/odom", child="base", at=(NAN, 0, 0), yaw=0)
    assert navigation.pose("lidar", STAMP_NS) is None
    assert navigation.unmoved == "a position or orientation on /odom is not valid"


def test_transforms_without_a_time_have_that_of_the_log(send):
    navigation = Navigation()
    for k in range(3):
        unset = {"stamp_ns": 0, "log_time_ns": STAMP_NS + k * 10**8}
        send(navigation, TF, "odom", topic="/tf", child="lidar", at=(k, 0, 0), yaw=0, **unset)
    assert navigation.pose("lidar", STAMP_NS + 15 * 10**7) == pytest.approx((1.5, 0, 0))


def test_static_transforms_alone_are_no_motion(send):
    navigation = Navigation()
    send(navigation, "tf2_msgs/msg/TFMessage", "base_link", STAMP_NS, child="lidar", at=(1, 0, 2), yaw=0)
    assert navigation.pose("lidar", STAMP_NS) is None


def test_static_transforms_that_are_repeated_are_no_motion(send):
    """The static publisher of ROS 1 sends them to /tf, again and again."""
    navigation = Navigation()
    for k in range(30):
        stamp_ns = STAMP_NS + k * 10**8
        send(navigation, "tf2_msgs/msg/TFMessage", "base_link", stamp_ns, child="lidar", at=(1, 0, 2), yaw=90)
    assert navigation.pose("lidar", stamp_ns) is None
    assert navigation.attitude("lidar", stamp_ns) is None


@pytest.mark.parametrize("odom", ["odom", "usv/odom", "odom_combined"])
def test_poses_are_in_the_frame_that_does_not_jump(send, odom):
    navigation = Navigation()
    for k in range(2):
        send(navigation, "tf2_msgs/msg/TFMessage", odom, STAMP_NS + k, child="lidar", at=(k, 0, 0), yaw=0)
        send(navigation, "tf2_msgs/msg/TFMessage", "map", STAMP_NS + k, child=odom, at=(100 * k, 0, 0), yaw=0)
    assert np.allclose(navigation.pose("lidar", STAMP_NS + 1), (1, 0, 0))


def odometry(send, navigation, places, period_ns=5 * 10**7):
    """Send an odometry; return the poses of the lidar after each message, when that before is a period old."""
    poses = []
    for k, at in enumerate(places):
        stamp_ns = STAMP_NS + k * period_ns
        send(navigation, "nav_msgs/msg/Odometry", "odom", stamp_ns, child="base", at=(*at, 0), yaw=0)
        poses.append(navigation.pose("lidar", stamp_ns))
    return poses


@pytest.mark.parametrize("wrong", [{20}, {20, 21}, {20, 22, 23}])
def test_poses_that_are_wrong_for_a_moment_are_no_motion(send, wrong):
    places = [(0.1 * k + 40 * (k in wrong), 0) for k in range(40)]
    poses = odometry(send, Navigation(), places)
    assert np.allclose(poses[1:], [(0.1 * k, 0, 0) for k in range(1, 40)])


def test_poses_that_are_corrected_stay_where_they_are(send):
    places = [(0.1 * k + 40 * (k >= 20), 0) for k in range(60)]
    poses = np.array(odometry(send, Navigation(), places)[1:])[:, 0]
    truth = 0.1 * np.arange(1, 60)
    late = np.arange(1, 60) < 30
    assert np.allclose(poses[late], truth[late])
    assert np.allclose(poses[~late], truth[~late] + 40)


@pytest.mark.parametrize(("step_m", "period_ns"), [(2, 2 * 10**7), (5, 2 * 10**7), (8, 10**8)])
def test_a_correction_is_a_break_and_no_motion(send, step_m, period_ns):
    navigation, paths = Navigation(), set()
    poses = []
    for k in range(100):
        stamp_ns = STAMP_NS + k * period_ns
        at = (0.01 * k + step_m * (k >= 50), 0, 0)
        send(navigation, "nav_msgs/msg/Odometry", "odom", stamp_ns, child="base", at=at, yaw=0)
        poses.append(navigation.pose("lidar", stamp_ns)[0] - 0.01 * k)
        paths.add(navigation.path)
    assert {round(x, 6) for x in poses} == {0, step_m}
    assert len(paths) == 2


def test_beyond_the_last_message_noise_does_not_grow(send):
    navigation, noise = Navigation(), np.random.default_rng(1).normal(0, 0.02, 200)
    for k in range(200):
        send(
            navigation,
            "nav_msgs/msg/Odometry",
            "odom",
            STAMP_NS + k * 5_000_000,
            child="base",
            at=(noise[k], 0, 0),
            yaw=0,
        )
    assert abs(navigation.pose("lidar", STAMP_NS + 199 * 5_000_000 + 10**9)[0]) < 0.3


def test_poses_go_on_after_one_whose_time_is_wrong(send):
    navigation = Navigation()
    odometry(send, navigation, [(k, 0) for k in range(3)])
    send(navigation, "nav_msgs/msg/Odometry", "odom", STAMP_NS + 10**13, child="base", at=(3, 0, 0), yaw=0)
    assert odometry(send, navigation, [(0.1 * k, 0) for k in range(40)])[-1] == pytest.approx((3.9, 0, 0))


def test_places_on_earth_come_from_a_fix_and_the_heading(send):
    navigation = Navigation()
    send(navigation, "sensor_msgs/msg/NavSatFix", "gnss", STAMP_NS, at=(60, 10, 0))
    assert navigation.fix("lidar", STAMP_NS) is None
    send(navigation, "sensor_msgs/msg/Imu", "imu", STAMP_NS, yaw=90)
    found = navigation.fix("lidar", STAMP_NS)
    assert np.allclose(found, (60, 10, math.pi / 2))
    places = on_earth(found, np.array([[1852.0, 0], [0, -1852]]))
    assert np.allclose(places, [[60 + 1 / 60, 10], [60, 10 + 2 / 60]], atol=2e-4)


def test_places_are_between_fixes(send):
    navigation = Navigation()
    for k in range(2):
        send(navigation, "sensor_msgs/msg/NavSatFix", "gnss", STAMP_NS + k * 10**9, at=(60 + k / 10_000, 10, 0))
        send(navigation, "sensor_msgs/msg/Imu", "imu", STAMP_NS + k * 10**9, yaw=90)
        assert navigation.awaits_fix(STAMP_NS + k * 10**9 + 1)
    assert not navigation.awaits_fix(STAMP_NS + 10**9)
    assert navigation.fix("lidar", STAMP_NS + 3 * 10**8)[0] == pytest.approx(60.00003, abs=1e-7)
    assert navigation.fix("lidar", STAMP_NS + 15 * 10**8)[0] == pytest.approx(60.0001, abs=1e-7)


def test_places_are_those_of_the_lidar_if_it_is_known_where_the_antenna_is(send):
    navigation = Navigation()
    send(navigation, TF, "base", STAMP_NS, topic="/tf_static", child="lidar", at=(3, 0, 2), yaw=90)
    send(navigation, TF, "base", STAMP_NS, topic="/tf_static", child="gnss", at=(-5, 1, 4), yaw=0)
    send(navigation, TF, "base", STAMP_NS, topic="/tf_static", child="imu", at=(0, 0, 0), yaw=0)
    send(navigation, "sensor_msgs/msg/NavSatFix", "gnss", STAMP_NS, at=(60, 10, 0))
    send(navigation, "sensor_msgs/msg/Imu", "imu", STAMP_NS, yaw=90)
    found = navigation.fix("lidar", STAMP_NS)
    assert np.allclose(found[:2], on_earth(Fix(60, 10, 0), np.array([[1.0, 8.0]]))[0], atol=1e-9)
    assert found.yaw == pytest.approx(math.pi)


def test_the_heading_is_that_of_the_lidar_if_it_is_known_how_the_imu_is_mounted(send):
    navigation = Navigation()
    send(navigation, "tf2_msgs/msg/TFMessage", "lidar", STAMP_NS, child="imu", at=(0, 0, 0), yaw=180)
    send(navigation, "sensor_msgs/msg/NavSatFix", "gnss", STAMP_NS, at=(60, 10, 0))
    send(navigation, "sensor_msgs/msg/Imu", "imu", STAMP_NS, yaw=90)
    assert navigation.fix("lidar", STAMP_NS).yaw == pytest.approx(-math.pi / 2)


@pytest.mark.parametrize(
    ("place", "heading", "late_s", "reason"),
    [
        ((60, 10, 0), None, 0, "no heading"),
        ((60, 10, 0), {"yaw": 0, "turn": (0, 0, 0, 1)}, 0, "no heading"),
        ((60, 10, 0), {"yaw": 90}, 3, "no position in sensor_msgs/NavSatFix, within two seconds"),
        ((NAN, NAN, 0), {"yaw": 90}, 0, "no position"),
        ((0, 0, 0), {"yaw": 90}, 0, "no position"),
        ((60, 190, 0), {"yaw": 90}, 0, "no position"),
    ],
)
def test_what_a_place_on_earth_lacks_is_said(send, place, heading, late_s, reason):
    navigation = Navigation()
    send(navigation, "sensor_msgs/msg/NavSatFix", "gnss", STAMP_NS, at=place)
    if heading:
        send(navigation, "sensor_msgs/msg/Imu", "imu", STAMP_NS, **heading)
    assert navigation.fix("lidar", STAMP_NS + late_s * 10**9) is None
    assert navigation.unplaced.startswith(reason)


def test_fixes_that_are_wrong_for_a_moment_are_no_place(send):
    navigation, found = Navigation(), []
    for k in range(40):
        stamp_ns = STAMP_NS + k * 10**8
        send(navigation, IMU, "imu", stamp_ns, yaw=90)
        send(navigation, "sensor_msgs/msg/NavSatFix", "gnss", stamp_ns, at=(60 + 0.1 * (k in {20, 22, 23}), 10, 0))
        found.append(navigation.fix("lidar", stamp_ns))
    assert np.allclose(found, (60, 10, math.pi / 2), atol=1e-12)


def test_a_log_whose_fixes_begin_late_lacks_places(send):
    navigation = Navigation()
    send(navigation, IMU, "imu", STAMP_NS, yaw=90)
    assert navigation.fix("lidar", STAMP_NS) is None
    send(navigation, "sensor_msgs/msg/NavSatFix", "gnss", STAMP_NS, at=(60, 10, 0))
    assert navigation.fix("lidar", STAMP_NS)
    assert navigation.unplaced.startswith("no position")


def test_a_log_without_fixes_lacks_no_place(send):
    navigation = Navigation()
    send(navigation, IMU, "imu", STAMP_NS, yaw=90)
    assert navigation.fix("lidar", STAMP_NS + 3 * 10**9) is None
    assert not navigation.unplaced


@pytest.mark.parametrize(
    ("frame_id", "late_s", "reason"),
    [
        ("velodyne", 0, "no transform leads from 'velodyne' to a fixed frame"),
        ("lidar", 3, "no transform from 'base' to 'odom' within a second of the cloud"),
    ],
)
def test_why_the_motion_is_not_known_is_said(send, frame_id, late_s, reason):
    navigation = Navigation()
    send(navigation, "tf2_msgs/msg/TFMessage", "base", STAMP_NS, child="lidar", at=(0, 0, 1), yaw=0)
    assert navigation.pose(frame_id, STAMP_NS) is None
    assert not navigation.unmoved  # the log tells of no motion
    for k in range(3):
        send(navigation, "tf2_msgs/msg/TFMessage", "odom", STAMP_NS + k * 10**8, child="base", at=(k, 0, 0), yaw=0)
    assert navigation.pose(frame_id, STAMP_NS + late_s * 10**9) is None
    assert navigation.unmoved == reason


def test_odometry_of_a_vessel_at_rest_is_motion_over_ground(send):
    poses = odometry(send, Navigation(), [(2, 1)] * 10)
    assert np.allclose(poses, [(2, 1, 0)] * 10)


def test_longitudes_go_on_beyond_180():
    assert np.allclose(on_earth(Fix(0.0, 179.999, 0.0), np.array([[1113.2, 0.0]])), [[0, -179.991]], atol=1e-5)


def test_places_on_earth_come_from_transforms_to_it(send):
    pyproj = pytest.importorskip("pyproj")
    navigation = Navigation()
    for k, (latitude, longitude) in enumerate([(60.0, 10.0), (60.001, 10.002)]):
        at = pyproj.Transformer.from_crs(4979, 4978).transform(latitude, longitude, 0)
        send(navigation, "tf2_msgs/msg/TFMessage", "earth", STAMP_NS + k, child="lidar", at=at, yaw=0)
    assert np.allclose(navigation.fix("lidar", STAMP_NS + 1)[:2], (60.001, 10.002), atol=1e-8)


def test_metres_agree_with_geodesics():
    pyproj = pytest.importorskip("pyproj")
    ((latitude, longitude),) = on_earth(Fix(48.0, -5.0, 0.3), np.array([[80.0, 60.0]]))
    bearing, _, metres = pyproj.Geod(ellps="WGS84").inv(-5.0, 48.0, longitude, latitude)
    assert abs(metres - 100) < 0.01
    assert abs((90 - bearing) - math.degrees(math.atan2(60, 80) + 0.3)) < 0.01


def test_broken_messages_are_left_out():
    navigation = Navigation()
    for name in ("tf2_msgs/msg/TFMessage", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"):
        channel = Channel(1, "/topic", "cdr", Schema(name, "", b""))
        for data in (b"", b"\0\1\0\0", b"\0\1\0\0" + b"\xff" * 40):
            navigation.see(Message(channel, 0, 0, 0, data))
    assert navigation.pose("lidar", 0) is None


def yaw_of(attitude):
    """Return the yaw of an attitude in degrees."""
    return pytest.approx(math.degrees(math.atan2(attitude.rotation[1, 0], attitude.rotation[0, 0])), abs=1e-6)


def test_attitudes_are_those_of_the_imu_between_its_messages(send):
    navigation = Navigation()
    for k in range(5):
        send(navigation, IMU, "imu", STAMP_NS + k * 10_000_000, yaw=30 + k)
    assert navigation.attitude("lidar", STAMP_NS + 15_000_000).source == ("/topic", "imu", 0)
    assert yaw_of(navigation.attitude("lidar", STAMP_NS + 15_000_000)) == 31.5
    assert navigation.attitude("lidar", STAMP_NS - 1) is None
    assert navigation.attitude("lidar", STAMP_NS + 40_000_001) is None


def test_fixed_transforms_tell_how_the_imu_is_mounted(send):
    navigation = Navigation()
    send(navigation, "tf2_msgs/msg/TFMessage", "base_link", STAMP_NS, child="lidar", at=(0, 0, 0), yaw=90)
    send(navigation, "tf2_msgs/msg/TFMessage", "base_link", STAMP_NS, child="imu", at=(0, 0, 0), yaw=-20)
    for k in range(2):
        send(navigation, IMU, "imu", STAMP_NS + k * 10_000_000, yaw=5)
    assert yaw_of(navigation.attitude("lidar", STAMP_NS)) == 5 + 20 + 90


@pytest.mark.parametrize(
    "unset",
    [{"turn": (0, 0, 0, 1)}, {"turn": (0, 0, 0, 0)}, {"turn": (NAN, 0, 0, 1)}, {"yaw": 10, "covariance": -1}],
    ids=["identity", "zero", "NaN", "covariance"],
)
def test_angular_velocities_are_integrated_where_orientations_are_not_set(send, unset):
    navigation = Navigation()
    for k in range(11):
        send(navigation, IMU, "imu", STAMP_NS + k * 10_000_000, **({"yaw": 0} | unset), rate=20 if k % 2 else NAN)
    start, end = (navigation.attitude("lidar", STAMP_NS + ms * 1_000_000) for ms in (10, 90))
    assert yaw_of(end) == math.degrees(math.atan2(start.rotation[1, 0], start.rotation[0, 0])) + 20 * 0.08


def test_after_a_gap_of_the_imu_axes_are_others(send):
    navigation = Navigation()
    found = []
    for late_ns in (0, 10_000_000, 600_000_000, 610_000_000):
        send(navigation, IMU, "imu", STAMP_NS + late_ns, yaw=0, rate=20)
        found.append(navigation.attitude("lidar", STAMP_NS + late_ns - 5_000_000))
    _, before, _, after = found
    assert after.turn_from(before) is None
    assert navigation.attitude("lidar", STAMP_NS + 300_000_000) is None


def test_attitudes_without_an_imu_are_those_of_transforms(send):
    navigation = Navigation()
    for k in range(2):
        send(navigation, "nav_msgs/msg/Odometry", "odom", STAMP_NS + k * 10**8, child="base", at=(k, 0, 0), yaw=10 * k)
    assert navigation.attitude("lidar", STAMP_NS + 5 * 10**7).source == ("transforms", "odom", 0)
    assert yaw_of(navigation.attitude("lidar", STAMP_NS + 5 * 10**7)) == 5
    assert navigation.attitude("lidar", STAMP_NS + 10**8 + 1) is None
