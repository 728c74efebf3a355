"""Packets are passed on in the order in which the sensor sent them, each once."""

from itertools import chain

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.sensors.packets import NO_END, Packets
from seaclutter_cli.sources.shared.packet_streams import PacketOrder


class Numbered:
    """A decoder whose packets begin with their place, -1 for none."""

    def __init__(self, end=NO_END):
        self.places_end = end

    def places(self, packets):
        return np.ascontiguousarray(packets.payloads[:, :8]).view(np.int64)[:, 0]


def packets_of(places, contents=None, size=24, times_ns=None):
    payloads = np.zeros((len(places), size), np.uint8)
    payloads[:, :8] = np.asarray(places, np.int64)[:, None].view(np.uint8)
    payloads[:, 8] = np.arange(len(places)) if contents is None else contents
    return Packets(np.arange(len(places)) if times_ns is None else times_ns, payloads)


def passed(order, *batches):
    """Return the places that are passed on for each batch, and at the end."""
    parts = [list(order.add(batch)) for batch in batches] + [list(order.finish())]
    return [[int(place) for one in part for place in Numbered().places(one)] for part in parts]


@settings(max_examples=30)
@given(
    st.lists(st.integers(1, 6), min_size=80, max_size=150),
    st.lists(st.integers(0, 12), min_size=300, max_size=300),
    st.integers(1, 3),
    st.sampled_from([1000, 2**32]),
)
def test_every_delivery_is_put_in_order(steps, delays, copies, end):
    """Some packets are missing; each copy of the others is delayed by some packets, at the end of the range too."""
    sent = np.cumsum(np.array(steps) // 6 + 1) + 900
    arrival = (np.arange(len(sent))[:, None] + np.resize(delays, (len(sent), copies))).ravel()
    rows = np.repeat(np.arange(len(sent)), copies)[np.argsort(arrival, kind="stable")]
    batch = packets_of(sent[rows] % end, rows)
    order = PacketOrder(Numbered(end))
    (found, left) = passed(order, batch)
    assert found + left == (sent % end).tolist()
    assert order.repeated == len(rows) - len(sent)
    assert order.late == 0


def test_packets_in_order_are_passed_on_at_once():
    order = PacketOrder(Numbered())
    assert passed(order, packets_of([5, 6, 9]), packets_of([10, 500_000])) == [[5, 6, 9], [10, 500_000], []]


def test_after_disorder_packets_wait_for_late_ones_of_the_next_batch():
    order = PacketOrder(Numbered())
    batches = passed(order, packets_of([*range(98), 99, 98]), packets_of([101, 102]), packets_of([100, 103]))
    assert list(chain(*batches)) == list(range(104))
    assert (order.moved, order.late) == (2, 0)


def test_what_is_too_late_is_left_out():
    order = PacketOrder(Numbered())
    assert passed(order, packets_of([1, 2, 4]), packets_of([3, 5, 6]))[:2] == [[1, 2, 4], []]
    assert (order.moved, order.late) == (0, 1)


@pytest.mark.parametrize("back", [30.5, 12, 0.9, 100_000])
def test_a_clock_that_is_set_back_changes_no_order(back):
    times = np.arange(200) * 1000
    times[120:] -= round(back * 1000)
    order = PacketOrder(Numbered())
    found = passed(order, packets_of(times[:110] + 10**9), packets_of(times[110:] + 10**9))
    assert list(chain(*found)) == (times + 10**9).tolist()
    assert order.moved == order.late == order.repeated == 0


def test_packets_at_one_place_are_repeated_only_if_they_are_equal():
    """Such as those of a clock that stands still."""
    order = PacketOrder(Numbered())
    found = passed(order, packets_of([7] * 6, [1, 2, 1, 3, 2, 4]), packets_of([7, 7], [5, 3]))
    assert list(map(len, found)) == [4, 1, 0]
    assert order.repeated == 3


@pytest.mark.parametrize("again", [np.arange(500), np.arange(500) * 3 % 500])
def test_a_recording_that_is_played_again_is_not_repeated(again):
    times_ns = np.arange(1000) * 10**6
    order = PacketOrder(Numbered())
    found = passed(order, packets_of([*range(500), *again], [0] * 1000, times_ns=times_ns))
    assert list(chain(*found))[:500] == list(range(500))
    assert len(list(chain(*found))) == 1000
    assert order.repeated == 0


def test_packets_without_a_place_are_passed_on():
    order = PacketOrder(Numbered())
    (found, _) = passed(order, packets_of([1, -1, 2, -1]))
    assert found == [-1, -1, 1, 2]
    assert order.repeated == 0


def test_packets_of_another_length_begin_anew():
    order = PacketOrder(Numbered())
    found = passed(order, packets_of([1, 3, 2]), packets_of([1, 2], size=30))
    assert found == [[], [1, 2, 3], [1, 2]]
