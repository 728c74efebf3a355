"""URLs are paths within a run, and URLs again in all that leaves it."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from seaclutter_cli.buckets import local_copy, mirror_of, naming, on_paths, shown
from seaclutter_cli.errors import InputError, UsageError
from seaclutter_cli.records import Damage
from seaclutter_cli.urls import place

URL = "s3://trial/day 1/log.mcap"


@dataclass(frozen=True)
class Options:
    file: Path | None = None
    more: tuple[Path, ...] = ()
    text: str = "s3://only/text"


@dataclass
class Result:
    output: Path
    lines: list[str]
    numbers: dict[str, int]


class Listener:
    def __init__(self):
        self.heard = []

    def warn(self, text):
        self.heard.append(text)

    def damage(self, damage):
        self.heard += map(str, damage)


@pytest.fixture(autouse=True)
def scratch(tmp_path, monkeypatch):
    """Return the scratch folder, which must be empty at the end."""
    monkeypatch.setenv("SEACLUTTER_SCRATCH", str(tmp_path))
    yield tmp_path
    assert not list(tmp_path.iterdir())


def test_what_contains_no_url_is_passed_on_as_it_is():
    given = ["log.mcap", Path("out"), Options(Path("a")), Listener(), None]
    assert on_paths(lambda *args: args)(*given) == tuple(given)


def test_urls_are_paths_within_a_run(scratch):
    @on_paths
    def run(logs, output, options):
        log, here = logs
        assert (Path(log).parent.name, here, output[-5:]) == ("day 1", "here.mcap", "/out/")
        assert scratch in Path(log).parents
        assert options.file == Path(log)
        assert options.more == (Path("here"),)
        assert options.text == "s3://only/text"
        assert mirror_of(options.file)
        assert not mirror_of(Path("here"))
        return Result(options.file, [f"{log}: byte 5"], {log: 1})

    result = run([URL, "here.mcap"], "s3://trial/out/", Options(place(URL), (Path("here"),)))
    assert (str(result.output), result.lines, result.numbers) == (URL, [f"{URL}: byte 5"], {URL: 1})


def test_errors_and_their_notes_name_urls():
    @on_paths
    def run(log):
        error = InputError(f"{log}: is empty")
        error.add_note(f"{log}: was removed")
        raise error

    with pytest.raises(InputError) as raised:
        run(URL)
    assert str(raised.value) == f"{URL}: is empty"
    assert raised.value.__notes__ == [f"{URL}: was removed"]


def test_observers_hear_of_urls():
    @on_paths
    def run(log, observer):
        observer.warn(f"{log}: odd")
        observer.damage([Damage(Path(log), 5, "cut")])

    listener = Listener()
    run(URL, listener)
    assert listener.heard[0] == f"{URL}: odd"
    assert listener.heard[1].startswith(f"{URL}: byte 5: cut")


def test_a_run_within_a_run_has_the_same_folder():
    inner = on_paths(lambda path: path)
    outer = on_paths(lambda path: inner(path) == path)
    assert outer(URL)


def test_secrets_are_refused():
    with pytest.raises(UsageError, match="must not contain credentials"):
        on_paths(lambda log: log)("s3://key:secret@trial/log.mcap")


def test_a_copy_outlives_a_call():
    with local_copy(URL) as path:
        assert str(shown(Path(path))) == URL
        with pytest.raises(InputError, match=f"^{URL}$"), naming():
            raise InputError(path)
    assert shown(Path(path)) == Path(path)
