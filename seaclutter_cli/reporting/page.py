"""Self-contained HTML page with style, code and data, which loads nothing and needs no network."""

import base64
import hashlib
import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from seaclutter_cli.reporting.palette import INK

SCRIPTS = ("dom.js", "charts.js", "cloud.js", "page.js")
"""JavaScript files of the page, in order of execution."""

_OTHER_SOURCES = "img-src data:; base-uri 'none'; form-action 'none'"


def render_page(data: Mapping[str, Any]) -> bytes:
    """Return the HTML page for the data of a report, as UTF-8.

    Names in logs are untrusted. All data are in one JSON block without any ``<``, so no name can end the block or start
    another element, and the page's code inserts names as text only. In addition, the content security policy allows
    only this style and this code, identified by their hashes, and no loading of resources.
    """
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    style = _read("page.css") + _variables()
    script = "\n".join(_read(name) for name in SCRIPTS)
    policy = f"default-src 'none'; style-src '{_hash(style)}'; script-src '{_hash(script)}'; {_OTHER_SOURCES}"
    parts = {"POLICY": policy, "STYLE": style, "SCRIPT": script, "DATA": text}
    page = _read("page.html")
    for name, part in parts.items():
        before, mark, after = page.partition(f"%{name}%")
        page = before + part + after if mark else page
    return page.encode()


def _variables() -> str:
    return ":root{" + "".join(f"--{name}:{color};" for name, color in INK.items()) + "}"


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _read(name: str) -> str:
    return (files(__package__) / name).read_text(encoding="utf-8")
