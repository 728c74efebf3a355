"""Text output, and texts from outside."""

from pathlib import Path
from typing import Annotated

import pytest
from annotated_types import Ge, Interval

from seaclutter_cli.commands.options import _effective
from seaclutter_cli.commands.printer import _presentable
from seaclutter_cli.paths import Identities
from seaclutter_cli.runs.options.logs import parse_seeds
from seaclutter_cli.selection import parse_moment
from seaclutter_cli.text import (
    count,
    data_size,
    duration,
    harmless,
    legend,
    listed,
    named_folder,
    printable,
    share,
    shortened,
    suggestion,
    table,
)
from seaclutter_cli.threads import in_threads
from seaclutter_cli.validation import _in_words, merged, yaml_value


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (printable("inten\nity, é"), r"inten\nity, é"),
        (shortened("/lidar/left/points", 9), "/lid…ints"),
        (suggestion("jiont", ["joint", "sor"]), "did you mean 'joint'? "),
        (suggestion("x", ["joint", "sor"]), ""),
        ((named_folder("filtered/"), named_folder("filtered.mcap")), (True, False)),
        (
            table(("range", "points"), [("10-25 m", 1200), ("25-40 m", 7)]),
            "range    points\n10-25 m    1200\n25-40 m       7",
        ),
        (
            legend({"F1": "harmonic mean", "R_c": "share of clutter"}),
            "F1   harmonic mean\nR_c  share of clutter",
        ),
        ((count(1, "point"), count(1200, "point"), count(2, "box")), ("1 point", "1,200 points", "2 boxes")),
        ((listed(["a", "b"]), listed(["a", "b", "c", "d", "e"])), ("a, b", "a, b, c and 2 more")),
        ((duration(7261), duration(61.4), duration(0.25)), ("2 h 1 min", "1 min 1 s", "0.2 s")),
        ((data_size(999), data_size(1_500_000), data_size(41e9)), ("999 B", "1.5 MB", "41 GB")),
        ((share(1, 8), share(0, 0)), ("12.5 %", "–")),
        (_presentable("a\x1b[31mb"), r"a\x1b[31mb"),
        (len(_presentable("x" * 1_000_000)), 200),
        (_effective(["report", "a.mcap", "-o", "a.html", "--force"]), ["report", "a.mcap", "-o", "OUT"]),
        (_effective(["--output=a.html", "-oa.html"]), ["--output=OUT", "-oOUT"]),
        (Identities()(Path("samples/../samples/sea.mcap")), Path("samples/sea.mcap").resolve()),
        ((parse_seeds("1..4,9"), parse_seeds("7-8")), ((1, 2, 3, 4, 9), (7, 8))),
        (parse_moment("12.5"), 12.5),
        (parse_moment("2026-05-01T12:00:00+02:00"), parse_moment("1777629600")),
        (in_threads(len, ["sea", "clutter"]), [3, 7]),
        (merged({"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"b": 4}}), {"a": {"b": 4, "c": 2}, "d": 3}),
        (_in_words(Annotated[int, Ge(1)] | None), "a whole number greater than or equal to 1 or null"),
        (
            _in_words(Annotated[float, Interval(gt=0, le=1)]),
            "a number greater than 0 and less than or equal to 1",
        ),
        (yaml_value([1, None, "a: b"]), "[1, null, 'a: b']"),
        ([harmless(value) for value in ("-1.190", "-2e-05", "+.5", -3)], ["-1.190", "-2e-05", "+.5", -3]),
        ([harmless(value) for value in ("-1+1", "-", "=2", "@a")], ["'-1+1", "'-", "'=2", "'@a"]),
    ],
)
def test_texts(found, expected):
    assert found == expected
