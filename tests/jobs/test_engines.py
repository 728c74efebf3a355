"""Engines: every task is done once, in any order, whatever happens to processes."""

import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from seaclutter_cli.errors import InputError
from seaclutter_cli.jobs.engine import Lost, run_in_turn
from seaclutter_cli.jobs.processes import run_in_processes
from seaclutter_cli.threads import cores
from tests.jobs.work import Ask, Blocked, Fail, Kill, Meet, Square, Unsendable, Variable, Wait

ENGINES = {
    "in turn": run_in_turn,
    "one process": partial(run_in_processes, 1),
    "three processes": partial(run_in_processes, 3),
}


@pytest.fixture(params=ENGINES.values(), ids=ENGINES.keys())
def engine(request):
    return request.param


def test_results_by_number(engine):
    done = dict(engine([Square(k) for k in range(7)], lambda *_: None))
    assert done == {k: k * k for k in range(7)}


def test_no_tasks(engine):
    assert list(engine([], lambda *_: None)) == []


def test_shares_are_reported(engine):
    shares = []
    list(engine([Square(1, wait_s=0.05), Square(2)], lambda *share: shares.append(share)))
    assert (0, 0.5) in shares


@pytest.mark.parametrize("error", [InputError, ZeroDivisionError])
def test_an_error_ends_the_run(engine, error):
    with pytest.raises(error, match="no such sea"):
        list(engine([Square(1), Fail(error), *(Square(k) for k in range(50))], lambda *_: None))


def test_tasks_run_at_the_same_time(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    tasks = [Meet(own=one, other=other), Meet(own=other, other=one)]
    assert dict(run_in_processes(2, tasks, lambda *_: None)) == {0: True, 1: True}


@pytest.mark.parametrize("value", ["one", "two"])
def test_processes_have_the_environment_of_the_run(value, monkeypatch):
    monkeypatch.setenv("SEACLUTTER_TEST", value)
    assert dict(run_in_processes(2, [Variable()] * 2, lambda *_: None)) == {0: value, 1: value}


@pytest.mark.skipif(sys.platform != "linux", reason="no server of forks")
def test_an_interrupt_of_all_processes_does_not_reach_those_that_import():
    """Ctrl-C reaches the whole group; the server of forks prints a traceback if it is interrupted while it imports."""
    assert dict(run_in_processes(1, [Blocked()], lambda *_: None)) == {0: {signal.SIGINT}}
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_a_result_that_cannot_be_sent_is_an_error():
    with pytest.raises(Exception, match="pickle"):
        list(run_in_processes(2, [Square(1), Unsendable()], lambda *_: None))


def test_processes_share_the_cores():
    done = [result for _, result in run_in_processes(2, [Ask()] * 4, lambda *_: None)]
    assert {threads for threads, _ in done} == {max(1, cores() // 2)}
    assert os.getpid() not in {pid for _, pid in done}


def test_a_budget_of_threads_holds_for_each_process(monkeypatch):
    monkeypatch.setenv("SEACLUTTER_THREADS", "1")
    assert {threads for _, (threads, _) in run_in_processes(1, [Ask()], lambda *_: None)} == {1}


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
class TestDeath:
    def test_a_process_that_dies_costs_one_retry(self, tmp_path):
        tasks = [Square(3), Kill(tmp_path, times=1), Square(4)]
        assert dict(run_in_processes(2, tasks, lambda *_: None)) == {0: 9, 1: "survived", 2: 16}

    def test_a_task_that_kills_its_processes_is_lost_alone(self, tmp_path):
        tasks = [Square(3), Kill(tmp_path, times=9), Square(4)]
        done = dict(run_in_processes(2, tasks, lambda *_: None))
        assert isinstance(done[1], Lost)
        assert "SIGKILL" in done[1].reason
        assert "2 times" in done[1].reason
        assert (done[0], done[2]) == (9, 16)
        assert len(list(tmp_path.iterdir())) == 2

    def test_closing_interrupts_what_runs(self, tmp_path):
        started, ended = tmp_path / "started", tmp_path / "ended"
        with closing(run_in_processes(2, [Wait(started, ended), Square(1, wait_s=0.3)], lambda *_: None)) as results:
            while not started.exists():
                assert next(results) == (1, 1)
        assert ended.exists()

    def test_processes_end_when_the_first_one_is_killed(self, tmp_path):
        script = f"""
import pathlib
from seaclutter_cli.jobs.processes import run_in_processes
from tests.jobs.work import Ask, Square
if __name__ == "__main__":
    for _, result in run_in_processes(1, [Ask(), Square(1, wait_s=1.0), Square(2)], lambda *_: None):
        pathlib.Path({str(tmp_path / "pid")!r}).write_text(str(result[1]))
        input()
"""
        path = tmp_path / "script.py"
        path.write_text(script)
        environment = {**os.environ, "PYTHONPATH": str(Path.cwd())}
        first = subprocess.Popen([sys.executable, path], stdin=subprocess.PIPE, env=environment)
        try:
            until = time.monotonic() + 30
            while not (tmp_path / "pid").exists() and time.monotonic() < until:
                time.sleep(0.05)
            time.sleep(0.1)
            worker = int((tmp_path / "pid").read_text())
        finally:
            first.send_signal(signal.SIGKILL)
            first.wait()
        while time.monotonic() < until:
            try:
                os.kill(worker, 0)
            except ProcessLookupError:
                return
            time.sleep(0.1)
        pytest.fail("the process is still there")
