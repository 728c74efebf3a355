"""Limits set by the environment."""

import pytest

from seaclutter_cli.errors import UsageError
from seaclutter_cli.limits import Limits, limits


def test_usual_chunks_and_messages_are_below_the_defaults():
    assert Limits().chunk_bytes > 64 * 2**20
    assert Limits().message_bytes > 32 * 2**20


def test_the_environment_changes_limits(monkeypatch):
    monkeypatch.setenv("SEACLUTTER_MAX_MESSAGE_MIB", "7")
    assert limits() == Limits(message_mib=7)


@pytest.mark.parametrize("text", ["", "0", "-1", "1.5", "many", "٣", "1" * 20])
def test_a_limit_is_a_positive_whole_number(text):
    with pytest.raises(UsageError, match="SEACLUTTER_MAX_CHUNK_MIB: expected a positive whole number"):
        Limits.read({"SEACLUTTER_MAX_CHUNK_MIB": text})


def test_a_compressed_file_is_limited_by_ratio_and_size():
    most = Limits(file_gib=1, file_ratio=64)
    assert most.file_bytes(1000) == 16 * 2**20
    assert most.file_bytes(2**20) == 64 * 2**20
    assert most.file_bytes(2**30) == 2**30
