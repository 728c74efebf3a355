"""The study of ``confirmed`` still runs: its variants replace parts of the method by name."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.skipif(not (ROOT / "benchmarks").is_dir(), reason="benchmarks are not in the source distribution")
def test_all_variants_of_the_method_run() -> None:
    options = ["ablations", "--frames", "3", "--jobs", "1", "--scenes", "calm"]
    command = [sys.executable, str(ROOT / "benchmarks" / "confirmed"), *options]
    done = subprocess.run(command, check=False, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "plane only, no swell" in done.stdout
