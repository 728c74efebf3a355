"""Work on several tiles, in this process or in several; their outputs appear together."""

import shutil
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Generic, TypeVar

from seaclutter_cli.errors import OutputError
from seaclutter_cli.jobs.budget import default_jobs
from seaclutter_cli.runs.batch import BatchOptions, Work, run_batch
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.recordings import Outcome, storing_errors
from seaclutter_cli.sinks.atomic import CompleteFile, OutputGroup
from seaclutter_cli.sources import Recording
from seaclutter_cli.sources.extents import TileHead
from seaclutter_cli.storage.parts import part_path, release
from seaclutter_cli.text import count

R = TypeVar("R")

MEMORY_PER_TILE = 1500 * 2**20
"""Memory in bytes that a tile may need: some ten million points."""


@dataclass(kw_only=True)
class TileOutcome(Outcome, Generic[R]):
    """Outcome of the work on one tile.

    Parameters
    ----------
    points : int
        Number of points of the tile.
    result : object or None
        Result; None after an error.
    """

    points: int = 0
    result: R | None = None

    def figures(self) -> str:
        """Return the number of points and the duration, for a line about the outcome."""
        return f"{count(self.points, 'point')}, {self.seconds:.1f} s"


@dataclass(frozen=True)
class _Window(Recording):
    """A window of a file."""

    tile: TileHead = field(kw_only=True)

    @property
    def name(self) -> str:
        """Name of the window."""
        return self.tile.name

    @property
    def size(self) -> int:
        """Size of its chunks in bytes."""
        return self.tile.size


@dataclass(frozen=True, kw_only=True)
class TileWork(Work[TileOutcome[R]]):
    """Work on one tile.

    Parameters
    ----------
    tile : TileHead
        The tile.
    target : Path
        Its output.
    staged : Path or None
        Where the output is written, to become ``target`` together with those of other tiles.
    replaced : bool
        Whether an existing output may be replaced.
    """

    noun: ClassVar[str] = "tile"

    tile: TileHead
    target: Path
    staged: Path | None = None
    replaced: bool = False

    @property
    def path(self) -> Path:
        """File of the tile."""
        return self.tile.path

    @property
    def recording(self) -> Recording:  # type: ignore[override]
        """The tile."""
        return _Window((self.path,), tile=self.tile) if self.tile.window else Recording((self.path,))

    @abstractmethod
    def process(self, observer: Observer, files: OutputGroup | None) -> tuple[R, int]:
        """Write the output to `place`; return the result and the number of points."""

    @property
    def place(self) -> Path:
        """Where the output is written."""
        return self.staged or self.target

    def run(self, observer: Observer) -> TileOutcome[R]:
        """Process the tile; store an error in the outcome."""
        outcome = self.without_result(None)
        with storing_errors(outcome, observer):
            try:
                with OutputGroup(replace=self.replaced or self.staged is not None) as files:
                    outcome.result, outcome.points = self.process(observer, files)
            except OutputError as error:
                raise OutputError(str(error).replace(str(self.place), str(self.target))) from error
        return outcome

    def without_result(self, reason: str | None) -> TileOutcome[R]:
        """Return an outcome without a result."""
        return TileOutcome(recording=self.recording.name, error=reason)


@contextmanager
def process_tiles(
    works: Sequence[TileWork[R]], batch: BatchOptions, observer: Observer, *, replaced: bool
) -> Iterator[tuple[list[R], OutputGroup]]:
    """Process tiles; yield their results, and the files that appear at the end of the context.

    Parameters
    ----------
    works : sequence of TileWork
        Work on each tile.
    batch : BatchOptions
        How many tiles are processed at the same time.
    observer : Observer
        Receives progress and warnings.
    replaced : bool
        Whether existing files may be replaced.
    """
    if len(works) == 1:
        with OutputGroup(replace=replaced) as files, OutputGroup(files) as written:
            yield [works[0].process(observer, written)[0]], files
        return
    with _staging(works[0].target.parent) as folder, OutputGroup(replace=replaced) as files:
        staged = [replace(work, staged=folder / work.target.name) for work in works]
        outcomes = run_batch(staged, jobs_for(batch, len(works)), observer, together=True)
        with OutputGroup(files) as written:
            for work in staged:
                written.add(CompleteFile(work.place, work.target))
            yield [outcome.result for outcome in outcomes if outcome.result is not None], files


def jobs_for(batch: BatchOptions, tiles: int) -> BatchOptions:
    """Return the options with a number of processes that the memory is enough for, unless one is given."""
    if batch.jobs is not None or batch.cluster is not None:
        return batch
    return replace(batch, jobs=default_jobs(tiles, MEMORY_PER_TILE))


@contextmanager
def _staging(folder: Path) -> Iterator[Path]:
    """Return a folder for complete files in the folder of the outputs; it is removed at the end."""
    part = part_path(folder / "tiles")
    try:
        try:
            folder.mkdir(exist_ok=True)
            part.mkdir()
        except OSError as error:
            raise OutputError(f"{folder}: cannot be written ({error.strerror})") from error
        yield part
    finally:
        shutil.rmtree(part, ignore_errors=True)
        release(part)
