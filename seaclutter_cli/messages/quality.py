"""Topics whose last message stays valid, by what their publishers declare."""

import re

from seaclutter_cli.records import Channel

LATCHED_QOS = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: 1
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""
"""Quality of service of a latched topic in ROS 2, as rosbag2 stores it: reliable, transient local, depth 1."""

_TRANSIENT_LOCAL = re.compile(r"durability:\s*(1\b|transient_local)")


def declares_latched(channel: Channel) -> bool:
    """Return whether a channel has the ROS 1 header ``latching`` or the ROS 2 durability ``transient_local``."""
    metadata = dict(channel.metadata)
    return metadata.get("latching") == "1" or bool(_TRANSIENT_LOCAL.search(metadata.get("offered_qos_profiles", "")))
