"""Logs on web servers, which have files and ranges of them, but no listings and no outputs."""

import re
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest

import seaclutter
from seaclutter_cli.errors import UsageError
from seaclutter_cli.urls import Url, parse_url
from tests.paths import ROOT
from tests.running import execute

pytest.importorskip("obstore")
SAMPLE = ROOT / "samples" / "sea.mcap"


class Handler(SimpleHTTPRequestHandler):
    """Files of a folder; ranges of them unless they are below a folder that a server does not cut."""

    def send_head(self):
        name = unquote(self.path).lstrip("/")
        file, wanted = Path(self.directory, name), re.match(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        if wanted is None or not file.is_file() or name.startswith("whole"):
            return super().send_head()
        start, stop = int(wanted[1]), min(int(wanted[2]) + 1, file.stat().st_size)
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {start}-{stop - 1}/{file.stat().st_size}")
        self.send_header("Content-Length", str(stop - start))
        self.send_header("ETag", 'W/"1"')
        self.end_headers()
        self.wfile.write(file.read_bytes()[start:stop])
        return None

    def log_message(self, *_):
        pass


@pytest.fixture
def web(tmp_path, scratch, monkeypatch):
    """Serve a folder with a log; return its URL and the folder."""
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    folder = tmp_path / "served"
    folder.mkdir()
    (folder / "run 1.mcap").write_bytes(SAMPLE.read_bytes())
    (folder / "whole.mcap").write_bytes(SAMPLE.read_bytes())
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=folder))
    threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def test_a_log_is_filtered_as_the_file_is(tmp_path, web):
    out = tmp_path / "out.mcap"
    execute("filter", f"{web}/run%201.mcap", "-n", "3", "-o", out)
    execute("filter", SAMPLE, "-n", "3", "-o", tmp_path / "right.mcap")
    found = [frame.xyz for frame in seaclutter.open_log(out).frames()]
    right = [frame.xyz for frame in seaclutter.open_log(tmp_path / "right.mcap").frames()]
    assert len(found) == 3
    for one, other in zip(found, right, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("info", "{}/none.mcap"), "/none.mcap: no such file; web servers list no folders, so name each file"),
        (("info", "{}/run*.mcap"), "web servers list no folders"),
        (("info", "{}"), "web servers list no folders"),
        (("info", "{}/whole.mcap"), "whole.mcap: the server sends no parts of files; download it first"),
        (("filter", str(SAMPLE), "-o", "{}/out.mcap"), "web servers take no outputs"),
        (("info", "{}/run%201.mcap?token"), "run%201.mcap: a URL must not contain a query"),
    ],
)
def test_what_a_server_cannot_is_one_line(web, words, problem):
    result = execute(*(word.format(web) for word in words), code=None)
    assert result.exit_code in (1, 2)
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("Error")]
    assert problem in line


def test_urls_of_files():
    assert parse_url("https://host:8000/a%20b/log.mcap") == Url("https", "host:8000", "a b/log.mcap")
    with pytest.raises(UsageError, match="https://HOST/NAME"):
        parse_url("https://-/log.mcap")
