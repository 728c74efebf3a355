"""Failures that campaigns of `tests.fuzz` have found, without their inputs."""

from pathlib import Path

import pytest

import seaclutter
from seaclutter_cli.errors import FieldError, InputError
from seaclutter_cli.records import Message
from seaclutter_cli.runs.observer import SILENT
from seaclutter_cli.runs.recordings import Outcome, storing_errors
from seaclutter_cli.sources.shared.packet_messages import read_packets
from tests.sources.shared import test_packet_topics as topics

SAMPLE = Path(__file__).parents[2] / "samples" / "tile.laz"


def test_packets_without_times_in_a_message_with_a_time_beyond_all_clocks():
    message = Message(topics.channel(), 2**64 - 1, 0, 0, topics.scan([(0, bytes(1206))] * 2))
    (run,) = read_packets(message).packets
    assert run.times_ns.tolist() == [2**63 - 1] * 2


@pytest.mark.parametrize("text", ["no field 'y'", "log: no field 'y'"])
def test_an_error_about_a_field_names_its_recording(text):
    outcome = Outcome(recording="log")
    with storing_errors(outcome, SILENT):
        raise FieldError(text)
    assert outcome.error == "log: no field 'y'"


def test_a_tile_with_waveforms_is_named(tmp_path):
    pytest.importorskip("laspy")
    content = bytearray(SAMPLE.read_bytes())
    content[6] |= 2  # global encoding: waveform data packets are internal
    (tmp_path / "tile.laz").write_bytes(content)
    with pytest.raises(InputError, match=r"tile\.laz: internal waveform packets cannot be copied"):
        seaclutter.separate_tiles(tmp_path / "tile.laz", tmp_path / "out.laz")
    assert [path.name for path in tmp_path.iterdir()] == ["tile.laz"]
