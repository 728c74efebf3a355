"""Checks to pass before a commit: lint, format, types, doctests and tests. Run as ``python -m tests``.

``python -m tests --quick`` runs fewer tests, see ``conftest.py``. Other arguments are passed to pytest.
"""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def checks(arguments: list[str]) -> tuple[tuple[str, ...], ...]:
    """Return the commands to run, each a module and its arguments."""
    quick = ("--hypothesis-profile=quick",) if "--quick" in arguments else ()
    return (
        ("ruff", "check", "."),
        ("ruff", "format", "--check", "."),
        ("mypy",),
        ("pytest", "-q", "-n", "auto", "-m", "not slow", *quick, *arguments),
    )


def main() -> int:
    """Run all checks and return 1 if any failed."""
    environment = dict(os.environ)
    if environment.pop("PYTHONDONTWRITEBYTECODE", None):  # bytecode halves the time, and need not be beside the sources
        environment["PYTHONPYCACHEPREFIX"] = str(ROOT / ".pytest_cache" / "bytecode")
    failed = []
    for check in checks(sys.argv[1:]):
        print(f"== {' '.join(check)}", flush=True)  # noqa: T201
        status = subprocess.run([sys.executable, "-m", *check], cwd=ROOT, env=environment, check=False).returncode
        if status:
            name = " ".join(word for word in check[:2] if not word.startswith("-"))
            failed.append(f"{name} (exit status {status})")
    print(f"== failed: {', '.join(failed)}" if failed else "== all checks passed", flush=True)  # noqa: T201
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
