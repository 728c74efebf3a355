"""``seaclutter view``: frames in a viewer that people already use."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.options import config_options, debug_option, logs_argument, selection_options
from seaclutter_cli.commands.truths import label_options

if TYPE_CHECKING:
    from seaclutter_cli.commands.comparison import Evaluated
    from seaclutter_cli.evaluation import EvaluationParams
    from seaclutter_cli.interfaces import Labels
    from seaclutter_cli.sources import Recording
    from seaclutter_cli.viewing.stream import FrameStream


@click.command(name="view", short_help="Open logs in the viewer of Rerun.")
@logs_argument
@click.option(
    "--save",
    "target",
    type=click.Path(path_type=Path),
    metavar="FILE.rrd",
    help="Write a file for the viewer instead of opening it; needs no display.",
)
@click.option("--force", is_flag=True, help="Replace an existing file.")
@click.option("--port", type=click.IntRange(1, 65535), default=9876, show_default=True, help="Port of the viewer.")
@label_options(required=False)
@config_options
@selection_options
@click.option("-q", "--quiet", is_flag=True, help="No progress, no warnings.")
@click.option("-v", "--verbose", is_flag=True, help="Tell more.")
@debug_option
def command(logs: tuple[str, ...], **options: Any) -> None:
    """Show LOGS in the viewer of Rerun: raw, removed by reason, kept, boxes, clusters and threshold curves.

    LOGS are raw logs, which are filtered on the way, or logs that `filter --keep-raw --with-removed` has written. The
    viewer listens on this computer only. It comes with the extra `view`.
    """
    from seaclutter_cli.commands.outputs import refuse_overwriting
    from seaclutter_cli.commands.truths import labels_for
    from seaclutter_cli.sources import find_recordings
    from seaclutter_cli.viewing.stream import FrameStream, check_target, complete_file, require_rerun, viewer

    require_rerun()
    recordings = find_recordings(logs)
    target: Path | None = options["target"]
    if target:
        check_target(target)
        refuse_overwriting([target], recordings, force=options["force"])
    labels = labels_for(recordings, options["label_paths"], options) if options["label_paths"] else None
    with ExitStack() as stack:

        def open_stream(params: "EvaluationParams") -> "FrameStream":
            place = complete_file(target) if target else viewer(options["port"])
            return FrameStream(params, stack.enter_context(place))

        outcomes = _show(recordings, labels, options, open_stream)
        if all(outcome.error for outcome in outcomes):
            raise click.exceptions.Exit(1)
    if target:
        click.echo(f"{target}: {target.stat().st_size / 1e6:.1f} MB")
    if any(outcome.error for outcome in outcomes):
        raise click.exceptions.Exit(1)
    if any(outcome.damage for outcome in outcomes):
        raise click.exceptions.Exit(3)


def _show(
    recordings: "Sequence[Recording]",
    labels: "Sequence[Labels] | None",
    options: Mapping[str, Any],
    open_stream: "Callable[[EvaluationParams], FrameStream]",
) -> "list[Evaluated]":
    """Send all recordings to the viewer."""
    from seaclutter_cli.commands.judging import Job
    from seaclutter_cli.commands.replaying import Reader, filter_run
    from seaclutter_cli.commands.variants import choose_variants

    chosen = any(options[name] for name in ("config_file", "method", "overrides"))
    run = None if chosen else filter_run(recordings, options)
    names = [options["method"]] if options["method"] else []
    variants = [run.variant] if run else choose_variants(names, options["config_file"], options["overrides"])
    job = Job.of(options, variants)
    stream = open_stream(variants[0].config.evaluation)
    outcomes = []
    for number, recording in enumerate(recordings):
        truth = labels[number] if labels else None
        stream.begin(recording.name)
        if run:
            outcomes.append(Reader(job, stream).run(recording, run.topics[number], truth))
        else:
            outcomes.append(job.run(recording, truth, [], [stream]))
    stream.finish()
    return outcomes
