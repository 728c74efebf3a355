"""Options of use cases that work on logs, find objects in them, make labelled ones, or study methods on them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from seaclutter_cli.errors import UsageError
from seaclutter_cli.options import (
    Anything,
    Converted,
    Number,
    OptionalPath,
    Parsed,
    Place,
    UseCase,
    Whole,
    option,
    optional,
)
from seaclutter_cli.runs.options import (
    LABELS_HELP,
    BatchOptions,
    ConfigOptions,
    LabelSources,
    MethodOptions,
    Observed,
    OfLabelledLogs,
    OfLogs,
    Replacing,
)
from seaclutter_cli.sinks.options import FORMAT, ContentOptions

if TYPE_CHECKING:
    from pathlib import Path

    from seaclutter_cli.runs.methods import Sweep
    from seaclutter_cli.urls import PathLike

_RANGE = re.compile(r"\s*(\d{1,9})(?:\s*(?:\.\.|-)\s*(\d{1,9}))?\s*")
_MAX_SEEDS = 100_000


class WritingLogs(Replacing, ContentOptions, BatchOptions, OfLogs):
    """Options of functions that write a log for each recording."""

    output: PathLike = option(
        "-o --output OUT",
        "Output of one recording; folder for several, or with a slash at its end.",
        kind=Place(remote=True, output=True, or_folder=True),
        kw_only=False,
    )
    to: str | None = optional("--to", "Format of the output. [default: by the suffix of OUT, or mcap]", kind=FORMAT)


class FilterOptions(WritingLogs, LabelSources, ConfigOptions):
    """Filter each frame of LOGS and write filtered logs, by default MCAP files.

    LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs.
    Every other topic, attachment and metadata record is copied unchanged: the output is a drop-in replacement for
    the input. What another format cannot keep is named in a warning. A ROS 2 recording is a folder; PCD, LAS, LAZ
    and NPZ are folders with a file for each frame.
    """

    use_case = UseCase("filter", "runs.filter.filter_log", plan="runs.plan.plan_filter")

    csv_file: OptionalPath = optional("--csv", "Also write a table with a row for each frame.")
    objects_file: OptionalPath = optional(
        "--objects FILE", "Also write a table of objects over time, as the command `objects` does."
    )
    with_scene: bool = optional(
        "--with-scene",
        "Write boxes around clusters, objects with their ids, and the boxes of --labels to /seaclutter/scene, for 3D "
        "panels; objects also to /seaclutter/objects.",
    )
    suspects: bool = optional(
        "--suspects",
        "Say in the summary how much was removed that may have been a target, as the command `suspects` finds it.",
    )


class ConvertOptions(WritingLogs):
    """Convert LOGS to another format, without filtering.

    LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs. All
    topics are converted, messages between ROS 1 and ROS 2 with their definitions; what a format cannot keep is
    named in a warning. A ROS 2 recording is a folder. PCD, LAS, LAZ and NPZ are folders with a file for each frame
    of one topic, or a file if the recording has one frame.
    """

    use_case = UseCase("convert", "runs.convert.convert_log", plan="runs.plan.plan_convert")

    left_out = ("intensity_field", "keep_raw", "with_removed", "keep_organized", "diagnostics")


class InfoOptions(BatchOptions, OfLogs):
    """Show the content of LOGS: topics, frames, fields, extents, and the settings that a filter run needs.

    Every frame is read; -n N stops after the first N. Of an MCAP file of more than 16 MB in object storage, the
    summary and the first frames are read, unless -n or a time is given.
    """

    use_case = UseCase("info", "runs.info.info")
    left_out = ("resume", "manifest")


class MaskOptions(Replacing, OfLogs):
    """Find own ship's masts, rails and roofs in LOGS, and write a mask of them.

    Own structure returns in the same directions at the same ranges while all else changes, so use a log under way.
    A mask has directions, by beam and azimuth, with a span of ranges; points behind the structure are kept. Several
    LOGS must be of the same lidar in the same place. Nothing is masked if the vessel seems to be at rest.

    `filter -s filter.mask=MASK.csv`, or `mask: MASK.csv` in a configuration, uses it.
    """

    use_case = UseCase("mask", "runs.mask.find_mask")

    output: OptionalPath = option(
        "-o --output MASK.csv", "Write the mask, for the configuration key filter.mask.", default=None, kw_only=False
    )
    plot_file: OptionalPath = optional("--plot", "Draw the mask (.png or .svg).")
    reach_m: float = option(
        "--reach METRES",
        "Range up to which structure is searched; somewhat more than own ship's length.",
        default=20.0,
        kind=Number(1, 100),
    )


class ViewOptions(Replacing, OfLogs, LabelSources, ConfigOptions):
    """Show LOGS in the Rerun viewer: raw, removed and kept points, boxes, clusters and threshold curves.

    LOGS are raw logs, which are filtered first, or logs written by `filter --keep-raw --with-removed`. The viewer
    only listens on this computer. It needs the extra `view`.
    """

    use_case = UseCase("view", "runs.report.view_logs", messages=("quiet", "verbose", "log_file"))

    target: OptionalPath = optional(
        "--save FILE.rrd",
        "Write a file for the viewer instead of opening it; needs no display.",
        kind=Place(output=True),
    )
    port: int = option("--port", "Port of the viewer.", default=9876, kind=Whole(1, 65535))


class CalibrateOptions(Replacing, BatchOptions, OfLogs, LabelSources, ConfigOptions):
    """Find the threshold of each range ring and the far limit of clutter in LOGS, and write a configuration.

    LOGS should contain sea clutter recorded by your sensor, and no targets; use --labels to leave targets out. All
    other settings, including the width of the range rings, come from the configuration given with -c. With
    -m confirmed, the mounting of the lidar is found as well.
    """

    use_case = UseCase("calibrate", "runs.calibrate.calibrate")
    left_out = ("fail_fast", "resume", "manifest")

    output: OptionalPath = option(
        "-o --output CONFIG", "Configuration to write, for filter -c.", default=None, required=True
    )
    filter_rate: float = option(
        "--filter-rate SHARE",
        "Share of the clutter points in each range ring that its threshold must remove.",
        default=0.8,
        kind=Number(0, 1, above=True),
    )
    max_left: float | None = optional(
        "--max-left POINTS",
        "Raise the filter rate of a range ring until at most POINTS clutter points per frame are left.",
        kind=Number(0, above=True),
    )
    choose: bool = optional(
        "--choose",
        "With --labels: compare values of --filter-rate and --max-left on held-out frames, and use the one with "
        "the fewest frames with an error.",
    )
    trade_off: bool = optional("--trade-off", "With --labels: show what these values cost and gain, without choosing.")
    keep_end: bool = optional(
        "--keep-end", "Keep the far limit end_m of the configuration; implied by -s filter.end_m=METRES."
    )
    plot_file: OptionalPath = optional("--plot", "Also plot clutter and thresholds over range (.png or .svg).")


class EvaluateOptions(Replacing, BatchOptions, OfLabelledLogs, MethodOptions):
    """Filter LOGS, cluster the remaining points and compare the clusters with labels.

    LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs.
    Several methods run in one pass. Frames without a label are counted, but left out of every rate.
    """

    use_case = UseCase("evaluate", "runs.evaluate.evaluate")
    left_out = ("resume",)

    labels: Converted[PathLike | Sequence[PathLike] | None, tuple[Path, ...]] = option(
        "--labels LABELS", LABELS_HELP, default=(), kind=Place(remote=True), kw_only=False
    )
    without_labels: bool = optional(
        "--without-labels", "Show indications of the quality of methods that need no labels."
    )
    frames_file: OptionalPath = optional(
        "-o --output FRAMES.csv", "Write a table with a row for each frame and method."
    )
    summary_file: OptionalPath = optional("--summary FILE.json", "Write all results as JSON.")
    clustering: Literal["euclidean", "dbscan"] | None = optional(
        "--clustering",
        "Clustering algorithm; by default that of the configuration. With dbscan, also show its measures.",
    )


class LabelCheckOptions(BatchOptions, OfLabelledLogs):
    """Compare labels with the points of LOGS, and name probable mistakes with their remedies.

    Found are yaws in degrees or in the other direction, length and width or x and y swapped, centimetres and
    millimetres, positions off by a distance, boxes too small or too large, duplicates, misspelt classes, and
    labels of another recording. These are guesses from up to twelve frames. The exit status is 1 if there are any.
    `evaluate`, `tune` and `report` give the same as warnings.
    """

    use_case = UseCase(
        "labels check",
        "runs.labels.check_labels",
        short_help="Find mistakes in labels that would give wrong rates without an error.",
    )
    left_out = ("resume", "manifest")


class _Sweeps(Parsed):
    """Sweeps in the form of the command line, or keys and values."""

    def check_all(self, values: Any, name: str) -> Any:
        if not isinstance(values, Mapping):
            return super().check_all(values, name)
        from seaclutter_cli.runs.methods import Sweep

        return tuple(Sweep(key, tuple(tried)) for key, tried in values.items())


class TuneOptions(Replacing, BatchOptions, OfLabelledLogs, MethodOptions):
    """Filter LOGS with every combination of methods and parameter values, and report the best one.

    The best combination has the fewest bad frames: those with a false alarm plus those with a missed target. Ties
    go to the combination with the fewest false alarms and missed targets, then to the first. Some of the labelled
    frames are held out: they do not take part in the choice and show what the best combination is worth on new
    data.
    """

    use_case = UseCase("tune", "runs.tune.tune")
    left_out = ("resume", "manifest")

    sweeps: Converted[Mapping[str, Sequence[Any]] | Sequence[str], tuple[Sweep, ...]] = option(
        "--sweep KEY=VALUES",
        "Filter key and values to try: V1,V2,... or START:STOP:STEP. Repeatable, for all combinations. Of several "
        "methods, those that have the key; METHOD.KEY for one.",
        default=(),
        kind=_Sweeps("runs.methods.parse_sweep"),
        kw_only=False,
    )
    hold_out: float = option(
        "--hold-out SHARE",
        "Share of the recordings, or of fewer than four the last frames of each, on which the best combination is "
        "judged but not chosen; 0 for none.",
        default=0.25,
        kind=Number(0, 1, below=True),
    )
    output: OptionalPath = optional("-o --output CONFIG.yaml", "Write the configuration with the best values.")
    csv_file: OptionalPath = optional("--csv", "Write a table with a row for each combination.")
    curve_file: OptionalPath = optional("--plot", "Plot the rates over the values of a single --sweep (.png or .svg).")
    thresholds_file: OptionalPath = optional(
        "--plot-thresholds",
        "Plot the threshold of a range ring over the frames for each combination and the ideal one (.png, .svg).",
    )
    ring: int = option("--ring K", "Range ring of --plot-thresholds, from 1.", default=2, kind=Whole(1))


class ReportOptions(Replacing, OfLogs, LabelSources, MethodOptions):
    """Write a page that shows the effect of a filter on LOGS and, with labels, its quality.

    LOGS are raw logs, which are filtered for the report, or logs written by `filter --keep-raw --with-removed`,
    which are not filtered again. The page shows the points of selected frames: the worst, the best, and some
    evenly spaced ones.
    """

    use_case = UseCase("report", "runs.report.report")

    output: Converted[PathLike, Path] = option(
        "-o --output REPORT.html", "HTML page to write; one file that opens offline in any browser.", kw_only=False
    )
    figure_folder: OptionalPath = optional(
        "--figures DIR", "Also write every figure as a separate file for print.", kind=Place(remote=True)
    )
    figure_format: Literal["svg", "png"] = option("--figure-format", "Format of --figures.", default="svg")
    shown: int = option(
        "--show", "Number of frames whose points are included in the page.", default=12, kind=Whole(1, 100)
    )
    picks: Converted[int | Sequence[int], tuple[int, ...]] = option(
        "--pick K", "Also show frame K; repeatable.", default=(), kind=Whole(0)
    )
    command: str | None = optional("", "Command line that the page shows.")


class ObjectsOptions(Replacing, BatchOptions, OfLogs, ConfigOptions):
    """Follow the objects in LOGS over time: where they are, how large, and how they move.

    LOGS are filtered with the method `confirmed`, unless an option or a configuration names another. Clusters of the
    points that are left become tracks; a track survives if its object is hidden for up to eight seconds. Sizes are
    those of rectangles fitted over many frames. Velocities are over ground if the log has odometry or /tf,
    otherwise relative to own ship, as the column `velocity` says. The state is `confirmed`, `candidate` (seen for a
    short time only) or `lost` (hidden in this frame). Without -o, only a summary is shown.
    """

    use_case = UseCase("objects", "runs.objects.find_objects")
    left_out = ("resume", "manifest")

    output: OptionalPath = option(
        "-o --output OBJECTS",
        "Write a table with a row for each frame and object (.csv, .parquet), or tracks on earth (.geojson).",
        default=None,
        kw_only=False,
    )


class ProposeOptions(Replacing, BatchOptions, OfLogs, ConfigOptions):
    """Label the objects in LOGS with boxes, for a person to correct.

    The boxes are those of `objects`, with ids, a class guessed from the size (buoy up to 2 m, small craft up to
    12 m, vessel; areas to ignore above 50 m), and a mark, sure or doubtful. Doubtful tracks come first. The labels
    are the method's own, so `evaluate` warns while they are as proposed. Correct them, then clear the mark: in a
    CSV file the column `proposed`, in JSON the key `annotator`.
    """

    use_case = UseCase(
        "labels propose",
        "runs.label_proposal.propose_labels",
        short_help="Label the objects in logs with boxes, for a person to correct.",
    )
    left_out = ("resume", "manifest")

    output: PathLike = option(
        "-o --output LABELS",
        "Labels of one recording; folder with RECORDING.labels.csv for each of several, or with a slash at its end.",
        kind=Place(output=True, or_folder=True),
        kw_only=False,
    )
    to: Literal["csv", "sustechpoints", "seepersea"] = option(
        "--to", "Form of the labels; sustechpoints and seepersea are folders with the clouds.", default="csv"
    )


class CompareOptions(Observed):
    """Show what differs between labels A and B of the same frames: what a person corrected, how good A was.

    Boxes of a frame belong together if they overlap, seen from above. They must be numbered by frames.
    """

    use_case = UseCase(
        "labels compare",
        "runs.labels.compare_labels",
        short_help="Show what was corrected in proposed labels, and how good they were.",
    )

    proposed: Converted[PathLike, Path] = option(
        "A", "Labels before they were corrected, as `labels propose` wrote them.", kind=Place(), kw_only=False
    )
    corrected: Converted[PathLike, Path] = option(
        "B", "Labels of the same frames after that.", kind=Place(), kw_only=False
    )


class SuspectsOptions(Replacing, BatchOptions, OfLogs, ConfigOptions):
    """List what a filter removed from LOGS that may have been a target, and what it kept that may be clutter.

    No labels are needed. Bodies are clusters that rise out of the water, or lie alone on it; they are followed over
    time. One that is solid, stays, and moves steadily is like a target: if the filter removed it, it is a suspect,
    with its time, place, points, and the rule that removed them. Kept clusters that are not like that may be
    clutter. LOGS are raw logs, which are filtered first, or logs written by `filter --with-removed`, which are
    judged as they are, unless a method or configuration is given. The scores are indications, not rates.
    """

    use_case = UseCase("suspects", "runs.suspects.find_suspects")
    left_out = ("resume", "manifest")

    output: OptionalPath = option(
        "-o --output SUSPECTS.csv", "Write a table with a row for each suspect.", default=None, kw_only=False
    )
    picture_folder: OptionalPath = optional(
        "--pictures DIR",
        "Draw each suspect that is shown, before and after the filter; reads the logs twice.",
        kind=Place(remote=True),
    )
    shown: int = option("--show", "Number of suspects of each kind to show.", default=10, kind=Whole(1, 500))


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds of numbers and ranges, such as ``1..4,9``, each once; raise `UsageError` for other text."""
    seeds: dict[int, None] = {}
    for part in text.split(","):
        found = _RANGE.fullmatch(part)
        first = int(found[1]) if found else 0
        last = int(found[2] or first) if found else -1
        if not 0 <= last - first < _MAX_SEEDS - len(seeds):
            raise UsageError(f"--seeds {text}: write numbers and ranges, such as 1..5 or 1,2,7; at most {_MAX_SEEDS:,}")
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return tuple(seeds)


class SimulateOptions(Replacing, BatchOptions, Observed):
    """Simulate a labelled lidar recording of SCENE: a scene file (YAML), or the name of a built-in scene or layout.

    LOG.mcap has clouds with a field `label`: 0 for clutter, 65535 for own ship or ignored points, otherwise the
    number of the target. LOG.labels.csv has a box for each target and frame. LOG.pcap has packets, which carry no
    labels. A layout generates a different scene for each seed. A scene with a section `tile` is recorded from the
    air: the output is a LAS or LAZ file with the true class of each point (classification, object_class,
    object_id). `seaclutter config list` lists the built-in scenes, layouts, tiles and lidars. With --seeds, the
    recordings are OUT/SCENE_SEED.mcap, and tiles OUT/SCENE_SEED.laz.
    """

    use_case = UseCase("simulate", "runs.simulate.simulate")
    left_out = ("resume", "manifest")

    scene: PathLike = option(
        "SCENE",
        "Scene file (YAML), or the name of a built-in scene, layout or tile scene.",
        kind=Anything(),
        kw_only=False,
    )
    output: PathLike = option(
        "-o --output OUT",
        "Recording to write; .las or .laz for a tile; with --seeds, a folder.",
        kind=Place(output=True, or_folder=True),
        kw_only=False,
    )
    frames: int | None = optional("-n --frames", "Number of frames; overrides the scene.", kind=Whole(1))
    seed: int | None = optional("--seed", "Random seed; overrides the scene. 1 by default for a layout.", kind=Whole(0))
    physics: Literal["wide"] | None = optional(
        "--physics",
        "Draw water, weather, lidar and own ship from ranges of published physics; with SCENE random, all of it.",
    )
    lidar: str | None = optional("--lidar NAME", "Lidar model; overrides the scene.")
    form: Literal["mcap", "pcap"] | None = optional(
        "--format", "MCAP with PointCloud2, or packets of a RoboSense lidar; by default from the suffix of LOG."
    )
    scene_file: OptionalPath = optional(
        "--scene-file YAML", "Save the scene with all defaults and comments, for editing."
    )
    seeds: Converted[str | Sequence[int] | None, tuple[int, ...] | None] = optional(
        "--seeds SEEDS", "Simulate a recording for each seed, such as 1..5 or 1,2,7.", kind=Parsed(parse_seeds)
    )
