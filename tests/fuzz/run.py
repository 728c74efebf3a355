"""One mutated input: its recipe, a run of the command line on it, and the verdict.

Every run must end like this:

* It raises nothing, prints no traceback, and its exit status is 0, 1, 2 or 3.
* 0: nothing is called an error or damage. 3: damage is reported. Both: every output exists and can be read.
* 1 and 2: a line begins with "Error:" and names an input, and there is no output. 2 is for configurations and scenes,
  and for logs with several topics of clouds, one of which has to be chosen.
* Logs that contain checksums or an index of messages: if fewer frames or points are filtered than of the honest log,
  because the file as a whole was changed, the exit status is not 0. Where content was changed and packed again, with
  checksums that fit, nobody could tell.
* JSON is valid. No incomplete or temporary file remains.
* At most 20 seconds of processor time, 120 seconds by the clock, and 500 MB of memory (`filter`: 300 MB).

The campaign judges times and memory; tests do not, because they depend on the machine.
"""

import csv
import json
import random
import shutil
import sqlite3
import tempfile
import time
import traceback
from contextlib import closing
from dataclasses import dataclass, field
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from typing import NamedTuple

import yaml
from click.testing import CliRunner
from mcap.reader import NonSeekingReader
from rosbags.rosbag1 import Reader

from seaclutter_cli.commands import cli
from tests.fuzz import seeds
from tests.fuzz.formats import FORMATS
from tests.fuzz.mutate import BYTES, MOST_BYTES

STATUS = Path("/proc/self/status")
CLEAR = Path("/proc/self/clear_refs")
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_JOINT = ("calibrate", "classify train")
"""Commands with results, and errors, of all inputs together."""


class Recipe(NamedTuple):
    """What makes an input: written as ``FORMAT:SEED:NUMBER``; number -1 is the honest input."""

    format: str
    seed: int
    number: int

    def __str__(self):
        return f"{self.format}:{self.seed}:{self.number}"

    @classmethod
    def parse(cls, text):
        name, seed, number = text.rsplit(":", 2)
        return cls(name, int(seed), int(number))


_MOST_DELAY = 6


@dataclass
class Outcome:
    """The outcome of a run; ``problems`` is empty if all is well, ``None`` for the peak if it cannot be measured."""

    recipe: str
    code: int
    seconds: float
    peak_mb: float | None
    problems: list = field(default_factory=list)
    traceback: str = ""
    left: int = 0
    text: str = ""
    counts: tuple = ()  # frames and points that `filter` read


@cache
def honest(name):
    """Return the files of the honest input of a format."""
    return seeds.tree(FORMATS[name].write)


@cache
def _others(name):
    """Return data to splice: the files of formats that are related by their name."""
    return [data for other in FORMATS if other.split()[0] == name.split()[0] for data in honest(other).values()]


def make(recipe):
    """Return the files of an input, the command line, and whether a loss must be reported."""
    form, files = FORMATS[recipe.format], dict(honest(recipe.format))
    command = form.commands[recipe.number % len(form.commands)]
    if recipe.number < 0:
        return files, form.commands[-1 - recipe.number], False
    rng = random.Random(str(recipe))
    chosen = rng.choice([name for name in files if fnmatch(name, form.files)])
    original, guarded = files[chosen], False
    others = _others(recipe.format)
    if form.layers and rng.random() < 0.5:
        layer = rng.choice(form.layers)
        try:
            files[chosen] = layer(original, rng, lambda content: _mutated(content, BYTES, rng, others)[0])
        except (ValueError, LookupError, RuntimeError, OSError, ArithmeticError) as error:
            raise AssertionError(f"{recipe}: {layer.__name__} fails") from error
    else:
        files[chosen], used = _mutated(original, form.mutations, rng, others)
        guarded = set(used) <= set(form.guarded)
    files[chosen] = files[chosen][:MOST_BYTES]
    return files, command, guarded


def _mutated(data, mutations, rng, others):
    """Return changed data, and the mutations."""
    used = [rng.choice(mutations) for _ in range(rng.choice((1, 1, 1, 2, 3)))]
    for mutate in used:
        data = mutate(data, rng, others) if data else data
    return data, used


def run(recipe):
    """Run the program on the input of a recipe and return the outcome."""
    return run_files(recipe, *make(recipe))


def run_files(recipe, files, command, guarded):
    """Run the program on an input and return the outcome; ``recipe`` names it and its format."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-")).resolve()
    places = {name: folder / name for name in ("IN", "OUT", "TMP")}
    try:
        for place in places.values():
            place.mkdir()
        for name, data in files.items():
            path = places["IN"] / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        words = [
            word.replace("IN/", f"{places['IN']}/").replace("OUT/", f"{places['OUT']}/") for word in command.split()
        ]
        result, seconds, peak = _measured(words, places["TMP"])
        outcome = _judge(recipe, command, result, places)
        outcome.text = result.stderr
        outcome.seconds, outcome.peak_mb = seconds, peak
        table = places["OUT"] / "frames.csv"
        if result.exit_code == 0 and command.startswith("filter") and table.exists():
            outcome.counts = _counts(table)
        if guarded and outcome.counts and "-m none" in command:
            expected, found = _honest_run(recipe.format, command).counts, outcome.counts
            if found[0] < expected[0] or found[1] < expected[1]:
                outcome.problems.append(f"exit status 0, but {found} frames and points of {expected}")
        return outcome
    finally:
        shutil.rmtree(folder)


def _measured(words, temporary):
    """Run the program; return its result, the time in seconds and the peak of memory in MB."""
    before, tempfile.tempdir = tempfile.tempdir, str(temporary)
    try:
        if CLEAR.exists():
            CLEAR.write_text("5")  # start a new peak
        began, used = time.perf_counter(), time.process_time()
        result = CliRunner().invoke(cli, words)
        # Other programs of the machine delay a run, but a run that only waits must not pass either.
        seconds = max(time.process_time() - used, (time.perf_counter() - began) / _MOST_DELAY)
    finally:
        tempfile.tempdir = before
    peak = None
    if CLEAR.exists():
        peak = int(STATUS.read_text().partition("VmHWM:")[2].split()[0]) / 1000
    return result, seconds, peak


def _judge(recipe, command, result, places):
    """Return the outcome of a run, with the problems that it has."""
    outcome = Outcome(str(recipe), result.exit_code, 0.0, None)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        outcome.traceback = "".join(traceback.format_exception(*result.exc_info))
        outcome.problems.append(f"traceback: {outcome.traceback.strip().splitlines()[-1]}")
        return outcome
    if "Traceback" in result.output:
        outcome.traceback = result.output
        outcome.problems.append("traceback in the output")
    outcome.problems += _wrong_status(recipe, command, result)
    left = _files(places["OUT"])
    if result.exit_code in (0, 3):
        expected = [word.partition("/")[2] for word in command.split() if word.startswith("OUT/")]
        outcome.problems += [
            f"output {name} is missing"
            for name in expected
            if not any(one == name or f"{name}/" in one for one in left)
        ]
        outcome.problems += [problem for name in left if (problem := _unreadable(places["OUT"] / name))]
        left = [name for name in left if name.endswith(".part")]
        if "--json" in command and not _is_json(result.stdout):
            outcome.problems.append("standard output is not JSON")
    left += _files(places["TMP"])
    if left:
        outcome.left = len(left)
        outcome.problems.append(f"files left with exit status {result.exit_code}: {', '.join(left)}")
    return outcome


def _wrong_status(recipe, command, result):
    """Yield what is wrong with an exit status and the messages beside it."""
    code, text = result.exit_code, result.stderr
    lines = text.splitlines()
    errors = [line for line in lines if line.startswith(("Error: ", "Usage: "))]
    damaged = [line for line in lines if line.startswith("Damaged: ")]
    unfit = any(reason in text for reason in ("several point-cloud topics", "no preset for the scene"))
    may_refuse = FORMATS[recipe.format].settings or unfit
    if code not in (0, 1, 2, 3) or (code == 2 and not may_refuse):
        yield f"exit status {code}: {text[-300:]}"
    if (code == 0 and (errors or damaged)) or (code == 3 and not damaged):
        yield f"exit status {code} with {len(errors)} errors and {len(damaged)} reports of damage: {text[-300:]}"
    if code in (1, 2) and not errors:
        yield f"exit status {code} without an error line: {result.output[-300:]}"
    elif code in (1, 2) and not command.startswith(_JOINT) and not any(name in text for name in _names(recipe)):
        yield f"the error names no input: {errors[0][:300]}"


def _is_json(text):
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def _names(recipe):
    """Return words of which an error contains one: names of files, folders or recordings."""
    return {part for name in honest(recipe.format) for part in (*Path(name).parts, Path(name).stem)}


def _files(folder):
    return [path.relative_to(folder).as_posix() for path in sorted(folder.rglob("*")) if path.is_file()]


def _read_mcap(path):
    with path.open("rb") as stream:
        for _ in NonSeekingReader(stream, validate_crcs=True).iter_messages():
            pass


def _read_bag(path):
    with Reader(path) as reader:
        for _ in reader.messages():
            pass


def _read_db3(path):
    with closing(sqlite3.connect(path)) as db:
        found = db.execute("PRAGMA integrity_check").fetchall()
        if found != [("ok",)]:
            raise ValueError(found)


LOGS = {".mcap": _read_mcap, ".bag": _read_bag, ".db3": _read_db3}


def _unreadable(path):
    """Return what is wrong with an output; None if it can be read."""
    try:
        if path.suffix in LOGS:
            LOGS[path.suffix](path)
        elif path.suffix in (".las", ".laz"):
            import laspy

            laspy.read(path)
        elif path.suffix in (".json", ".geojson"):
            json.loads(path.read_text(encoding="utf-8"))
        elif path.suffix == ".yaml":
            yaml.load(path.read_text(encoding="utf-8"), Loader=LOADER)
        elif path.suffix == ".csv":
            with path.open(encoding="utf-8", newline="") as stream:
                list(csv.reader(stream))
    except Exception as error:  # noqa: BLE001 - any error means that it cannot be read
        return f"output {path.name} cannot be read: {error!r}"
    return None


@cache
def _honest_run(name, command):
    """Return the outcome of a command on the honest input of a format."""
    return run_files(Recipe(name, 0, -1), honest(name), command, guarded=False)


def _counts(path):
    """Return the number of frames and points in a table of `filter`."""
    with path.open() as stream:
        rows = list(csv.DictReader(stream))
    return len(rows), sum(int(row["points_in"]) for row in rows)


def check_honest(name):
    """Assert that every command succeeds on the honest input of a format."""
    for command in dict.fromkeys(FORMATS[name].commands):
        outcome = _honest_run(name, command)
        assert not outcome.problems, (name, command, outcome)
        refused = outcome.code == 1 and "calibrate" in command  # it has no clutter
        assert outcome.code == 0 or refused, (name, command, outcome)
