"""Output files of a run: checking them against each other and the input, and writing them; the manifest."""

import errno
import gzip
import io
import itertools
import json
import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import IO, TYPE_CHECKING, Any

from seaclutter_cli.buckets import look, mirror_of, shown
from seaclutter_cli.errors import OutputError, UsageError, opening
from seaclutter_cli.parts import remove_stale, take_back
from seaclutter_cli.paths import Identities, Identity, files_in
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.options import ReadOptions
from seaclutter_cli.runs.recordings import Outcome, data_of
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup, why_kept
from seaclutter_cli.sinks.csv import csv_lines
from seaclutter_cli.sinks.formats import is_single_frame
from seaclutter_cli.sources.recordings import Recording, metadata_beside
from seaclutter_cli.text import count, named_folder
from seaclutter_cli.urls import WEB, PathLike

if TYPE_CHECKING:  # imports all filters, which tiles do not need
    from seaclutter_cli.config import Config

_COLUMNS = (
    *("recording", "input", "output", "status", "frames", "points_in", "points_out", "false_alarms", "missed_targets"),
    *("bytes_in", "bytes_out", "seconds", "damaged_parts", "error"),
)
"""Of every manifest; those that a command does not know are empty."""

_LABELS = "--labels"
_OF_FOLDERS = ("--figures", "--pictures")
_FIGURES = ("--plot", "--plot-thresholds", *_OF_FOLDERS)
_PACKED_BYTES = 2**24

Paths = Mapping[str, Path | Iterable[Path] | None]
"""Places of files by the option that gives them."""


def inputs_of(
    recordings: Iterable[Recording], options: ReadOptions, configs: "Sequence[Config]" = ()
) -> dict[str, Sequence[Path]]:
    """Return the files and folders that a run reads, by option, also those beside a log.

    ``configs`` are effective configurations, which may name a model and a mask.
    """
    logs = [path for recording in recordings for path in recording.paths]
    models, masks = ({getattr(config.filter, key, None) for config in configs} for key in ("scene_model", "mask"))
    file = getattr(options, "config", None)
    return {
        _LABELS: getattr(options, "labels", ()),
        "LOGS": [*logs, *(beside for log in logs for beside in metadata_beside(log))],
        "--calibration": options.beside(),
        "-c": [file] if isinstance(file, Path) else [],
        "filter.scene_model": [Path(model) for model in models if model],
        "filter.mask": [Path(mask) for mask in masks if mask],
    }


def is_file(place: Path) -> bool:
    """Return whether there is something of this name that is not a folder."""
    return os.path.exists(place) and not os.path.isdir(place)  # noqa: PTH110, PTH112 - also of names that are too long


def is_folder(output: PathLike, outputs: int, marker: str = "") -> bool:
    """Return whether a path denotes a folder for outputs, and not a single output; a slash at its end means a folder.

    An output that is a folder is recognised by the file ``marker``.
    """
    if outputs > 1 or named_folder(output):
        return True
    place = Path(output)
    look(place)
    if marker and (place / marker).exists():
        return False
    return os.path.isdir(place)  # noqa: PTH112 - false if the name is too long


def outputs_in(folder: Path, names: Iterable[Path], inputs: Sequence[Path], noun: str, remedy: str) -> list[Path]:
    """Return files of names in a folder, one for each input; raise `UsageError` if there are not as many, or a file."""
    if is_file(folder):
        raise UsageError(f"{folder}: is a file, but {count(len(inputs), noun)} need a folder")
    made: dict[Path, Path] = {}
    for name, one in zip(names, inputs, strict=True):
        target = folder / name
        if target in made:
            raise UsageError(f"{made[target]} and {one} would both become {target}; {remedy}")
        made[target] = one
    return list(made)


def prepare_outputs(  # noqa: PLR0913 - what outputs are checked against
    outputs: Paths,
    inputs: Paths,
    *,
    force: bool,
    observer: Observer = SILENT,
    root: Path | None = None,
    marker: str = "",
    dry: bool = False,
) -> None:
    """Check the paths of output files, by option, against each other and against the inputs; prepare their folders.

    New files in folders of inputs are refused, too, but allowed in those of labels. Inputs that do not exist are names
    of built-in files. Existing files may be replaced if ``force``; a file to which the observer appends messages,
    its ``log_file``, may exist. Outputs of ``-o`` that are folders are recognised by the file ``marker``; it is empty
    if they are files. Raise `UsageError` if two outputs are the same file, or an output is an input, is inside an input
    folder, is a folder, is in a folder whose parent does not exist, exists and may not be replaced, or is a figure in
    an unknown format.

    Unless ``dry``, folders below ``root``, which ``-o`` gives, are created. Incomplete files that killed runs left are
    removed, with a note to the observer.
    """
    for folder in {path.parent if mirror_of(path.parent) else path for _, path in _flat(outputs)}:
        if mirror := mirror_of(folder):
            if mirror.url(folder).scheme in WEB:
                raise UsageError(f"{mirror.url(folder)}: web servers take no outputs")
            mirror.list_folder(folder)  # with one request for each folder
    known = Identities()
    for folder in () if dry else {known(path).parent for _, path in _flat(outputs)}:
        for back in take_back(folder):
            observer.warn(f"{back}: is back; a run was killed while it replaced this folder")
    targets = [_Target(path, option, known, marker if option == "-o" else "") for option, path in _flat(outputs)]
    log_file = getattr(observer, "log_file", None)
    log = [_Target(log_file, "--log-file", known)] if log_file else []
    _check_distinct([*targets, *log], known)
    _check_inputs([*targets, *log], inputs, known)
    for target in targets:
        _check_place(target, force=force)
    _prepare_folders(targets, root, observer, dry=dry)


def _flat(paths: Paths) -> Iterator[tuple[str, Path]]:
    for option, given in paths.items():
        if given is not None:
            yield from ((option, path) for path in ([given] if isinstance(given, Path) else given))


class _Target:
    """An output, and the option that gives it; ``marker`` is a file in it if it is a folder."""

    def __init__(self, path: Path, option: str, known: Identities, marker: str = "") -> None:
        self.path, self.option, self.marker = path, option, marker
        self.file = known(path)
        self.exists = os.path.lexists(self.file)
        self.identity = known.of(self.file)


def _check_distinct(targets: Sequence[_Target], known: Identities) -> None:
    """Check that no two outputs are the same file, and that none is the folder of another."""
    first: dict[Identity, _Target] = {}
    for target in targets:
        other = first.setdefault(target.identity, target)
        if other is not target:
            raise UsageError(f"{target.path}: is given for two outputs, {other.option} and {target.option}")
    for inner in targets:
        outer = first.get(known.of_folder(inner.file.parent))
        if outer and (outer.marker or not outer.exists):
            raise UsageError(f"{outer.path}: is given for a file, {outer.option}, and a folder, {inner.option}")


def _check_inputs(targets: Iterable[_Target], inputs: Paths, known: Identities) -> None:
    """Check that no output changes an input, also by a new file in a folder of logs, or is a folder with one in it."""
    given = [(option, known(path)) for option, path in _flat(inputs)]
    read = [(option, path) for option, path in given if os.path.lexists(path)]
    options = {known.of(path): option for option, path in read}
    inside = cache(lambda: {file: option for option, path in read for file in files_in(path)})  # links elsewhere, too
    for target in targets:
        part_of = options.get(target.identity)
        if part_of is None and options:
            above = (options.get(known.of_folder(folder)) for folder in target.file.parents)
            part_of = next((option for option in above if option and (target.exists or option != _LABELS)), None)
        if part_of is None and target.exists:
            part_of = inside().get(target.identity)
        contained = next((option for option, path in read if target.marker and target.file in path.parents), None)
        if part_of or contained:
            problem = f"is part of the input, {part_of}" if part_of else f"contains the input, {contained}"
            raise UsageError(f"{target.path}: {problem}; choose another output for {target.option}")


def _check_place(target: _Target, *, force: bool) -> None:
    path = target.path
    if target.option in _FIGURES:
        from seaclutter_cli.plots.figure import check_target  # not needed otherwise

        check_target(path)
    if target.option in _OF_FOLDERS and is_file(path.parent):
        raise UsageError(f"{path.parent}: is a file; {target.option} takes a folder")
    if target.exists and target.file.is_dir():
        if not target.marker:
            raise UsageError(f"{path}: is a folder; {target.option} takes a file")
        look(target.file)
        if mirror_of(path) and not (target.file / target.marker).exists():
            problem = f"is a folder without {target.marker}, so it is incomplete or of something else; delete it, or"
            raise UsageError(f"{path}: {problem} choose another output for {target.option}")
        if problem := why_kept(target.file, target.marker):
            raise UsageError(f"{path}: {problem}; choose another output for {target.option}")
    elif target.exists and target.marker and not is_single_frame(target.path):
        raise UsageError(f"{path}: is a file, but the output is a folder")
    elif target.exists and target.file.exists() and not target.file.is_file():
        raise UsageError(f"{path}: not a regular file, cannot be replaced")
    if target.exists and not force:
        raise UsageError(f"{path}: already exists; use --force to replace it")


def _prepare_folders(targets: Sequence[_Target], root: Path | None, observer: Observer, *, dry: bool) -> None:
    """Check that folders of outputs exist or can be created; create and tidy them. Each is looked at only once."""
    top = Path(os.path.realpath(root)) if root else None
    folders = {target.file.parent: target.path for target in reversed(targets)}
    names: defaultdict[Path, set[str]] = defaultdict(set)
    for target in targets:
        names[target.file.parent].add(target.file.name)
    for folder, path in reversed(folders.items()):
        above = top if top and top in folder.parents else folder
        if not (mirror_of(path) or os.path.lexists(above) or os.path.lexists(above.parent)):
            raise UsageError(f"{path}: there is no folder {path.parent.parent}; create it first")
    for folder, path in () if dry else sorted(folders.items()):
        if top in folder.parents:
            with opening(path, OutputError, "cannot be written"):
                folder.mkdir(parents=True, exist_ok=True)
        if folder.exists() and not os.access(folder, os.W_OK):  # before the run, not after it
            raise OutputError(f"{path}: cannot be written ({os.strerror(errno.EACCES)})")
        if removed := remove_stale(folder, names[folder]):
            observer.note(f"{folder}: removed {count(removed, 'incomplete file')} of runs that were killed")


def may_appear(targets: Iterable[Path | None], outcomes: Sequence[Outcome], observer: Observer) -> bool:
    """Return whether output files about several recordings may appear, although some of these failed.

    They may not if all failed, or if one of the files would replace a file of an earlier run, which gives a warning.
    """
    failed = [outcome.recording for outcome in outcomes if outcome.error]
    if not failed:
        return True
    earlier = [str(target) for target in targets if target and target.exists()]
    if earlier and len(failed) < len(outcomes):
        observer.warn(f"{', '.join(earlier)}: not replaced, because of the error in {', '.join(failed)}")
    return not earlier and len(failed) < len(outcomes)


Contents = Mapping[Path | None, bytes | Callable[[AtomicFile], object]]
"""Contents of files, or what writes them, by their paths; None for files that are not wanted."""


def write_files(
    files: Contents | Mapping[Path, bytes],
    group: OutputGroup | None = None,
    *,
    replace: bool = True,
    outcomes: Sequence[Outcome] = (),
    observer: Observer = SILENT,
) -> None:
    """Write files, which appear together, the first one last; if they are about recordings, only if they `may_appear`.

    `OutputGroup` describes the other parameters and the errors.
    """
    if not may_appear(files, outcomes, observer):
        return
    with OutputGroup(group, replace=replace) as together:
        for path, data in reversed(list(files.items())):
            if path:
                with AtomicFile(path, together) as file:
                    data(file) if callable(data) else file.stream.write(data)


class PackedRows:
    """Lines of a table about one recording, compressed: in memory, or if they are many in a temporary file."""

    def __init__(self) -> None:
        self.packed: IO[bytes] = SpooledTemporaryFile(_PACKED_BYTES)  # noqa: SIM115 - as long as the rows
        self._lines = gzip.GzipFile(fileobj=self.packed, mode="wb", compresslevel=1)

    def write(self, lines: bytes) -> None:
        """Add lines."""
        self._lines.write(lines)

    def __iter__(self) -> Iterator[bytes]:
        """Yield the lines, to which none can be added any more."""
        self._complete()
        return gzip.GzipFile(fileobj=self.packed, mode="rb")

    def __getstate__(self) -> dict[str, Any]:
        """Complete the rows, and return them for another process."""
        self._complete()
        return {**vars(self), "packed": io.BytesIO(self.packed.read())}

    def _complete(self) -> None:
        if lines := vars(self).pop("_lines", None):
            lines.close()
        self.packed.seek(0)


def write_manifest(
    path: Path | None, recordings: Sequence[Recording], outcomes: Sequence[Outcome], *, replace: bool
) -> None:
    """Write a table with a row for each recording: JSON if the name ends in ``.json``, otherwise CSV."""
    if path is None:
        return
    rows = []
    for recording, outcome in zip(recordings, outcomes, strict=True):
        known = {"input": str(recording.paths[0]), "damaged_parts": len(outcome.damage)}
        known |= data_of(outcome, "recording status seconds=rounded_s error")
        rows += [shown(known | row) for row in outcome.manifest_rows()]
    columns = list(dict.fromkeys((*_COLUMNS, *itertools.chain(*rows))))
    rows = [{name: row.get(name) for name in columns} for row in rows]
    is_json = path.suffix.lower() == ".json"
    text = f"{json.dumps(rows, indent=2)}\n".encode() if is_json else csv_lines([columns, *map(dict.values, rows)])
    write_files({path: text}, replace=replace)
