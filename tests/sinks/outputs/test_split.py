"""Where parts of a log begin."""

import pytest

from seaclutter_cli.sinks.options import Parts, Split, parse_split


@pytest.mark.parametrize(
    ("text", "split"),
    [
        ("500MB", Split(size=500_000_000)),
        ("2 GiB", Split(size=2**31)),
        ("7b", Split(size=7)),
        ("1.5kB", Split(size=1500)),
        ("30s", Split(duration_ns=30 * 10**9)),
        ("0.5 sec", Split(duration_ns=5 * 10**8)),
        ("10min", Split(duration_ns=600 * 10**9)),
        ("1h", Split(duration_ns=3600 * 10**9)),
    ],
)
def test_limits(text, split):
    assert parse_split(text) == split


@pytest.mark.parametrize("text", ["", "5", "GB", "-1s", "0s", "0MB", "1m", "1e3s", "1,5s", "5 s s", "\u0661s"])
def test_other_texts_are_refused(text):
    with pytest.raises(ValueError):  # noqa: PT011 - the text itself
        parse_split(text)


def begins(parts, messages):
    return [parts.is_next(*message) for message in messages]


def test_without_a_limit_there_is_one_part():
    assert begins(Parts(None), [(k, 10**9) for k in range(3)]) == [False] * 3


def test_parts_by_duration_begin_at_multiples_after_the_first_message():
    times = [100, 109, 110, 115, 145, 149, 150]
    assert begins(Parts(Split(duration_ns=10)), [(t, 1) for t in times]) == [
        False,
        False,
        True,
        False,
        True,
        False,
        True,
    ]


def test_parts_by_size_are_never_larger_unless_a_message_is():
    sizes = [4, 4, 4, 12, 1, 9, 1]
    assert begins(Parts(Split(size=10)), [(0, s) for s in sizes]) == [False, False, True, True, True, False, True]
