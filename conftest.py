"""Environment of the doctests, and the option ``--quick``."""

import gc
import os
from pathlib import Path
from time import perf_counter

import pytest
from _pytest.doctest import DoctestModule

QUICK_S = 0.1
QUICK_TOTAL_S = 20
STARTED_S = perf_counter()
SECONDS = "seaclutter/seconds"
"""Key in the cache of pytest: how long each test, and each fixture of a test file, took in the last full run."""


def pytest_addoption(parser):
    """Add the option."""
    text = f"Run the first case of each test only, and none that took longer than {QUICK_S} s in the last full run."
    parser.addoption("--quick", action="store_true", help=text)


def pytest_configure(config):
    """Record times in full runs."""
    if hasattr(config, "cache") and not config.getoption("quick"):
        config.pluginmanager.register(_Clock(config))


def pytest_collection_modifyitems(config, items):
    """Select the tests of a quick run."""
    if not config.getoption("quick"):
        return
    seconds = config.cache.get(SECONDS, {}) if hasattr(config, "cache") else {}
    chosen, others = {}, []
    for item in items:
        file, test = item.nodeid.partition("::")[0], item.nodeid.partition("[")[0]
        names = [item.nodeid, *(f"{file}::{name}" for name in getattr(item, "fixturenames", ()))]
        long = item.get_closest_marker("slow") or any(seconds.get(name, 0) > QUICK_S for name in names)
        if long or test in chosen:
            others.append(item)
        else:
            chosen[test] = item
    items[:] = chosen.values()
    config.hook.pytest_deselected(items=others)


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(file_path):
    """Search for doctests only in files that have some."""
    found = yield
    return [one for one in found if not isinstance(one, DoctestModule) or ">>>" in file_path.read_text("utf-8")]


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Let no garbage collection go through the modules and the thousands of tests, now or later: they stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_runtest_setup(item):
    """Bound the time of a quick run, also without the times of a full run: skip what does not fit."""
    if item.config.getoption("quick") and perf_counter() - STARTED_S > QUICK_TOTAL_S:
        pytest.skip("no time left in a quick run")


class _Clock:
    """Records how long tests and fixtures take. The processes of pytest-xdist report to the one that started them."""

    def __init__(self, config):
        self._config, self._seconds = config, {}

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef):
        begin = perf_counter()
        result = yield
        file = os.environ["PYTEST_CURRENT_TEST"].partition("::")[0]
        self._record(f"{file}::{fixturedef.argname}", perf_counter() - begin)
        return result

    def pytest_runtest_logreport(self, report):
        if report.when == "call":
            self._record(report.nodeid, report.duration)

    def _record(self, name, seconds):
        self._seconds[name] = max(round(seconds, 2), self._seconds.get(name, 0))

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node):
        for name, seconds in getattr(node, "workeroutput", {}).get(SECONDS, {}).items():
            self._record(name, seconds)

    def pytest_sessionfinish(self):
        if hasattr(self._config, "workeroutput"):
            self._config.workeroutput[SECONDS] = self._seconds
        else:
            self._config.cache.set(SECONDS, self._config.cache.get(SECONDS, {}) | self._seconds)


@pytest.fixture
def doctest_namespace(monkeypatch, tmp_path_factory):
    """Run a doctest in the checkout, with a folder for its files."""
    monkeypatch.chdir(Path(__file__).parent)
    return {"folder": tmp_path_factory.mktemp("example")}
