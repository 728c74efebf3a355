"""Methods that are not built in, on a cluster."""

import os
import subprocess
import sys

from tests.jobs.cluster.clusters import ROOT
from tests.plugin_package import install
from tests.test_plugins import MINE

SEA = ROOT / "samples" / "sea.mcap"


def run(folder, site, *options):
    """Filter two recordings in a process of its own, with packages of a folder."""
    (folder / "logs").mkdir(exist_ok=True)
    for name in ("a", "b"):
        (folder / "logs" / f"{name}.mcap").write_bytes(SEA.read_bytes())
    line = [sys.executable, "-m", "seaclutter_cli", "filter", folder / "logs", "-o", f"{folder / 'out'}/", "--force"]
    environment = {**os.environ, "PYTHONPATH": f"{site}{os.pathsep}{ROOT}"}
    done = subprocess.run([*line, "-n", "5", *options], env=environment, capture_output=True, text=True, check=False)
    return done, {path.name: path.read_bytes() for path in (folder / "out").glob("*.mcap")}


def test_workers_use_plugins_and_files(own_cluster, tmp_path):
    site, mine = install(tmp_path / "site"), tmp_path / "mine.py"
    mine.write_text(MINE)
    own_cluster.add("without", "--no-nanny")
    done, _ = run(tmp_path, site, "-m", "above_water", "--cluster", own_cluster.address)
    assert "has no seaclutter-example, here 1.0" in done.stderr
    own_cluster.processes["without"].kill()
    own_cluster.processes["without"].wait()
    own_cluster.add("with", "--no-nanny", PYTHONPATH=str(site))
    for method in ("above_water", f"{mine}:Low"):
        here = run(tmp_path, site, "-m", method, "-j", "1")
        there = run(tmp_path, site, "-m", method, "--cluster", own_cluster.address)
        assert (here[0].returncode, there[0].returncode) == (0, 0), there[0].stderr
        assert here[1] == there[1]
        assert len(here[1]) == 2
