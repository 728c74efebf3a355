"""Attack the program with mutated inputs of every format, and print a table: ``python -m tests.fuzz --help``."""

import argparse
import json
import sys
import time
from dataclasses import asdict

from tests.fuzz.campaign import campaign, check_limits, table, work
from tests.fuzz.formats import FORMATS
from tests.fuzz.run import Recipe, make, run


def main():
    """Run a campaign, or repeat an input."""
    parser = argparse.ArgumentParser("python -m tests.fuzz", description="Attack the program with mutated inputs.")
    parser.add_argument("--inputs", type=int, default=5000, help="number of inputs (default: %(default)s)")
    parser.add_argument("--hours", type=float, help="hours to run; in place of --inputs")
    parser.add_argument("--seed", type=int, default=1, help="another seed gives other inputs (default: %(default)s)")
    parser.add_argument("--format", action="append", choices=FORMATS, help="format to attack; repeatable")
    parser.add_argument("--replay", type=Recipe.parse, metavar="FORMAT:SEED:NUMBER", help="repeat one input")
    parser.add_argument("--save", metavar="FOLDER", help="with --replay: write the input into a folder")
    parser.add_argument("--work", type=Recipe.parse, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        return work(*options.work, options.inputs)
    if options.replay:
        return replay(options.replay, options.save)
    failed = []

    def report(outcome):
        failed.append(outcome)
        print(f"{outcome.recipe}: {'; '.join(outcome.problems)}", file=sys.stderr, flush=True)
        print(outcome.traceback, file=sys.stderr, flush=True)

    until_s = time.monotonic() + (options.hours * 3600 if options.hours else 10**9)
    inputs = 10**12 if options.hours else options.inputs
    tallies = {}
    for tallies in campaign(options.format or list(FORMATS), options.seed, inputs, until_s, report):
        print(f"{sum(tally.codes.total() for tally in tallies.values()):,} inputs", file=sys.stderr, flush=True)
    print(table(tallies))
    return 1 if failed else 0


def replay(recipe, folder):
    """Run one input again, and print its command line and outcome."""
    from pathlib import Path

    files, command, _ = make(recipe)
    for name, data in files.items() if folder else ():
        path = Path(folder, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    outcome = run(recipe)
    check_limits(outcome, command)
    print(f"seaclutter {command}", json.dumps(asdict(outcome), indent=2), outcome.traceback, sep="\n")
    return 1 if outcome.problems else 0


if __name__ == "__main__":
    sys.exit(main())
