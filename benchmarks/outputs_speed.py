"""Output formats compared with MCAP output: ``seaclutter convert`` and ``filter`` of one log, in pairs that alternate.

Run as ``python benchmarks/outputs_speed.py FOLDER``; the log and outputs there take some gigabytes.
"""

import shutil
import statistics
import sys
from pathlib import Path

from logs import SHARES, write_log
from whole_process import measure

from seaclutter_cli.sinks.formats import OUTPUT_FORMATS

FRAMES, PAIRS = 200, 5


def command(name: str, log: Path, form: str) -> list[str]:
    """Return the command that writes a log in a format, after removing an earlier output."""
    target = log.parent / f"out_{form}"
    if target.is_dir():
        shutil.rmtree(target)
    return [sys.executable, "-m", "seaclutter_cli", name, str(log), "-o", str(target), "--to", form, "--force", "-q"]


def size_mb(path: Path) -> float:
    files = path.iterdir() if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files) / 1e6


def main(folder: str) -> None:
    log = Path(folder).resolve() / "sea.mcap"
    write_log(log, FRAMES, SHARES["sea"])
    for name in ("convert", "filter"):
        for form in OUTPUT_FORMATS:
            pairs = [tuple(measure(command(name, log, one)) for one in (form, "mcap")) for _ in range(PAIRS)]
            ratios = [one[0] / other[0] for one, other in pairs]
            seconds, memory = (statistics.median(values) for values in zip(*(one for one, _ in pairs), strict=True))
            spread = f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"
            size = size_mb(log.parent / f"out_{form}")
            print(f"| {name} | {form} | {seconds:.2f} | {spread} | {memory:.0f} | {size:.0f} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
