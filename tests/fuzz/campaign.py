"""A campaign: inputs of all formats in worker processes, which are killed if they hang, and a table of the outcomes."""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tests.fuzz.formats import FORMATS
from tests.fuzz.run import Outcome, Recipe, check_honest, run

ROOT = Path(__file__).resolve().parents[2]
ROUND = 1000
MOST_S = 20
MOST_MB = {"filter": 300, "": 500}
"""Limits by the beginning of the command line; a simulation makes what its scene asks for."""
_HANG_S, _START_S = 40, 60


@dataclass
class Tally:
    """Outcomes of a format."""

    codes: Counter = field(default_factory=Counter)
    tracebacks: int = 0
    wrong: int = 0
    left: int = 0
    slowest_s: float = 0.0
    peak_mb: float = 0.0

    def add(self, outcome):
        """Add an outcome."""
        self.codes[outcome.code] += 1
        self.tracebacks += bool(outcome.traceback)
        self.wrong += bool(outcome.problems) and not outcome.traceback
        self.left += outcome.left
        self.slowest_s = max(self.slowest_s, outcome.seconds)
        self.peak_mb = max(self.peak_mb, outcome.peak_mb or 0.0)

    def row(self, name):
        """Return the cells of the table."""
        codes = [self.codes[code] for code in (0, 1, 2, 3)]
        counts = [self.codes.total(), *codes, self.tracebacks, self.wrong]
        return [name, *(f"{n:,}" for n in counts), f"{self.slowest_s:.1f}", f"{self.peak_mb:.0f}", f"{self.left:,}"]


COLUMNS = [
    "format",
    "inputs",
    "exit_0",
    "exit_1",
    "exit_2",
    "exit_3",
    "tracebacks",
    "wrong_results",
    "slowest_s",
    "peak_MB",
    "files_left",
]


def table(tallies):
    """Return the table of a campaign in Markdown."""
    total = Tally()
    for tally in tallies.values():
        total.codes += tally.codes
        for name in ("tracebacks", "wrong", "left"):
            setattr(total, name, getattr(total, name) + getattr(tally, name))
        total.slowest_s, total.peak_mb = max(total.slowest_s, tally.slowest_s), max(total.peak_mb, tally.peak_mb)
    rows = [tally.row(name) for name, tally in tallies.items()] + [total.row("all")]
    head = [" ".join(name.split("_")) for name in COLUMNS]
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def check_limits(outcome, command):
    """Add a problem if a run took too much time or memory."""
    most_mb = next((most for name, most in MOST_MB.items() if command.startswith(name)), MOST_MB[""])
    if outcome.seconds > MOST_S:
        outcome.problems.append(f"{outcome.seconds:.0f} s")
    if (outcome.peak_mb or 0) > most_mb:
        outcome.problems.append(f"{outcome.peak_mb:.0f} MB")


def work(name, seed, first, count):
    """Run inputs of a format in this process, and print each outcome as a line of JSON."""
    check_honest(name)
    for number in range(first, first + count):
        outcome = run(Recipe(name, seed, number))
        commands = FORMATS[name].commands
        check_limits(outcome, commands[number % len(commands)])
        print(json.dumps(asdict(outcome)), flush=True)


def campaign(names, seed, inputs, until_s, report):
    """Run inputs of formats in turn until there are enough, or a time is reached; yield the tallies after each round.

    ``report`` receives each outcome with problems. What took too much memory is repeated in a process of its own, where
    nothing counts that earlier inputs left.
    """
    tallies = {name: Tally() for name in names}
    share = -(-inputs // len(names))
    for first in range(0, share, ROUND):
        for name in names:
            for number, one in enumerate(_in_workers(name, seed, first, min(ROUND, share - first)), first):
                outcome = next(_in_workers(name, seed, number, 1)) if _took_memory(one) else one
                tallies[name].add(outcome)
                if outcome.problems:
                    report(outcome)
            yield tallies
        if time.monotonic() > until_s:
            return


def _took_memory(outcome):
    return bool(outcome.problems) and all(problem.endswith(" MB") for problem in outcome.problems)


def _in_workers(name, seed, first, count):
    """Yield the outcomes of inputs; an input that ends its worker, or on which it hangs, has an outcome of its own."""
    number = first
    while number < first + count:
        for outcome in _in_worker(name, seed, number, first + count - number):
            yield outcome
            number += 1


def _in_worker(name, seed, first, count):
    words = ["-m", "tests.fuzz", "--work", str(Recipe(name, seed, first)), "--inputs", str(count)]
    with tempfile.TemporaryDirectory(prefix="fuzz-worker-") as folder, tempfile.TemporaryFile("w+") as errors:
        environment = {"TMPDIR": folder, "TEMP": folder, "TMP": folder}
        process = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", *words],
            cwd=ROOT,
            env={**os.environ, **environment},
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
        found, wait_s = 0, _START_S
        while True:
            watch = threading.Timer(wait_s, process.kill)
            watch.start()
            line = process.stdout.readline()
            watch.cancel()
            if not line:
                break
            yield Outcome(**json.loads(line))
            found, wait_s = found + 1, _HANG_S
        status = process.wait()
        process.stdout.close()
        if found < count:
            errors.seek(0)
            text = f"the process ended with status {status}\n{errors.read()[-3000:]}"
            yield Outcome(str(Recipe(name, seed, first + found)), -1, 0.0, None, [text.splitlines()[0]], text)
