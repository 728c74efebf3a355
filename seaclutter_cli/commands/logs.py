"""Commands for logs: filtering, conversion, and studies of methods on labelled logs."""

import shlex
from collections.abc import Sequence

import click

from seaclutter_cli.commands.console import ARGUMENTS
from seaclutter_cli.commands.groups import CommandGroup
from seaclutter_cli.commands.options import command
from seaclutter_cli.runs.options import logs

_OUTPUTS = ("-o", "--output", "--figures", "--log-file")
_FLAGS = ("--force", "-q", "--quiet", "-v", "--verbose", "--debug", "--json")


def _effective(arguments: Sequence[str]) -> list[str]:
    """Return the arguments as far as results depend on them: with OUT in place of outputs, and without such flags."""
    shown: list[str] = []
    for argument in arguments:
        name, equals, _ = argument.partition("=")
        if shown and shown[-1] in _OUTPUTS:
            shown.append("OUT")
        elif equals and name in _OUTPUTS:
            shown.append(f"{name}=OUT")
        elif argument.startswith("-o") and argument != "-o":
            shown.append("-oOUT")
        elif argument not in _FLAGS:
            shown.append(argument)
    return shown


_LABELS = [
    command(
        "labels check",
        "runs.labels.check_labels",
        logs.LabelCheckOptions,
        """Compare labels with the points of LOGS, and name probable mistakes with their remedies.

        Found are yaws in degrees or in the other direction, length and width or x and y swapped, centimetres and
        millimetres, positions off by a distance, boxes too small or too large, duplicates, misspelt classes, and
        labels of another recording. These are guesses from up to twelve frames. The exit status is 1 if there are any.
        `evaluate`, `tune` and `report` give the same as warnings.
        """,
        short_help="Find mistakes in labels that would give wrong rates without an error.",
    ),
    command(
        "labels propose",
        "runs.label_proposal.propose_labels",
        logs.ProposeOptions,
        """Label the objects in LOGS with boxes, for a person to correct.

        The boxes are those of `objects`, with ids, a class guessed from the size (buoy up to 2 m, small craft up to
        12 m, vessel; areas to ignore above 50 m), and a mark, sure or doubtful. Doubtful tracks come first. The labels
        are the method's own, so `evaluate` warns while they are as proposed. Correct them, then clear the mark: in a
        CSV file the column `proposed`, in JSON the key `annotator`.
        """,
        short_help="Label the objects in logs with boxes, for a person to correct.",
    ),
    command(
        "labels compare",
        "runs.labels.compare_labels",
        logs.CompareOptions,
        """Show what differs between labels A and B of the same frames: what a person corrected, how good A was.

        Boxes of a frame belong together if they overlap, seen from above. They must be numbered by frames.
        """,
        short_help="Show what was corrected in proposed labels, and how good they were.",
    ),
]

COMMANDS = (
    command(
        "info",
        "runs.info.info",
        logs.InfoOptions,
        """Show the content of LOGS: topics, frames, fields, extents, and the settings that a filter run needs.

        Every frame is read; -n N stops after the first N. Of an MCAP file of more than 16 MB in object storage, the
        summary and the first frames are read, unless -n or a time is given.
        """,
    ),
    command(
        "filter",
        "runs.filter.filter_log",
        logs.FilterOptions,
        """Filter each frame of LOGS and write filtered logs, by default MCAP files.

        LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs.
        Every other topic, attachment and metadata record is copied unchanged: the output is a drop-in replacement for
        the input. What another format cannot keep is named in a warning. A ROS 2 recording is a folder; PCD, LAS, LAZ
        and NPZ are folders with a file for each frame.
        """,
        plan="runs.plan.plan_filter",
    ),
    command(
        "convert",
        "runs.convert.convert_log",
        logs.ConvertOptions,
        """Convert LOGS to another format, without filtering.

        LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs. All
        topics are converted, messages between ROS 1 and ROS 2 with their definitions; what a format cannot keep is
        named in a warning. A ROS 2 recording is a folder. PCD, LAS, LAZ and NPZ are folders with a file for each frame
        of one topic, or a file if the recording has one frame.
        """,
        plan="runs.plan.plan_convert",
    ),
    command(
        "objects",
        "runs.objects.find_objects",
        logs.ObjectsOptions,
        """Follow the objects in LOGS over time: where they are, how large, and how they move.

        LOGS are filtered with the method `confirmed`, unless another one or a configuration is given. Clusters of the
        points that are left become tracks; a track survives if its object is hidden for up to eight seconds. Sizes are
        those of rectangles fitted over many frames. Velocities are over ground if the log has odometry or /tf,
        otherwise relative to own ship, as the column `velocity` says. The state is `confirmed`, `candidate` (seen for a
        short time only) or `lost` (hidden in this frame). Without -o, only a summary is shown.
        """,
    ),
    command(
        "suspects",
        "runs.suspects.find_suspects",
        logs.SuspectsOptions,
        """List what a filter removed from LOGS that may have been a target, and what it kept that may be clutter.

        No labels are needed. Bodies are clusters that rise out of the water, or lie alone on it; they are followed over
        time. One that is solid, stays, and moves steadily is like a target: if the filter removed it, it is a suspect,
        with its time, place, points, and the rule that removed them. Kept clusters that are not like that may be
        clutter. LOGS are raw logs, which are filtered first, or logs written by `filter --with-removed`, which are
        judged as they are, unless a method or configuration is given. The scores are indications, not rates.
        """,
    ),
    command(
        "mask",
        "runs.mask.find_mask",
        logs.MaskOptions,
        """Find own ship's masts, rails and roofs in LOGS, and write a mask of them.

        Own structure returns in the same directions at the same ranges while all else changes, so use a log under way.
        A mask has directions, by beam and azimuth, with a span of ranges; points behind the structure are kept. Several
        LOGS must be of the same lidar in the same place. Nothing is masked if the vessel seems to be at rest.

        `filter -s filter.mask=MASK.csv`, or `mask: MASK.csv` in a configuration, uses it.
        """,
    ),
    command(
        "view",
        "runs.report.view_logs",
        logs.ViewOptions,
        """Show LOGS in the Rerun viewer: raw, removed and kept points, boxes, clusters and threshold curves.

        LOGS are raw logs, which are filtered first, or logs written by `filter --keep-raw --with-removed`. The viewer
        only listens on this computer. It needs the extra `view`.
        """,
        messages=("quiet", "verbose", "log_file"),
    ),
    command(
        "calibrate",
        "runs.calibrate.calibrate",
        logs.CalibrateOptions,
        """Find the threshold of each range ring and the far limit of clutter in LOGS, and write a configuration.

        LOGS should contain sea clutter recorded by your sensor, and no targets; use --labels to leave targets out. All
        other settings, including the width of the range rings, come from the configuration given with -c. With
        -m confirmed, the mounting of the lidar is found as well.
        """,
    ),
    command(
        "evaluate",
        "runs.evaluate.evaluate",
        logs.EvaluateOptions,
        """Filter LOGS, cluster the remaining points and compare the clusters with labels.

        LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs.
        Several methods run in one pass. Frames without a label are counted, but left out of every rate.
        """,
    ),
    command(
        "tune",
        "runs.tune.tune",
        logs.TuneOptions,
        """Filter LOGS with every combination of methods and parameter values, and report the best one.

        The best combination has the fewest bad frames: those with a false alarm plus those with a missed target. Ties
        go to the combination with the fewest false alarms and missed targets, then to the first. Some of the labelled
        frames are held out: they do not take part in the choice and show what the best combination is worth on new
        data.
        """,
    ),
    command(
        "report",
        "runs.report.report",
        logs.ReportOptions,
        """Write a page that shows the effect of a filter on LOGS and, with labels, its quality.

        LOGS are raw logs, which are filtered for the report, or logs written by `filter --keep-raw --with-removed`,
        which are not filtered again. The page shows the points of selected frames: the worst, the best, and some
        evenly spaced ones.
        """,
        command=lambda: shlex.join(["seaclutter", *_effective(click.get_current_context().meta.get(ARGUMENTS, ()))]),
    ),
    CommandGroup("labels", _LABELS),
    command(
        "simulate",
        "runs.simulate.simulate",
        logs.SimulateOptions,
        """Simulate a labelled lidar recording of SCENE: a scene file (YAML), or the name of a built-in scene or layout.

        LOG.mcap has clouds with a field `label`: 0 for clutter, 65535 for own ship or ignored points, otherwise the
        number of the target. LOG.labels.csv has a box for each target and frame. LOG.pcap has packets, which carry no
        labels. A layout generates a different scene for each seed. A scene with a section `tile` is recorded from the
        air: the output is a LAS or LAZ file with the true class of each point (classification, object_class,
        object_id). `seaclutter config list` lists the built-in scenes, layouts, tiles and lidars. With --seeds, the
        recordings are OUT/SCENE_SEED.mcap, and tiles OUT/SCENE_SEED.laz.
        """,
    ),
)
