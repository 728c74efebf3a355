"""Tasks on workers: the same as in processes of this machine, whatever happens to workers."""

import os
import threading
import time
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from pathlib import Path

import pytest

from seaclutter_cli.errors import ClusterError, InputError
from seaclutter_cli.jobs.cluster.connection import connection_to
from seaclutter_cli.jobs.cluster.engine import Cluster
from seaclutter_cli.jobs.engine import Lost
from tests.jobs.cluster.clusters import wait_for
from tests.jobs.work import Ask, Fail, Kill, Meet, Square, Unsendable


@dataclass(frozen=True)
class Allow:
    """Check of a worker."""

    refused: str | None = None

    def __call__(self, report):
        return self.refused


@dataclass(frozen=True)
class Touch:
    """Make a file with a relative path."""

    path: Path

    def __call__(self, report):
        self.path.touch()
        return Path.cwd()


@dataclass(frozen=True)
class Long:
    """Report without end, and leave a mark when interrupted, as a run that removes its incomplete files."""

    started: Path
    ended: Path

    def __call__(self, report):
        self.started.touch()
        try:
            while True:
                report(0.5)
        finally:
            self.ended.touch()


@dataclass(frozen=True)
class Times:
    """Return the beginning and the end of the task on the clock of the machine."""

    def __call__(self, report):
        begin = time.monotonic()
        time.sleep(0.05)
        return begin, time.monotonic()


def engine(cluster, warnings=None, check=None, limit=None):
    warn = (warnings if warnings is not None else []).append
    return Cluster(connection_to(cluster.address), check or Allow(), warn, limit)


def run(engine, tasks):
    return dict(engine(tasks, lambda *_: None))


def test_results_by_number(certified):
    assert run(engine(certified), [Square(k) for k in range(30)]) == {k: k * k for k in range(30)}


def test_no_tasks(certified):
    assert run(engine(certified), []) == {}


def test_shares_are_reported(certified):
    shares = []
    list(engine(certified)([Square(k, wait_s=0.3) for k in range(3)], lambda *share: shares.append(share)))
    assert (0, 0.5) in shares


@pytest.mark.parametrize("error", [InputError, ZeroDivisionError])
def test_an_error_ends_the_run(certified, error):
    with pytest.raises(error, match="no such sea"):
        run(engine(certified), [Square(1), Fail(error), *(Square(k) for k in range(50))])


def test_a_result_that_cannot_be_sent_is_an_error(certified):
    with pytest.raises(Exception, match="pickle"):
        run(engine(certified), [Square(1), Unsendable()])


def test_a_scheduler_that_is_lost_while_a_result_is_fetched(certified, monkeypatch):
    """The connection that fetches results may end before the one that says so."""
    distributed = pytest.importorskip("distributed")

    async def gather(*_, **__):
        raise distributed.comm.CommClosedError("Stream is closed")

    monkeypatch.setattr(distributed.Client, "gather", gather)
    with pytest.raises(ClusterError, match="the connection to the scheduler is lost"):
        run(engine(certified), [Square(1)])


def test_relative_paths_are_those_of_the_run(certified, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(engine(certified), [Touch(Path("here"))]) == {0: tmp_path}
    assert (tmp_path / "here").exists()


def test_threads_are_those_of_the_worker(certified):
    done = run(engine(certified), [Ask()] * 6)
    assert {threads for threads, _ in done.values()} == {1}
    assert os.getpid() not in {pid for _, pid in done.values()}


def test_a_limit_of_workers(certified):
    times = sorted(run(engine(certified, limit=1), [Times()] * 6).values())
    assert all(end <= begin for (_, end), (begin, _) in pairwise(times))


def test_the_scheduler_never_has_more_tasks_than_workers(certified):
    with certified.client() as client:
        results = engine(certified)([Square(k) for k in range(40)], lambda *_: None)
        assert max(client.run_on_scheduler(count_tasks) for _ in results) <= 3


def test_a_task_does_not_overtake_the_release_of_the_one_before(certified, monkeypatch):
    """Even if the client is busy when it releases a task, and the next is submitted meanwhile."""
    client = pytest.importorskip("distributed").Client
    count, send, sent = client._dec_ref, client._send_to_scheduler_safe, []

    def count_late(self, key):
        time.sleep(0.02)
        count(self, key)

    def record(self, message):
        sent.append({"update-graph": 1, "client-releases-keys": -1}.get(message["op"], 0))
        send(self, message)

    monkeypatch.setattr(client, "_dec_ref", count_late)
    monkeypatch.setattr(client, "_send_to_scheduler_safe", record)
    run(engine(certified), [Square(k) for k in range(20)])
    assert sent.count(1) >= 20
    assert max(accumulate(sent)) <= 3


def count_tasks(dask_scheduler):
    return len(dask_scheduler.tasks)


def test_a_worker_that_dies_costs_one_retry(certified, tmp_path):
    tasks = [Square(3), Kill(tmp_path, times=1), Square(4)]
    assert run(engine(certified), tasks) == {0: 9, 1: "survived", 2: 16}


def test_a_task_that_kills_its_workers_is_lost_alone(certified, tmp_path):
    tasks = [Kill(tmp_path, times=9), *(Square(k, wait_s=0.1) for k in range(1, 20))]
    done = run(engine(certified), tasks)
    lost = done.pop(0)
    assert isinstance(lost, Lost)
    assert lost.reason == "its worker died, perhaps because memory ran out, 2 times"
    assert done == {k: k * k for k in range(1, 20)}
    assert len(list(tmp_path.iterdir())) == 2


def test_closing_interrupts_what_runs(certified, tmp_path):
    started, ended = tmp_path / "started", tmp_path / "ended"
    with closing(engine(certified)([Long(started, ended), Square(1, wait_s=0.5)], lambda *_: None)) as results:
        assert next(results) == (1, 1)
        wait_for(started.exists)
    assert ended.exists()


def test_a_worker_without_the_files_is_refused(certified):
    with pytest.raises(ClusterError, match=r"worker tls://\S+ cannot see /mnt/nas"):
        run(engine(certified, check=Allow("cannot see /mnt/nas")), [Square(1)])


def test_workers_that_come_later_are_used(own_cluster, tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    tasks = [Meet(own=one, other=other), Meet(own=other, other=one)]
    own_cluster.add("first", "--no-nanny")
    with doing(lambda: (wait_for(lambda: one.exists() or other.exists()), own_cluster.add("second", "--no-nanny"))):
        assert run(engine(own_cluster), tasks) == {0: True, 1: True}


def test_workers_that_come_later_with_other_versions_are_left_out(own_cluster, other_version, tmp_path):
    begun, warned, warnings = tmp_path / "begun", tmp_path / "warned", []

    def add_and_wait():
        wait_for(begun.exists)
        own_cluster.add("old", "--no-nanny", PYTHONPATH=other_version("scipy", "0.0.1"))
        wait_for(lambda: warnings)
        warned.touch()

    own_cluster.add("first", "--no-nanny")
    with doing(add_and_wait):
        assert run(engine(own_cluster, warnings), [Meet(own=begun, other=warned), Square(3)]) == {0: True, 1: 9}
    assert len(warnings) == 1
    assert "is left out: it has scipy 0.0.1, here " in warnings[0]


def test_no_workers_for_too_long(own_cluster, monkeypatch):
    warnings = []
    monkeypatch.setattr("seaclutter_cli.jobs.cluster.engine._WARN_S", 0.5)
    place = replace(connection_to(own_cluster.address), patience_s=2.0)
    with pytest.raises(ClusterError, match="there has been no worker for "):
        run(Cluster(place, Allow(), warnings.append), [Square(1)])
    assert warnings == [f"{own_cluster.address}: no workers yet; the run waits for them"]


@contextmanager
def doing(work):
    """Do something in another thread."""
    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        thread.join()
