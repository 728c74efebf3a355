"""Signals, full disks, limits and odd environments: complete results or none, one plain line, nothing left over."""

import os
import random
import signal
import subprocess
import sys
import time

import pytest

from tests.paths import ROOT

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals, limits and locales of POSIX")

SEA = ROOT / "samples" / "sea.mcap"
LABELS = ROOT / "samples" / "sea.labels.csv"
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGKILL")


def start(folder, *arguments, environment=None, before=None):
    """Start a run in a folder."""
    given = {**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})}
    return subprocess.Popen(
        [*(before or ()), sys.executable, "-m", "seaclutter_cli", *map(str, arguments)],
        cwd=folder,
        env={key: value for key, value in given.items() if value is not None},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process, timeout=60):
    """Return the exit status and the standard error of a run."""
    _, stderr = process.communicate(timeout=timeout)
    # Before the program begins, Python itself prints a traceback after an interrupt.
    assert "Traceback" not in stderr or "__main__.py" not in stderr, stderr
    return process.returncode, stderr


def run(folder, *arguments, **options):
    return finish(start(folder, *arguments, **options))


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


FILTER = ("filter", SEA, "-o", "x.mcap", "--csv", "x.csv", "--force")
EVALUATE = ("evaluate", SEA, "--labels", LABELS, "-o", "x.csv", "--summary", "x.json", "--force")


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """Return the outputs of an undisturbed run, and how long it takes."""
    folder = tmp_path_factory.mktemp("expected")
    begin = time.monotonic()
    assert run(folder, *FILTER)[0] == 0
    return content(folder), time.monotonic() - begin


def interrupted(folder, name, seconds, expected, *, again=()):
    """Interrupt a run after some seconds, and check what it leaves; return its exit status."""
    process = start(folder, *FILTER)
    for pause, one in ((seconds, name), *again):
        time.sleep(pause)
        process.send_signal(getattr(signal, one))
    status, stderr = finish(process)
    left = content(folder)
    if name == "SIGKILL":
        left = {file: data for file, data in left.items() if not file.endswith(".part")}
        assert "x.mcap" not in left or "x.csv" in left
    else:
        assert left.keys() in (set(), expected.keys()), stderr
    assert left.items() <= expected.items()
    assert (status == 0) <= (left == expected)
    for file in left:
        (folder / file).unlink()
    return status


@pytest.mark.parametrize("name", SIGNALS)
def test_a_signal_at_a_random_moment(tmp_path, expected, name):
    many_signals(tmp_path, expected, name, 1)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", SIGNALS)
def test_a_signal_at_many_random_moments(tmp_path, expected, name):
    many_signals(tmp_path, expected, name, 100)


def many_signals(folder, expected, name, number):
    outputs, duration = expected
    moments = random.Random(name)
    for _ in range(number):
        interrupted(folder, name, moments.uniform(0.3, 1.1) * duration, outputs)
    status, stderr = run(folder, *FILTER)
    assert status == 0
    assert content(folder) == outputs, "the last run also removes what killed ones left"
    assert name == "SIGKILL" or "removed" not in stderr


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_further_signals_at_once(tmp_path, expected, name):
    more_signals(tmp_path, expected, name, 1)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_further_signals_at_many_moments(tmp_path, expected, name):
    more_signals(tmp_path, expected, name, 100)


def more_signals(folder, expected, name, number):
    outputs, duration = expected
    moments = random.Random(name)
    for _ in range(number):
        again = [(moments.uniform(0, 0.03), moments.choice(SIGNALS[:3])) for _ in range(moments.randrange(1, 4))]
        interrupted(folder, name, moments.uniform(0.3, 1.1) * duration, outputs, again=again)
    assert content(folder) == {}


def test_what_a_killed_run_leaves_is_removed_by_the_next_one(tmp_path, expected):
    process = start(tmp_path, *FILTER)
    deadline = time.monotonic() + 60
    while len(list(tmp_path.glob(".x.*.part"))) < 2:
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.005)
    process.send_signal(signal.SIGSTOP)
    alive = set(content(tmp_path))
    assert "removed" not in run(tmp_path, *FILTER)[1]
    assert alive <= set(content(tmp_path)), "files of living processes stay"
    process.kill()
    assert finish(process)[0] == -signal.SIGKILL
    status, stderr = run(tmp_path, *FILTER)
    assert status == 0
    assert f"{tmp_path}: removed 2 incomplete files of runs that were killed\n" in stderr
    assert content(tmp_path) == expected[0]


def test_two_runs_to_one_output(tmp_path, expected):
    runs = [start(tmp_path, *FILTER) for _ in range(2)]
    assert [finish(one)[0] for one in runs] == [0, 0]
    assert content(tmp_path) == expected[0]


def test_two_runs_to_one_output_that_may_not_be_replaced(tmp_path, expected):
    runs = [start(tmp_path, *FILTER[:-1]) for _ in range(2)]
    (first, first_error), (second, second_error) = map(finish, runs)
    assert 0 in (first, second)
    assert first + second in (1, 2), "the other one is refused at its end, or at its start if it is late"
    refusal = first_error + second_error
    assert "appeared while this run was writing it" in refusal or "already exists" in refusal
    assert content(tmp_path) == expected[0]


ON_SMALL_DISK = """
mount -t tmpfs -o size=64k tmpfs disk && head -c {filled}k /dev/zero > disk/filling || exit 99
"$@"
status=$?
ls -A disk
exit $status
"""


def on_small_disk(folder, filled, *arguments):
    """Run with a disk of 64 kB at ``disk``, which needs no rights; return status, errors and the files on it."""
    (folder / "disk").mkdir()
    unshare = ("unshare", "--map-root-user", "--mount", "sh", "-c", ON_SMALL_DISK.format(filled=filled), "sh")
    try:
        process = start(folder, *arguments, before=unshare)
    except OSError:
        pytest.skip("there is no unshare")
    stdout, stderr = process.communicate(timeout=60)
    if process.returncode == 99 or "unshare" in stderr:
        pytest.skip("no permission to mount a small disk")
    return process.returncode, stderr, stdout.split()


@pytest.mark.parametrize(
    ("filled", "line"),
    [
        (0, f"filter {SEA} -o disk/x.mcap --csv x.csv"),
        (64, f"filter {SEA} -o x.mcap --csv disk/x.csv -n 1"),
        (64, f"evaluate {SEA} --labels {LABELS} -n 2 -o x.csv --summary disk/x.json -q"),
        (20, "simulate buoy_speedboat -n 3 -o disk/x.mcap -q"),
        (0, f"report {SEA} -n 3 -o disk/x.html -q"),
        (64, f"calibrate {SEA} -n 3 -o x.yaml --plot disk/x.svg"),
    ],
)
def test_a_disk_that_gets_full(tmp_path, filled, line):
    status, stderr, files = on_small_disk(tmp_path, filled, *line.split())
    assert status == 1, stderr
    assert "the disk is full; the incomplete file was removed" in stderr.splitlines()[-1]
    assert files == ["filling"]
    assert content(tmp_path) == {}


def test_a_folder_that_may_not_be_written(tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir()
    (locked / "x.csv").write_text("precious")
    locked.chmod(0o500)
    # Root may write everywhere, except without its capabilities.
    before = ("setpriv", "--bounding-set=-all", "--inh-caps=-all") if os.geteuid() == 0 else ()
    arguments = ("filter", SEA, "-n", "2", "-o", "x.mcap", "--csv", locked / "x.csv", "--force")
    try:
        status, stderr = run(tmp_path, *arguments, before=before)
    except OSError:
        pytest.skip("root cannot give up its rights here")
    finally:
        locked.chmod(0o700)
    assert status == 1
    assert stderr == f"Error: {locked / 'x.csv'}: cannot be written (Permission denied)\n"
    assert content(tmp_path) == {"x.csv": b"precious"}


LITTLE_MEMORY = "Error: not enough memory; close other programs, or raise the limit of this process (ulimit -v)\n"


def in_address_space(folder, megabytes, *command):
    """Run in a small address space, with as many threads of numerical libraries as they like."""
    limited = ("sh", "-c", f'ulimit -v {megabytes * 1024} && exec "$@"', "sh")
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"))
    return run(folder, *command, before=limited, environment=threads)


def test_400_megabytes_of_address_space(tmp_path):
    assert in_address_space(tmp_path, 400, *EVALUATE) == (0, "")
    assert sorted(content(tmp_path)) == ["x.csv", "x.json"]


@pytest.mark.parametrize(
    ("megabytes", "command"),
    [(300, FILTER), (200, EVALUATE), (160, (*EVALUATE, "--clustering", "dbscan")), (160, FILTER), (110, EVALUATE)],
    ids=str,
)
def test_little_address_space(tmp_path, megabytes, command):
    """A run succeeds, or says what it lacks; the stacks of its threads take more on machines with more cores."""
    status, stderr = in_address_space(tmp_path, megabytes, *command)
    assert (status, stderr) in [(0, ""), (1, LITTLE_MEMORY)]
    assert len(content(tmp_path)) == (0 if status else 2)
    assert status or megabytes > 110


def test_without_a_home(tmp_path, expected):
    environment = dict.fromkeys(("HOME", "USER", "LOGNAME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME", "MPLCONFIGDIR"))
    assert run(tmp_path, *FILTER, environment=environment) == (0, "")
    assert content(tmp_path) == expected[0]
    assert run(tmp_path, "calibrate", SEA, "-n", 5, "-o", "x.yaml", "--plot", "x.png", environment=environment)[0] == 0


def test_a_home_that_cannot_be_written(tmp_path):
    arguments = ("calibrate", SEA, "-n", 5, "-o", "x.yaml", "--plot", "x.png")
    assert run(tmp_path, *arguments, environment={"HOME": os.devnull})[0] == 0
    assert sorted(content(tmp_path)) == ["x.png", "x.yaml"]


LOCALES = [
    {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    {"LC_ALL": "en_US.ISO-8859-1", "PYTHONIOENCODING": "latin-1", "PYTHONUTF8": "0"},
    {"PYTHONIOENCODING": "ascii"},
]


@pytest.mark.parametrize("locale", LOCALES, ids=lambda locale: " ".join(locale.values()))
def test_odd_locales(tmp_path, expected, locale):
    names = ("Fähre 船.mcap", "Bilder é.csv")
    (tmp_path / "log ü.mcap").write_bytes(SEA.read_bytes())
    arguments = ("filter", "log ü.mcap", "-o", names[0], "--csv", names[1])
    assert run(tmp_path, *arguments, environment=locale) == (0, "")
    assert (tmp_path / names[0]).read_bytes() == expected[0]["x.mcap"]
    assert (tmp_path / names[1]).exists()
    labels = ("evaluate", "log ü.mcap", "--labels", LABELS, "-o", "T ö.csv", "-n", 2)
    assert run(tmp_path, *labels, environment=locale)[0] == 0
    assert not [path for path in tmp_path.iterdir() if path.name.endswith(".part")]
