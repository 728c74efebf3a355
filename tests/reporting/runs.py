"""Helpers that make reports and read the data in their pages."""

import base64
import json
import re

import numpy as np

from tests.commands.test_evaluate import LABELLED, POINT, lump, make_labels, make_log, sea
from tests.running import execute

__all__ = ["LABELLED", "POINT", "lump", "make_labels", "make_log", "sea"]

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>&amp;'\"%DATA%"


def report(*arguments, status=0):
    """Run ``seaclutter report`` and return the result."""
    return execute("report", *arguments, code=status)


def data_of(page):
    """Return the JSON data in a page."""
    text = page.read_text(encoding="utf-8")
    found = re.findall(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert len(found) == 1
    return json.loads(found[0])


def unpacked(text, dtype):
    return np.frombuffer(base64.b64decode(text), np.dtype(dtype))
