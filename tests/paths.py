"""Paths of test data."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SAMPLE = ROOT / "samples" / "snow.mcap"
SHARED_DATA = ROOT.parent / "shared" / "data"


def shared(name):
    """Return a folder of real recordings next to the checkout, or skip the test."""
    path = SHARED_DATA / name
    if not path.exists():
        pytest.skip(f"real recordings ({name}) are not next to this checkout")
    return path
