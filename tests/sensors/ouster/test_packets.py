"""Damaged frame ids among those of revolutions, with losses and late packets, in batches of any size."""

import numpy as np
import pytest

from seaclutter_cli.sensors.ouster.packets import FrameIdCheck

PER_REVOLUTION = 4


def damaged(packets, batch=1000):
    """Return the indices of packets with damaged ids, given frame id + position / 10; the last is not judged."""
    check = FrameIdCheck(PER_REVOLUTION)
    tenths = np.rint(np.multiply(packets, 10)).astype(np.int64)
    parts = [tenths[start : start + batch] for start in range(0, len(tenths), batch)]
    intact = np.concatenate([check.add(part // 10, part % 10) for part in parts])
    assert len(intact) == len(packets) - 1
    return np.flatnonzero(~intact).tolist()


@pytest.mark.parametrize("batch", [1, 2, 3, 1000])
@pytest.mark.parametrize(
    ("packets", "expected"),
    [
        ([7.0, 7.1, 7.2, 7.3, 8.0], []),
        ([7.2, 7.3, 8.0, 8.1, 8.2], []),
        ([65535.3, 0.0, 0.1], []),
        ([7.0, 8.0, 9.0, 10.0, 12.0, 15.0], []),
        ([7.1, 7.0, 7.3, 7.2, 8.0], []),
        ([7.2, 9.1, 9.2], []),
        ([7.0, 7.1, 300.2, 7.3, 8.0], [2]),
        ([7.2, 7.3, 300.0, 8.1, 8.2], [2]),
        ([7.2, 300.3, 8.0, 8.1], [1]),
        ([65535.3, 300.0, 0.1], [1]),
        ([7.3, 8.0, 7.1, 8.2, 8.3], [2]),
        ([7.3, 8.0, 9.1, 8.2, 8.3], [2]),
        ([7.1, 7.2, 8.0, 7.3, 8.1, 8.2], [2]),
        ([7.0, 300.1, 7.2, 300.3, 8.0, 8.1], [1, 3]),
        ([300.0, 7.1, 7.2], []),
        ([7.1, 7.2, 300.3], []),
    ],
)
def test_ids(packets, expected, batch):
    assert damaged(packets, batch) == expected


@pytest.mark.parametrize("batch", [1, 2, 5])
def test_batches_do_not_matter(batch):
    random = np.random.default_rng(1)
    ids = np.arange(400) // 4
    ids[random.choice(400, 60)] ^= random.integers(1, 65536, 60)
    packets = (ids + np.arange(400) % 4 / 10).tolist()
    assert damaged(packets)
    assert damaged(packets, batch) == damaged(packets)
