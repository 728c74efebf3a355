"""Peculiarities of outputs: what a format cannot have, or must have."""

from functools import partial

from tests.logs import START_NS, Entry, cloud_message, cloud_topic, write_log
from tests.peculiarities.case import Case, sea
from tests.peculiarities.recordings import structured

CLOCK = "A clock without a battery shows 1970, and a time zone is subtracted from it."


def before_1970(folder, kind):
    """Write a log whose second stamp only ROS 2 has."""
    stamps = (500_000_000, -1_500_000_000)
    entries = [Entry("/points", START_NS, cloud_message(kind, structured(sea()), stamp)) for stamp in stamps]
    return write_log(folder / "log.mcap", [cloud_topic("/points", kind)], entries)


CASES = [
    *(
        Case(
            name=f"stamps before 1970, {kind}",
            source=CLOCK,
            build=partial(before_1970, kind=kind),
            refused="^Error: /points: .* fit into .*; write MCAP instead$",
            refused_by=("filter", "convert"),
            to=("bag",),
        )
        for kind in ("ros2", "json")
    ),
    Case(
        name="stamps before 1970, in ROS 2",
        source=CLOCK,
        build=partial(before_1970, kind="json"),
        frames=[sea(), sea()],
        stamps_ns=(500_000_000, -1_500_000_000),
        to=("mcap", "rosbag2-db3"),
    ),
]
