"""Checks to pass before a commit: lint, format, types, doctests and tests. Run as ``python -m tests``.

``python -m tests --quick`` runs fewer tests, see ``conftest.py``. Other arguments are passed to pytest. Types are
checked beside the tests, which do not keep all cores busy. Tests of a file stay together where they can, because they
share what they prepare. Temporary files are in memory where there is room: disks may take milliseconds to remove one.
"""

import os
import shutil
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
BESIDE = ("mypy",)
"""Check whose output comes after that of the tests."""
MEMORY, ROOM = Path("/dev/shm"), 8 * 2**30
"""File system in memory, which containers may lack, and how many bytes must be free in it; the tests use 2 GB."""


def checks(arguments: list[str]) -> tuple[tuple[str, ...], ...]:
    """Return the commands to run, each a module and its arguments."""
    quick = ("--hypothesis-profile=quick",) if "--quick" in arguments else ()
    return (
        ("ruff", "check", "."),
        ("ruff", "format", "--check", "."),
        ("pytest", "-q", "-n", "auto", "--dist", "worksteal", "-m", "not slow", *quick, *arguments),
    )


def in_memory() -> bool:
    """Return whether temporary files may be in memory: nothing else was chosen, and tests can start programs there."""
    if os.environ.get("TMPDIR") or not os.access(MEMORY, os.W_OK):
        return False
    return shutil.disk_usage(MEMORY).free >= ROOM and not os.statvfs(MEMORY).f_flag & os.ST_NOEXEC


def main() -> int:
    """Run all checks and return 1 if any failed."""
    with TemporaryDirectory(prefix="tests-", dir=MEMORY) if in_memory() else nullcontext() as folder:
        return run(dict(os.environ) | ({"TMPDIR": folder} if folder else {}))


def run(environment: dict[str, str]) -> int:
    """Run all checks with environment variables and return 1 if any failed."""
    if environment.pop("PYTHONDONTWRITEBYTECODE", None):  # bytecode halves the time, and need not be beside the sources
        environment["PYTHONPYCACHEPREFIX"] = str(ROOT / ".pytest_cache" / "bytecode")
    python: dict[str, Any] = {"cwd": ROOT, "env": environment}
    beside = subprocess.Popen(
        [sys.executable, "-m", *BESIDE], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **python
    )
    statuses = {}
    for check in checks(sys.argv[1:]):
        print(f"== {' '.join(check)}", flush=True)  # noqa: T201
        statuses[check] = subprocess.run([sys.executable, "-m", *check], check=False, **python).returncode
    print(f"== {' '.join(BESIDE)}\n{beside.communicate()[0].decode()}", end="")  # noqa: T201
    statuses[BESIDE] = beside.returncode
    failed = [f"{' '.join(check[:2])} (exit status {status})" for check, status in statuses.items() if status]
    print(f"== failed: {', '.join(failed)}" if failed else "== all checks passed", flush=True)  # noqa: T201
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
