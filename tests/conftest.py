"""Settings for all tests."""

import io
import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# The same examples in every run, without limits of time, so that results do not depend on randomness or machine load.
# Run pytest --hypothesis-profile=search to search for new examples; quick is for python -m tests --quick.
UNTIMED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("same", UNTIMED, derandomize=True)
settings.register_profile("search", UNTIMED, derandomize=False)
settings.register_profile("quick", UNTIMED, derandomize=True, max_examples=5)
settings.load_profile("same")

# Background jobs of a shell ignore SIGINT, and so would the programs that tests start and interrupt.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# Thousands of outputs need not survive a power failure.
os.fsync = os.sync = lambda *_: None


def pytest_runtest_setup(item):
    """Skip a test of a filter method whose package is not installed."""
    from seaclutter_cli.filters import OPTIONAL

    for value in item.callspec.params.values() if hasattr(item, "callspec") else ():
        if isinstance(value, str) and value in OPTIONAL:
            pytest.importorskip(OPTIONAL[value])


@pytest.fixture
def full_disk(monkeypatch):
    """Let output files be on a full disk; without one, skip the test."""
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full")
    from seaclutter_cli.sinks import atomic

    class OnFullDisk(atomic.PartFile):
        def __init__(self, part, target):
            part.touch()
            io.FileIO.__init__(self, "/dev/full", "wb")
            self._target = target

    monkeypatch.setattr(atomic, "PartFile", OnFullDisk)
