"""Recordings in the Rerun viewer: raw and filtered points, boxes, clusters and curves."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.buckets import on_paths
from seaclutter_cli.errors import InputError
from seaclutter_cli.runs.batch import prepared
from seaclutter_cli.runs.evaluate import Comparison
from seaclutter_cli.runs.methods import Variant
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.options import Logs, MethodOptions, of_options
from seaclutter_cli.runs.options.logs import ViewOptions
from seaclutter_cli.runs.outputs import may_appear
from seaclutter_cli.runs.report import filter_or_replay
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.text import printable
from seaclutter_cli.viewing import FrameStream, check_target, require_rerun, viewer


@on_paths
@of_options
def view_logs(logs: Logs, options: ViewOptions, observer: Observer = SILENT) -> "ViewResult":
    """Show recordings in the Rerun viewer, or write a file for it.

    Examples
    --------
    >>> import seaclutter
    >>> options = seaclutter.ViewOptions(target=folder / "trial.rrd")
    >>> seaclutter.view_logs("samples/sea.mcap", options).target.name  # doctest: +SKIP
    'trial.rrd'
    """
    require_rerun()
    if options.target:
        check_target(options.target)
    pairs = prepared(logs, options, {"--save": options.target}, observer)
    methods = MethodOptions(config=options.config, methods=options.method or (), settings=options.settings)
    with OutputGroup(replace=options.force) as files, ExitStack() as stack:

        def open_stream(variants: Sequence[Variant]) -> FrameStream:
            if options.target:
                part = stack.enter_context(AtomicFile(options.target, files)).part
                return FrameStream(variants[0].config.evaluation, lambda recording: recording.save(part))
            return FrameStream(variants[0].config.evaluation, stack.enter_context(viewer(options.port)))

        comparison, stream = filter_or_replay(pairs, methods, options.reading, observer, open_stream)
        stream.finish()
        if all(outcome.error for outcome in comparison.outcomes):
            raise InputError("nothing to show: no recording could be read")
        stack.close()
        if not may_appear([options.target], comparison.outcomes, observer):
            files.discard()
    return ViewResult(comparison.variants, comparison.outcomes, options.target)


@dataclass(frozen=True)
class ViewResult(Comparison):
    """Scores of recordings that were shown, and the file that was written, if it is not the viewer that showed them."""

    is_summary = True
    data = f"output=target {Comparison.data}"

    target: Path | None

    def as_text(self) -> str:
        """Return the file and its size as text; empty for the viewer."""
        return printable(f"{self.target}: {self.target.stat().st_size / 1e6:.1f} MB") if self.target else ""
