"""Files that form one recording: recorders begin a new file, with the next number, when one has reached a limit."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.errors import InputError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import main_clouds
from seaclutter_cli.text import duration

MAX_GAP_S = 10.0
"""Greatest time between two files of one recording in seconds."""

MAX_OVERLAP_S = 1.0
"""Greatest overlap of two files of one recording in seconds: recorders write late messages to the next file."""

_NANO = 1_000_000_000


@dataclass(frozen=True)
class _Content:
    """What a file tells about its place in a recording: log times, and topics with their types."""

    path: Path
    span_ns: tuple[int, int]
    clouds: frozenset[tuple[str, str]]


def joined(
    files: Sequence[Path], open_file: Callable[[Path], Source], note: Callable[[str], object]
) -> list[list[Path]]:
    """Return numbered files in groups, each of which is one recording.

    A file continues a recording if it begins at the end of the file before it, at most `MAX_GAP_S` after and
    `MAX_OVERLAP_S` before, and has the same cloud topics, or some of them. A file that cannot be opened, or has no
    messages, does not part a recording. ``note`` receives lines that say which files are joined, or why not.
    """
    groups, last, reasons = [[files[0]]], _content(files[0], open_file), []
    for file in files[1:]:
        content = _content(file, open_file)
        reason = _difference(last, content) if last and content else None
        if reason is None:
            groups[-1].append(file)
        else:
            groups.append([file])
            reasons.append(reason)
        last = content or last
    for line in _lines(groups, reasons):
        note(line)
    return groups


def _lines(groups: Sequence[Sequence[Path]], reasons: Sequence[str]) -> Iterator[str]:
    for group in groups:
        if len(group) > 1:
            yield f"{_named(group[0], group[-1])} are one recording; --no-join separates them"
    if reasons:
        more = f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else ""
        files = _named(groups[0][0], groups[-1][-1])
        yield f"{files} are {len(groups)} recordings: {reasons[0]}{more}; --join makes them one"


def _named(first: Path, last: Path) -> str:
    return f"{first} to {last.name}"


def difference(files: Sequence[Path], open_file: Callable[[Path], Source]) -> str | None:
    """Return why files are not one recording; None if they are."""
    lines: list[str] = []
    return lines[-1] if len(joined(files, open_file, lines.append)) > 1 else None


def _content(file: Path, open_file: Callable[[Path], Source]) -> _Content | None:
    try:
        with closing(open_file(file)) as source:
            clouds = ((c.topic, c.schema.name if c.schema else "") for c in main_clouds(source.channels))
            return _Content(file, source.span_ns, frozenset(clouds)) if source.span_ns else None
    except InputError:
        return None


def _difference(last: _Content, content: _Content) -> str | None:
    """Return why one file does not continue another; None if it does."""
    gap_s = (content.span_ns[0] - last.span_ns[1]) / _NANO
    if gap_s > MAX_GAP_S:
        return f"{content.path.name} begins {duration(gap_s)} after the end of {last.path.name}"
    middle_ns = sum(last.span_ns) / 2
    if gap_s < 0 and (gap_s < -MAX_OVERLAP_S or content.span_ns[0] <= middle_ns):
        return f"{content.path.name} begins {duration(-gap_s)} before the end of {last.path.name}"
    if not (last.clouds <= content.clouds or content.clouds <= last.clouds):
        return f"{content.path.name} has other point-cloud topics than {last.path.name}"
    return None
