"""Rows of skipped recordings for the table of a filter run that goes on."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.config import Config
from seaclutter_cli.runs.batch import Work
from seaclutter_cli.runs.filter_result import FilterOutcome
from seaclutter_cli.runs.filter_table import own_table
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.resume_rows import rows_in
from seaclutter_cli.sources import Recording


@dataclass(frozen=True)
class ReadBackWork(Work[FilterOutcome]):
    """Reading of the rows of the table from a complete output; without them, the recording is filtered again.

    Parameters
    ----------
    work : Work
        Filtering of the recording.
    config : Config
        Effective configuration.
    outcome : FilterOutcome
        Outcome of the earlier run.
    """

    work: Work[FilterOutcome]
    config: Config
    outcome: FilterOutcome

    @property
    def recording(self) -> Recording:  # type: ignore[override]
        """The recording."""
        return self.work.recording

    @property
    def writes(self) -> Sequence[Path]:
        """The output, which may have to be written again."""
        return self.work.writes

    def run(self, observer: Observer) -> FilterOutcome:
        """Return the outcome of the earlier run with its rows."""
        with own_table(self.config) as table:
            rows = rows_in(self.outcome.output, self.recording.name, self.outcome.topics, table)
        if rows is None:
            observer.note("filtered again; the output lacks the diagnostics that the table needs")
            return self.work.run(observer)
        self.outcome.rows = zlib.compress(rows)
        return self.outcome

    def without_result(self, reason: str) -> FilterOutcome:
        """Return an outcome without frames."""
        return self.work.without_result(reason)
