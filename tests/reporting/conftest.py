"""Fixtures that open report pages in a browser."""

import shutil

import pytest

from tests.reporting.pages import Visit

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="module")
def browser():
    driver = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip("Chromium is not installed")
    with driver.sync_playwright() as play:
        opened = play.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def visit(browser):
    opened = []

    def go(*arguments, **settings):
        opened.append(Visit(browser, *arguments, **settings))
        return opened[-1]

    yield go
    for one in opened:
        one.close()
