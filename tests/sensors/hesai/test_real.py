"""Hesai decoder on real packets, against the frames that Nebula decoded from them.

The recordings are those of Nebula's own tests (`tier4/nebula` 606ac41, Apache-2.0), each with the angles in its folder
``calibration``. Nebula leaves out near points, and the earlier of two returns less than 0.1 m apart.
"""

import numpy as np
import pytest
from scipy.spatial import KDTree

from seaclutter_cli.sensors.packets import DecoderOptions, Packets
from tests.paths import shared
from tests.sensors.hesai.test_decoder import all_scans, assert_same, azimuths_of, decode, nebula_points, xyz

RECORDINGS = {
    "40p": ("Pandar40P", 56_762, 0, 0.3),
    "64": ("Pandar64", 93_591, 0, 0.3),
    "qt64": ("PandarQT", 34_158, 0, 0.3),
    "qt128": ("PandarQT128", 73_560, 0, 0.3),
    "xt16": ("PandarXT-16", 26_287, 11, 0.3),
    "xt32m": ("PandarXT-32M2X", 13_574, 1, 0.5),
}
"""By folder: model, points of Nebula's frame, those at azimuth 0 that it adds to the turn before, least range."""
APART_M = 0.1


@pytest.mark.parametrize("folder", RECORDINGS)
def test_points_are_those_of_nebula(folder):
    model, size, at_zero, least_m = RECORDINGS[folder]
    packets, expected = all_scans(folder), nebula_points(folder)
    assert len(expected) == size
    angles = shared("nebula/calibration") / f"{folder}.csv"
    frames, facts = decode(packets, options=DecoderOptions(angles))
    assert (facts.model, facts.bad_packets) == (model, 0)
    found = min((frame.points for frame in frames), key=lambda points: unmatched(expected, xyz(points)).sum())
    missing, more = unmatched(expected, xyz(found)), unmatched(xyz(found), expected)
    assert missing.sum() == at_zero
    assert np.abs(azimuths_of(expected[missing])).max(initial=0) < 0.01
    explained = left_out(found, least_m) | (np.abs(azimuths_of(xyz(found))) < 0.01)
    assert not (more & ~explained).any()


def unmatched(points, others):
    """Return which points have no other one within 10 µm."""
    return KDTree(others).query(points)[0] > 1e-5


def left_out(points, least_m):
    """Return which points Nebula leaves out."""
    ranges = np.linalg.norm(xyz(points), axis=1)
    second = points["return_number"] == 2
    keys = np.stack((points["timestamp"], points["ring"]), axis=1)
    later = {(time, ring): range_m for (time, ring), range_m in zip(keys[second].tolist(), ranges[second], strict=True)}
    after = np.array([later.get(tuple(key), np.inf) for key in keys.tolist()])
    return (ranges < least_m) | (~second & (np.abs(after - ranges) < APART_M))


@pytest.mark.parametrize("folder", RECORDINGS)
@pytest.mark.parametrize("batch", [1, 37])
def test_batch_size_does_not_matter(folder, batch):
    packets = all_scans(folder)
    part = Packets(packets.times_ns[:300], packets.payloads[:300])
    assert_same(decode(part, batch)[0], decode(part)[0])
