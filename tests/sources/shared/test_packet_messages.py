"""Packets of messages, compared with a reader that takes one field after the other."""

import random

import pytest

from seaclutter_cli.errors import CloudError
from seaclutter_cli.records import Channel, Message, Schema
from seaclutter_cli.sources.shared.packet_messages import read_packets
from tests.sources.shared.slow_messages import SINGLE, Form

START = 1_700_000_000 * 10**9
FORMS = {"ros1": Form(ros1=True), "cdr": Form(ros1=False), "cdr big": Form(ros1=False, big_endian=True)}


def channel(kind, form):
    if FORMS[form].ros1:
        return Channel(1, "/packets", "ros1", Schema(kind.replace("/msg/", "/"), "ros1msg", b""))
    return Channel(1, "/packets", "cdr", Schema(kind, "ros2msg", b""))


def messages(kind, form, values):
    chan, fields = channel(kind, form), SINGLE[kind]
    data = [FORMS[form].write(fields, value) for value in values]
    return [Message(chan, START + n, START + n, n, memoryview(one)) for n, one in enumerate(data)]


def values(rng, number, *, size=1248, frame_id="rslidar"):
    """Return the fields of a message; some have no stamp, whose packets get the log time."""
    stamp = rng.choice((0, START + 10**6 * number + rng.randrange(10**9)))
    flags = {name: rng.randrange(2) for name in ("is_difop", "is_frame_begin")}
    return {"seq": number, "stamp": stamp, "frame_id": frame_id, "data": rng.randbytes(size), **flags}


def expected(kind, form, sent):
    """Return the (time, payload) of each message, by the slow reader; None for one that cannot be read."""
    read = [FORMS[form].read(SINGLE[kind], bytes(message.data)) for message in sent]
    return [
        value and (value.get("stamp") or message.log_time_ns, value["data"])
        for message, value in zip(sent, read, strict=True)
    ]


def read(sent):
    """Return the (time, payload) of each packet, the errors by position, and the last frame id."""
    found, problems, frame_id = [], {}, None
    for number, message in enumerate(sent):
        try:
            packets = read_packets(message)
        except CloudError as error:
            problems[number] = str(error)
        else:
            found += zip(packets.times_ns, map(bytes, packets.payloads), strict=True)
            frame_id = packets.frame_id
    return found, problems, frame_id


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", SINGLE)
def test_messages_of_one_packet(kind, form):
    rng = random.Random(1)
    sent = messages(kind, form, [values(rng, number) for number in range(20)])
    frame_id = "rslidar" if kind == "rslidar_msg/msg/RslidarPacket" else None
    assert read(sent) == (expected(kind, form, sent), {}, frame_id)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("seed", range(5))
def test_messages_of_several_publishers(form, seed):
    kind = "rslidar_msg/msg/RslidarPacket"
    rng = random.Random(seed)
    names = ("left", "rght", "centre")
    sent = messages(
        kind,
        form,
        [values(rng, n, size=rng.choice((1248, 1248, 1210)), frame_id=rng.choice(names)) for n in range(60)],
    )
    assert read(sent)[0] == expected(kind, form, sent)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", ["rslidar_msg/msg/RslidarPacket", "rslidar_msgs/msg/rslidarPacket"])
@pytest.mark.parametrize("cuts", [{}, {0: 3, 1: 30, 12: 7, 13: 400, 29: 0}])
def test_truncated_messages_are_named_and_the_others_read(kind, form, cuts):
    rng = random.Random(3)
    whole = messages(kind, form, [values(rng, number) for number in range(30)])
    sent = [
        Message(m.channel, m.log_time_ns, m.publish_time_ns, n, m.data[: cuts.get(n, len(m.data))])
        for n, m in enumerate(whole)
    ]
    found, problems, _ = read(sent)
    wanted = expected(kind, form, sent)
    assert found == [packet for packet in wanted if packet]
    assert sorted(problems) == sorted(cuts)
    assert all(wanted[number] is None for number in cuts)


def test_a_damaged_length_is_not_taken_from_the_message_before():
    kind, form = "rslidar_msg/msg/RslidarPacket", "cdr"
    rng = random.Random(4)
    sent = messages(kind, form, [values(rng, number) for number in range(9)])
    damaged = bytearray(sent[4].data)
    at = len(damaged) - 1248 - 4
    damaged[at : at + 4] = (1300).to_bytes(4, "little")
    sent[4] = Message(sent[4].channel, START, START, 4, memoryview(bytes(damaged)))
    found, problems, _ = read(sent)
    assert list(problems) == [4]
    assert "declares 1,300 bytes" in problems[4]
    assert found == [packet for packet in expected(kind, form, sent) if packet]
    assert len(found) == 8
