"""Thousands of recordings: looks at files and memory per recording. `docs/benchmarks.md` has figures of 10,000."""

import gc
import os
import shutil
import tracemalloc

import pytest

from seaclutter_cli.runs.filter import filter_log, filter_run
from seaclutter_cli.runs.observer import SILENT, Silent
from seaclutter_cli.runs.options.logs import FilterOptions
from tests.logs import cloud_log

FEW, MANY = 10, 40


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with many small recordings in subfolders ``few`` and ``many``."""
    top = tmp_path_factory.mktemp("trial")
    first = cloud_log(top / "first.mcap", frames=2, points=30)
    for name, count in (("few", FEW), ("many", MANY)):
        (top / name).mkdir()
        for number in range(count):
            shutil.copy(first, top / name / f"r{number:05}.mcap")
    return top


def looks(folder, monkeypatch):
    """Return how often the plan of a run looks at a file."""
    count = 0

    def counted(function):
        def look(*arguments, **options):
            nonlocal count
            count += 1
            return function(*arguments, **options)

        return look

    with monkeypatch.context() as patch:
        for name in ("stat", "lstat"):
            patch.setattr(os, name, counted(getattr(os, name)))
        plan = filter_run(FilterOptions(str(folder), f"{folder.parent / 'out'}/"), SILENT)
        plan.prepare(dry=True)
    return count


def test_a_plan_looks_at_each_file_a_few_times(folder, monkeypatch):
    """On a network, each look takes a millisecond or so."""
    few, many = (looks(folder / name, monkeypatch) for name in ("few", "many"))
    assert 0 < (many - few) / (MANY - FEW) <= 10


class Memory(Silent):
    """Observer of the memory in use after each recording."""

    def __init__(self):
        self.sizes = []

    def done(self, line, damage, error):
        gc.collect()
        self.sizes.append(tracemalloc.get_traced_memory()[0])


def test_little_is_kept_of_a_recording(folder, tmp_path):
    memory, some = Memory(), str(folder / "many" / "r000[01]*")
    gc.freeze()  # what other tests left need not be looked through twenty times
    tracemalloc.start()
    try:
        filter_log(some, f"{tmp_path}/", csv_file=tmp_path / "frames.csv", observer=memory, keep_going=True)
    finally:
        tracemalloc.stop()
        gc.unfreeze()
    assert len(memory.sizes) == 2 * FEW
    assert (memory.sizes[-1] - memory.sizes[FEW]) / (FEW - 1) < 4000
