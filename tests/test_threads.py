"""Threads that a process may use, and memory that it keeps from frame to frame."""

import os
import threading

import numpy as np
import pytest

from seaclutter_cli import threads as module
from seaclutter_cli.errors import UsageError
from seaclutter_cli.threads import abandoned, cores, executor, in_order, keep_freed_memory, threads


def test_all_cores_by_default(monkeypatch):
    monkeypatch.delenv("SEACLUTTER_THREADS", raising=False)
    assert threads() == cores() >= 1
    if hasattr(os, "sched_getaffinity"):
        assert cores() <= len(os.sched_getaffinity(0))


def test_the_environment_sets_it(monkeypatch):
    monkeypatch.setenv("SEACLUTTER_THREADS", "3")
    assert threads() == 3


@pytest.mark.parametrize("text", ["0", "-1", "", "two", "1.5", "99999", "²"])
def test_other_texts_are_refused(monkeypatch, text):
    monkeypatch.setenv("SEACLUTTER_THREADS", text)
    with pytest.raises(UsageError, match="SEACLUTTER_THREADS: expected a positive whole number"):
        threads()


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("150000 100000\n", 2),
        ("50000 100000\n", 1),
        ("9999900000 100000\n", 64),
        ("max 100000\n", 64),
        ("", 64),
        (None, 64),
    ],
)
def test_the_limit_of_a_container_counts(content, expected, tmp_path, monkeypatch):
    if content is not None:
        (tmp_path / "cpu.max").write_text(content)
    monkeypatch.setattr(module, "_QUOTA", tmp_path / "cpu.max")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)), raising=False)
    assert module.cores() == expected


@pytest.mark.parametrize(("count", "is_beside"), [("1", False), ("2", True)])
def test_one_thread_does_all_in_turn(count, is_beside, monkeypatch):
    monkeypatch.setenv("SEACLUTTER_THREADS", count)
    with executor(2, "test") as pool:
        assert (pool.submit(threading.get_ident).result() != threading.get_ident()) == is_beside
        assert list(pool.map(int, "123")) == [1, 2, 3]
        failed = pool.submit(int, "x")
    with pytest.raises(ValueError, match="x"):
        failed.result()


def test_the_end_of_a_generator_waits_for_no_work(monkeypatch):
    """Garbage collection may end it in a thread that starts, which other threads wait for."""
    monkeypatch.setenv("SEACLUTTER_THREADS", "2")
    begun, may_end, done = threading.Event(), threading.Event(), []

    def work(number):
        if number:
            begun.set()
            may_end.wait(5)
        done.append(number)
        return number

    results = in_order(work, 4, workers=1, ahead=3)
    assert next(results) == 0
    begun.wait()
    results.close()
    assert done == [0]
    may_end.set()


def test_work_that_was_abandoned_is_cancelled(monkeypatch):
    monkeypatch.setenv("SEACLUTTER_THREADS", "2")
    may_end = threading.Event()
    with abandoned(executor(1, "work")) as pool:
        running, waiting = pool.submit(may_end.wait, 5), pool.submit(int)
    assert waiting.cancelled()
    assert not running.done()
    may_end.set()
    assert running.result()


@pytest.mark.parametrize("error", [None, MemoryError])
def test_a_limited_address_space_is_no_error(error, monkeypatch):
    asked = []

    def empty(size, dtype):
        asked.append(size * np.dtype(dtype).itemsize)
        if error:
            raise error

    monkeypatch.setattr(np, "empty", empty)
    keep_freed_memory.cache_clear()
    keep_freed_memory()
    keep_freed_memory()
    (size,) = asked
    assert size >= 2**20
