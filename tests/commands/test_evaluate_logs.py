"""`seaclutter evaluate` on logs that are filtered already, or cannot be read."""

from click.testing import CliRunner

from seaclutter_cli.commands import cli
from tests.paths import ROOT


def test_thresholds_are_not_checked_on_a_log_that_is_already_filtered(tmp_path):
    log, labels = (ROOT / "samples" / name for name in ("sea.mcap", "sea.labels.csv"))
    runner = CliRunner()
    assert runner.invoke(cli, ["filter", str(log), "-o", str(tmp_path / "a.mcap")]).exit_code == 0
    evaluated = runner.invoke(cli, ["evaluate", str(tmp_path / "a.mcap"), "--labels", str(labels)])
    again = runner.invoke(cli, ["filter", str(tmp_path / "a.mcap"), "-o", str(tmp_path / "b.mcap")])
    for result in (evaluated, again):
        assert "already filtered by joint" in result.stderr
        assert "threshold" not in result.stderr


def test_the_title_says_how_many_recordings_were_read(tmp_path):
    (tmp_path / "broken.mcap").write_text("broken")
    labels = str(ROOT / "samples" / "sea.labels.csv")
    logs = [str(ROOT / "samples" / "sea.mcap"), str(tmp_path / "broken.mcap")]
    result = CliRunner().invoke(cli, ["evaluate", *logs, "--labels", labels, "--labels", labels, "-n", "2"])
    assert result.stdout.startswith("1 of 2 recordings; 2 labelled frames")
