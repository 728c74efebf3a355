"""The Foxglove layout refers to topics and fields of a filtered log."""

import json
import re

from mcap.reader import make_reader

from seaclutter_cli.frame import Reason
from seaclutter_cli.reporting import palette
from tests.paths import ROOT
from tests.running import execute
from tests.sinks.runs import decode

LAYOUT = json.loads((ROOT / "configs" / "foxglove" / "seaclutter.json").read_text(encoding="utf-8"))
SEA = ROOT / "samples" / "sea"


def panels(tree):
    return [tree] if isinstance(tree, str) else panels(tree["first"]) + panels(tree["second"])


def test_every_panel_is_configured():
    assert sorted(panels(LAYOUT["layout"])) == sorted(LAYOUT["configById"])
    assert {name.partition("!")[0] for name in LAYOUT["configById"]} == {"3D", "Plot"}


def test_topics_and_fields_are_in_a_filtered_log(tmp_path):
    path = tmp_path / "f.mcap"
    words = ["filter", SEA.with_suffix(".mcap"), "-o", path, "-n", 2, "--keep-raw", "--with-removed", "--with-scene"]
    words += ["--labels", SEA.with_suffix(".labels.csv")]
    execute(*words, code=0)
    with path.open("rb") as stream:
        found = {
            channel.topic: (schema, message.data) for schema, channel, message in make_reader(stream).iter_messages()
        }
    for panel in LAYOUT["configById"].values():
        for topic, settings in panel.get("topics", {}).items():
            assert topic in found
            if "colorField" in settings:
                assert settings["colorField"] in {field[0] for field in decode(found[topic][1]).fields}
        for line in panel.get("paths", ()):
            topic, field = re.fullmatch(r"(/[\w/]+)\.(\w+)(?:\[\d\])?", line["value"]).groups()
            assert re.search(rf"\b{field}$", found[topic][0].data.decode(), re.MULTILINE)


def test_curves_have_the_colours_of_reports():
    counts = {line["label"]: line["color"] for line in LAYOUT["configById"]["Plot!counts"]["paths"]}
    assert counts == {name: palette.REASONS[Reason[name.upper().replace(" ", "_")]] for name in counts}
    thresholds = [line["color"] for line in LAYOUT["configById"]["Plot!thresholds"]["paths"]]
    assert thresholds == list(palette.LINES[:4])
