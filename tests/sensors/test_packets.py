"""Losses and clocks, which decoders of several makers share."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.packets import LossCounter, SensorClock

DAY_NS, SECOND_NS = 86_400 * 10**9, 10**9


@given(st.lists(st.integers(0, 400), unique=True, min_size=1).map(sorted), st.integers(0, 2**32 - 1))
def test_losses_are_counted_for_any_pattern(numbers, start):
    counter = LossCounter(wrap=1 << 32)
    for part in np.array_split((np.array(numbers) + start) % 2**32, 3):
        if len(part):
            counter.add(part)
    assert counter.lost == numbers[-1] - numbers[0] + 1 - len(numbers)


def test_a_clock_that_is_not_set_is_shifted_until_it_diverges():
    facts = SensorFacts("any")
    clock = SensorClock(facts)
    sensor_ns = np.arange(6) * SECOND_NS
    delays_ns = np.array([5, 9, 2, 7, SECOND_NS + 6, SECOND_NS + 8])
    shifts = clock.shifts(sensor_ns, sensor_ns + 20_000 * DAY_NS + delays_ns) - 20_000 * DAY_NS
    assert shifts.tolist() == [5, 5, 5, 5, SECOND_NS + 6, SECOND_NS + 6]
    assert "not synchronised" in facts.details["clock"]


def test_a_clock_within_a_day_is_used_as_it_is():
    facts = SensorFacts("any")
    times_ns = np.arange(6) * SECOND_NS
    assert not SensorClock(facts).shifts(times_ns, times_ns + DAY_NS - 1).any()
    assert "clock" not in facts.details


def test_a_clock_is_not_corrected_to_an_unknown_recording_time():
    sensor_ns = 1_760_000_000 * 10**9 + np.arange(3)
    assert SensorClock().shifts(sensor_ns, np.zeros(3, np.int64)).tolist() == [0, 0, 0]
