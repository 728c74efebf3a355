"""Velodyne decoder on real packets of an Alpha Prime, against the frame that Nebula decoded from them.

The recording is that of Nebula's tests (`tier4/nebula` 606ac41, Apache-2.0). Nebula does not interpolate
azimuths between three of four blocks, so its points lie up to 0.19° behind, and it ignores the
heights of the lasers, which matters near the sensor.
"""

from contextlib import closing
from difflib import SequenceMatcher

import numpy as np
import pytest

from seaclutter_cli.messages import CODECS
from seaclutter_cli.records import Message
from seaclutter_cli.sources.formats import open_source
from tests.paths import shared

pytest.importorskip("velodyne_decoder")

TYPE = "sensor_msgs/msg/PointCloud2"
UNIT_M = 0.004


def frames():
    with closing(open_source(next(shared("nebula/vls128").glob("*.db3")))) as source:
        return [
            CODECS[TYPE, "cdr"].decode(record.data).points
            for record in source.records()
            if isinstance(record, Message) and record.channel.topic == "/velodyne_points"
        ]


def spherical(x, y, z):
    """Return ranges in units, and elevations and azimuths in degrees."""
    ranges = np.sqrt(x * x + y * y + z * z)
    return np.rint(ranges / UNIT_M), np.degrees(np.arcsin(z / ranges)), np.degrees(np.arctan2(y, x))


def test_ranges_and_angles_are_those_of_nebula():
    data = next(shared("nebula/vls128").glob("*.pcd")).read_bytes()
    expected = np.frombuffer(data[data.index(b"DATA binary\n") + 12 :], "<f4").reshape(-1, 3).astype(float)
    points = frames()[1]
    assert (len(points), len(expected)) == (209_907, 208_680)
    ranges, elevations, azimuths = spherical(*(points[axis].astype(float) for axis in "xyz"))
    theirs = spherical(*expected.T)
    for ring in range(12, 108, 12):
        ours = np.flatnonzero(points["ring"] == ring)
        same = np.flatnonzero(np.abs(theirs[1] - np.median(elevations[ours])) < 0.05)
        matches = SequenceMatcher(None, ranges[ours].tolist(), theirs[0][same].tolist(), autojunk=False)
        pairs = [(b.a + n, b.b + n) for b in matches.get_matching_blocks() for n in range(b.size)]
        assert len(pairs) == len(same) > 1000
        one, other = (np.array(side) for side in zip(*pairs, strict=True))
        behind = (theirs[2][same[other]] - azimuths[ours[one]] + 180) % 360 - 180
        assert np.percentile(behind, [0.5, 99.5]) == pytest.approx([0.09, 0.09], abs=0.11)
