"""One HTML file with everything in it: style, code and data. It loads nothing and needs no network."""

import base64
import hashlib
import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from seaclutter_cli.reporting.palette import INK

SCRIPTS = ("dom.js", "charts.js", "cloud.js", "page.js")
"""Parts of the page's code, in the order in which they run."""

_NO_OTHERS = "img-src data:; base-uri 'none'; form-action 'none'"


def render_page(data: Mapping[str, Any]) -> bytes:
    """Return the page.

    Names in logs may hold anything. All data stand in one JSON block in which no ``<`` occurs, so that nothing in it
    ends the block or begins another; the page's code writes them as text only. Whatever else there were, the page's
    policy allows this style and this code, known by their checksums, and no loading.
    """
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    style = _read("page.css") + _variables()
    script = "\n".join(_read(name) for name in SCRIPTS)
    policy = f"default-src 'none'; style-src '{_checksum(style)}'; script-src '{_checksum(script)}'; {_NO_OTHERS}"
    parts = {"POLICY": policy, "STYLE": style, "SCRIPT": script, "DATA": text}
    page = _read("page.html")
    for name, part in parts.items():
        before, mark, after = page.partition(f"%{name}%")
        page = before + part + after if mark else page
    return page.encode()


def _variables() -> str:
    return ":root{" + "".join(f"--{name}:{color};" for name, color in INK.items()) + "}"


def _checksum(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _read(name: str) -> str:
    return (files(__package__) / name).read_text(encoding="utf-8")
