"""Recordings that are read as one report what lies within what is read."""

import re

import pytest

from tests.paths import ROOT
from tests.running import execute

SEA = ROOT / "samples" / "sea.mcap"
PERIODS = {"all": ((), 3), "the part with the damage": (("--end", 1), 3), "another part": (("--start", 4), 0)}


@pytest.mark.parametrize("name", PERIODS)
def test_only_damage_within_the_period_is_reported(tmp_path, name):
    words, code = PERIODS[name]
    data = bytearray(SEA.read_bytes())
    data[len(data) // 10 : len(data) // 10 + 50] = bytes(50)
    (tmp_path / "port.mcap").write_bytes(data)
    (tmp_path / "starboard.mcap").write_bytes(SEA.read_bytes())
    result = execute("convert", tmp_path, "--merge", *words, "-o", tmp_path / "out" / "all.mcap", code=code)
    assert bool(re.search("Damaged: .*port.mcap: .* the chunk fails its checksum", result.stderr)) == (code == 3)
