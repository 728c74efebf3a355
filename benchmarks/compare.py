"""Whole process: ``seaclutter evaluate --compare paper`` and ``seaclutter filter`` on the same log, alternating.

Run as ``python benchmarks/compare.py LOG LABELS`` on a log of your own, or as ``python benchmarks/compare.py FOLDER``,
which creates synthetic logs of 196 frames there; on Linux or macOS.
"""

import statistics
import sys
from pathlib import Path

from logs import SHARES, write_log
from whole_process import filter_command, measure

FRAMES = 196
RUNS = 5
BOXES = ((20, 10), (-30, 5), (60, -20), (90, 10), (0, 45))


def write_labels(path: Path) -> None:
    """Write five boxes per frame; their positions are arbitrary, since only the time matters."""
    rows = [
        f"{number},{track},boat,{x},{y},0,8,3,4,0.3" for number in range(FRAMES) for track, (x, y) in enumerate(BOXES)
    ]
    path.write_text("\n".join(("frame,track_id,class,x,y,z,length,width,height,yaw", *rows, "")))


def evaluate_command(log: Path, labels: Path) -> list[str]:
    command = [sys.executable, "-m", "seaclutter_cli", "evaluate", str(log), "--labels", str(labels)]
    return [*command, "--compare", "paper", "-o", str(labels.with_name("frames.csv")), "--force", "-q"]


def compare(name: str, log: Path, labels: Path) -> None:
    """Print the times of both commands, after one untimed run of each."""
    pairs = [(measure(evaluate_command(log, labels)), measure(filter_command(log))) for _ in range(RUNS + 1)][1:]
    ratios = [ours[0] / once[0] for ours, once in pairs]
    ours, once = (statistics.median(pair[side][0] for pair in pairs) for side in (0, 1))
    spread = f"({min(ratios):.2f} to {max(ratios):.2f})"
    peak = max(pair[0][1] for pair in pairs)
    print(f"{name:<10}{ours:>12.2f}{once:>10.2f}{statistics.median(ratios):>8.2f}{spread:>17}{peak:>7.0f}")


def main(arguments: list[str]) -> None:
    print(f"{'log':<10}{'evaluate s':>12}{'filter s':>10}{'ratio':>8}{'':>17}{'MB':>7}")
    if len(arguments) == 2:
        log, labels = map(Path, arguments)
        compare(log.stem[:9], log, labels)
        return
    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    labels = folder / "five-boxes.csv"
    write_labels(labels)
    for name, share in SHARES.items():
        log = folder / f"{name}-{FRAMES}.mcap"
        write_log(log, FRAMES, share)
        compare(name, log, labels)


if __name__ == "__main__":
    main(sys.argv[1:])
