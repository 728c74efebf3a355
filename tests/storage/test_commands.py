"""Commands on logs, labels, configurations and outputs in object storage."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time

import pytest

import seaclutter
from seaclutter_cli.buckets import on_paths, shown
from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.options import OfLogs
from seaclutter_cli.runs.recordings import _files_of, expand
from tests.paths import ROOT
from tests.running import execute
from tests.storage.buckets import get, names, put
from tests.storage.proxy import Action

FIGURES = {f"f/{name}.svg" for name in ("corrections", "intensity", "reasons", "stages", "thresholds")}
SEA, LABELS = ROOT / "samples" / "sea.mcap", ROOT / "samples" / "sea.labels.csv"


@pytest.fixture
def logs(bucket, scratch, tmp_path, monkeypatch):
    """Return the URL of a folder with a log, its labels and a configuration; the scratch folder is empty at the end."""
    monkeypatch.chdir(tmp_path)
    folder = bucket / "in"
    put(folder / "sea.mcap", SEA.read_bytes())
    put(folder / "sea.labels.csv", LABELS.read_bytes())
    put(folder / "config.yaml", b"filter: {method: joint, start_m: 12}\n")
    return folder


def run(line):
    return execute(*shlex.split(line))


def done(line):
    result = run(line)
    assert result.exit_code == 0, result.output
    assert ".part" not in result.output
    return result


def _placeless(content, folder):
    """Return the content of a file without the places of inputs, which reports name."""
    return content.replace(f"{folder}/sea.mcap".encode(), b"sea.mcap") if content.startswith(b"<!doctype") else content


@pytest.mark.parametrize(
    ("line", "outputs"),
    [
        ("filter {0}/sea.mcap -n 5 -c {0}/config.yaml -o {1}/f.mcap --csv {1}/f.csv", {"f.mcap", "f.csv"}),
        ("filter {0}/sea.mcap -n 2 --with-scene --labels {0}/sea.labels.csv -o {1}/f/", {"f/sea.mcap"}),
        ("evaluate {0} --labels {0}/ -n 6 -o {1}/e.csv --summary {1}/e.json", {"e.csv", "e.json"}),
        (
            "calibrate {0}/*.mcap --labels {0}/sea.labels.csv -n 6 -o {1}/c.yaml --plot {1}/c.svg",
            {"c.yaml", "c.svg"},
        ),
        (
            (
                "tune {0}/sea.mcap --labels {0} -n 6 --sweep update_weight=0.2,1"
                " -o {1}/t.yaml --csv {1}/t.csv --plot {1}/t.svg"
            ),
            {"t.yaml", "t.csv", "t.svg"},
        ),
        ("report {0}/sea.mcap -n 3 -o {1}/r.html --figures {1}/f", {"r.html", *FIGURES}),
    ],
)
def test_the_same_files_as_here(logs, tmp_path, line, outputs):
    for file in (SEA, LABELS):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "config.yaml").write_bytes(get(logs / "config.yaml"))
    for folder in ("out", "out/f"):
        (tmp_path / folder).mkdir()
    pytest.importorskip("matplotlib")
    out = logs.parent / "out"
    here, there = done(line.format(".", "out")), done(line.format(logs, out))
    assert set(names(out)) == outputs
    for name in outputs - {"e.json"}:  # it contains times of processing
        assert _placeless(get(out / name), logs) == _placeless((tmp_path / "out" / name).read_bytes(), "."), name
    assert there.stdout.count("\n") == here.stdout.count("\n")
    # An existing object is only replaced on request.
    assert "already exists; use --force" in run(line.format(logs, out)).stderr
    done(f"{line.format(logs, logs / 'out')} --force")


def test_names_and_errors_show_urls(logs):
    result = done(f"filter {logs}/sea.mcap -n 2 -o {logs}/f.mcap")
    assert result.stdout.startswith(f"sea -> {logs}/f.mcap\n")
    put(logs / "bad/bad.mcap", b"nothing")
    result = run(f"filter {logs}/bad/bad.mcap -o out.mcap")
    assert result.exit_code == 1
    assert result.stderr == f"Error: {logs}/bad/bad.mcap: no readable record in this MCAP file\n" or (
        f"{logs}/bad/bad.mcap: " in result.stderr
    )
    data = SEA.read_bytes()
    put(logs / "bad/cut.mcap", data[: len(data) // 2])
    result = run(f"filter {logs}/bad/cut.mcap -o out.mcap --json")
    assert result.exit_code == 3
    assert f"Damaged: {logs}/bad/cut.mcap: byte " in result.stderr
    assert all(text.startswith(f"{logs}/bad/cut.mcap: byte ") for text in json.loads(result.stdout)[0]["damage"])
    put(logs / "bad/bad.labels.csv", b"frame,x\n0,1\n")
    result = run(f"evaluate {logs}/sea.mcap --labels {logs}/bad/bad.labels.csv")
    assert f"Error: {logs}/bad/bad.labels.csv: " in result.stderr
    put(logs / "bad/bad.yaml", b"filter: {start: 1}\n")
    result = run(f"filter {logs}/sea.mcap -c {logs}/bad/bad.yaml -o out.mcap")
    assert result.exit_code == 2
    assert f"Error: {logs}/bad/bad.yaml: filter.start: unknown key" in result.stderr


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("filter {0}/none.mcap -o out.mcap", "/none.mcap: no such object or folder"),
        ("filter {0}/*.bag -o out.mcap", "/*.bag: no file matches this pattern"),
        ("filter {0}/none/*.bag -o out.mcap", "/none/*.bag: no file matches this pattern"),
        ("filter {0}/sea.mcap -c {0}/none.yaml -o out.mcap", "/none.yaml: no such object"),
        ("evaluate {0}/sea.mcap --labels {0}/none.csv", "/none.csv: no such file or folder of labels"),
        ("filter {0}/sea.mcap -o {0}/sea.mcap --force", "is part of the input, LOGS"),
        ("filter {0}/sea.mcap -c {0}/config.yaml -o {0}/config.yaml --force", "is part of the input, -c"),
        ("evaluate {0}/sea.mcap --labels {0} -o {0}/sea.labels.csv --force", "is part of the input, --labels"),
        ("filter {0}/sea.mcap -o {0}/f --csv {0}/f", "/f: is given for two outputs, -o and --csv"),
        ("filter {0}/sea.mcap -o {0}/f/a.mcap --csv {0}/f", "/f: is given for a file, --csv, and a folder, -o"),
        ("filter {0}/sea.mcap -o s3://not-there/f.mcap", "there is no bucket not-there"),
        ("filter s3://not-there/sea.mcap -o f.mcap", "there is no bucket not-there"),
        ("filter {0}/sea.mcap -o out.mcap --csv {0}/table/", "names a folder by the slash at its end"),
        ("filter {0}/sea.mcap -o out.mcap --calibration {0}/x", "--calibration takes a local path"),
        ("simulate calm -o {0}/calm.mcap", "-o takes a local path"),
        ("filter ftp://host/sea.mcap -o f.mcap", "unknown kind of URL"),
        ("filter s3://KEY:SECRET@trial/sea.mcap -o f.mcap", "must not contain credentials"),
        ("filter {0}/sea.mcap -o 'https://host/f.mcap?X-Amz-Signature=SECRET'", "must not contain credentials"),
    ],
)
def test_errors_are_one_line(logs, tmp_path, line, problem):
    before = names(logs)
    result = run(line.format(logs))
    assert result.exit_code in (1, 2)
    assert problem in result.stderr
    assert result.stderr.count("\n") == 1
    assert "SECRET" not in result.output
    assert names(logs) == before
    assert not list(tmp_path.glob("*.mcap"))


def test_a_folder_of_two_hundred_logs(logs, scratch, tmp_path):
    done(f"filter {SEA} -m none -n 2 --no-diagnostics -o small.mcap")
    data = (tmp_path / "small.mcap").read_bytes()
    for number in range(200):
        put(logs / f"many/log{number:03}.mcap", data)
    result = done(f"filter {logs}/many/ -n 1 -o {logs}/out/ -q --json --csv {logs}/out.csv")
    assert len(json.loads(result.stdout)) == 200
    assert names(logs / "out") == [f"log{number:03}.mcap" for number in range(200)]
    assert get(logs / "out.csv").count(b"\n") == 201


def test_split_and_folder_recordings(logs, tmp_path):
    data = SEA.read_bytes()
    for name in ("split/day_0.mcap", "split/day_1.mcap", "bag/bag_0.mcap", "bag/bag_1.mcap"):
        put(logs / name, data)
    put(logs / "frames/000.csv", b"x,y,z,intensity\n1,2,3,4\n")
    put(logs / "frames/001.csv", b"x,y,z,intensity\n1,2,3,4\n")
    put(logs / "marked", b"")
    separate = run(f"filter {logs}/split -m none -n 1 -o out/")
    assert separate.exit_code == 1
    assert f"{logs}/split/day_0.mcap to day_1.mcap are 2 recordings" in separate.stderr
    assert "--no-join" in separate.stderr
    result = done(f"filter {logs}/split {logs}/bag {logs}/frames -m none -n 1 -o out/ --json --join")
    assert [one["recording"] for one in json.loads(result.stdout)] == ["day", "bag", "frames"]


def test_local_files_need_nothing_of_object_storage(tmp_path):
    program = "import sys; from seaclutter_cli.commands import main; sys.argv[0] = 'seaclutter'\ntry: main()\nfinally: "
    program += "print([name for name in sys.modules if name.startswith(('obstore', 'seaclutter_cli.storage'))])"
    command = [sys.executable, "-c", program, "filter", SEA, "-n", "1", "-q", "-o", tmp_path / "out.mcap"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


TREE = ("a.mcap", "day1/b.mcap", "day2/c.mcap", "day2/deep/d.mcap", "bag/bag_0.mcap", "notes/e.txt", "[x]/f.mcap")
PATTERNS = (
    "*.mcap",
    "*",
    "day?/*.mcap",
    "day[12]/*",
    "**/*.mcap",
    "day2/**",
    "b*",
    "[x]",
    "[x]/*",
    "[[]x]/*",
    "n*",
    "",
)


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """Return a folder with the files of the tree."""
    folder = tmp_path_factory.mktemp("tree") / "logs"
    for name in TREE:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")
    return folder


@pytest.mark.parametrize("pattern", PATTERNS)
def test_folders_and_globs_are_those_of_files(bucket, scratch, tree, pattern):
    for name in TREE:
        put(bucket / "logs" / name, b"x")

    @on_paths
    def names_of(logs):
        return [(one.name, str(shown(one.paths[0]))) for one in expand(OfLogs(logs=logs))]

    def found(root):
        try:
            return [(name, path.removeprefix(str(root))) for name, path in names_of(f"{root}/{pattern}")]
        except UsageError as error:
            return str(error).replace(str(root), "")

    assert found(bucket / "logs") == found(tree)


def test_metadata_beside_a_capture_is_copied_too(logs, tmp_path):
    put(logs / "trial.pcap", b"nothing")
    put(logs / "trial.json", b"{}")
    put(logs / "other.json", b"{}")

    @on_paths
    def files_of(logs):
        return next({path.name for path in _files_of(one)} for one in expand(OfLogs(logs=logs)) if one.name == "trial")

    for pattern in ("trial.pcap", "*.pcap", ""):
        assert files_of(f"{logs}/{pattern}") == {"trial.pcap", "trial.json"}


def test_the_library(logs, scratch, tmp_path):
    with seaclutter.open_log(f"{logs}/sea.mcap") as log:
        assert len(list(log.frames("/points"))) == 60
        assert list(scratch.iterdir())
    done = seaclutter.filter_log(f"{logs}/sea.mcap", f"{logs}/f.mcap", config=f"{logs}/config.yaml", frames=2)
    assert str(done.outcomes[0].output) == f"{logs}/f.mcap"
    seaclutter.calibrate(f"{logs}/sea.mcap", labels=f"{logs}/sea.labels.csv", output=f"{logs}/c.yaml")
    assert {"f.mcap", "c.yaml"} <= set(names(logs))
    with pytest.raises(seaclutter.UsageError, match="already exists"):
        seaclutter.filter_log(f"{logs}/sea.mcap", f"{logs}/f.mcap")
    del log


def test_an_error_in_one_log_does_not_cost_the_others(logs):
    put(logs / "day/a.mcap", b"nothing")
    put(logs / "day/b.mcap", SEA.read_bytes())
    result = run(f"filter {logs}/day -n 1 -o {logs}/out/")
    assert result.exit_code == 1
    assert names(logs / "out") == ["b.mcap"]


def test_a_log_that_changes_while_it_is_read(logs, proxy):
    def change(request):
        if request.method == "GET" and "sea.mcap" in request.path:
            proxy.rule = lambda _: None
            put(logs / "sea.mcap", SEA.read_bytes()[::-1])

    proxy.rule = change
    result = run(f"filter {logs}/sea.mcap -o {logs}/out.mcap")
    assert result.exit_code == 1
    assert result.stderr == f"Error: {logs}/sea.mcap: the object changed while it was read\n"


def test_the_scratch_folder_can_be_chosen(logs, tmp_path, monkeypatch):
    monkeypatch.setenv("SEACLUTTER_SCRATCH", str(tmp_path / "own"))
    done(f"filter {logs}/sea.mcap -n 1 -o {logs}/out.mcap")
    assert list((tmp_path / "own").iterdir()) == []
    monkeypatch.setenv("SEACLUTTER_SCRATCH", str(tmp_path / "no" / "no"))
    result = run(f"filter {logs}/sea.mcap -n 1 -o {logs}/out.mcap --force")
    assert "no: the scratch folder cannot be used" in result.stderr


IMPATIENT = """
from seaclutter_cli.commands import main
from seaclutter_cli.storage import objects
objects.RETRIES = {"max_retries": 3}
main()
"""


def start(*arguments):
    command = [sys.executable, "-c", IMPATIENT, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for(condition):
    for _ in range(600):
        if condition():
            return
        time.sleep(0.05)
    raise TimeoutError


@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM"])
def test_a_run_that_ends_during_the_upload(logs, proxy, scratch, name):
    def is_upload(request):
        return "out.mcap" in request.path and request.method in ("PUT", "POST")

    proxy.rule = lambda request: Action(status=503) if is_upload(request) else None
    process = start("filter", logs / "sea.mcap", "-o", logs / "out.mcap")
    try:
        wait_for(lambda: any(map(is_upload, proxy.requests)))
        process.send_signal(signal.Signals[name])
        process.communicate(timeout=60)
    finally:
        process.kill()
    proxy.rule = lambda _: None
    assert process.returncode != 0
    assert "out.mcap" not in names(logs)
    if name == "SIGKILL":
        assert list(scratch.iterdir())
    done(f"filter {logs}/sea.mcap -n 1 -o {logs}/out.mcap")
    assert "out.mcap" in names(logs)


def test_secrets_are_nowhere(logs, tmp_path, monkeypatch):
    monkeypatch.setenv("AWS_SESSION_TOKEN", "")
    secret = os.environ["AWS_SECRET_ACCESS_KEY"]
    texts = [run(f"filter {logs}/sea.mcap -n 1 -v --debug -o {logs}/out.mcap --csv {logs}/out.csv").output]
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "unknownkey")
    texts.append(run(f"filter {logs}/sea.mcap -n 1 -o {logs}/out.mcap").output)
    monkeypatch.undo()
    assert "SignatureDoesNotMatch" in texts[1] or "not accepted" in texts[1] or "access denied" in texts[1]
    assert all(secret not in text for text in texts)
