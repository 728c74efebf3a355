"""Commands for logs."""

from seaclutter_cli.commands.options import command
from seaclutter_cli.options import Anything, option
from seaclutter_cli.runs.options.logs import ConvertOptions, FilterOptions, InfoOptions, MaskOptions, ViewOptions

COMMANDS = (
    command(
        "info",
        "runs.info:info",
        InfoOptions,
        """Show the content of LOGS: topics, frames, fields, extents, and the settings that a filter run needs.

        Every frame is read; -n N stops after the first N. Of an MCAP file of more than 16 MB in object storage, the
        summary and the first frames are read, unless -n or a time is given.
        """,
    ),
    command(
        "filter",
        "runs.filter:filter_log",
        FilterOptions,
        """Filter each frame of LOGS and write filtered logs, by default MCAP files.

        LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs.
        Every other topic, attachment and metadata record is copied unchanged: the output is a drop-in replacement for
        the input. What another format cannot keep is named in a warning. A ROS 2 recording is a folder; PCD, LAS, LAZ
        and NPZ are folders with a file for each frame.
        """,
        plan="runs.plan:plan_filter",
    ),
    command(
        "convert",
        "runs.convert:convert_log",
        ConvertOptions,
        """Convert LOGS to another format, without filtering.

        LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs. All
        topics are converted, messages between ROS 1 and ROS 2 with their definitions; what a format cannot keep is
        named in a warning. A ROS 2 recording is a folder. PCD, LAS, LAZ and NPZ are folders with a file for each frame
        of one topic, or a file if the recording has one frame.
        """,
        plan="runs.plan:plan_convert",
    ),
    command(
        "mask",
        "runs.mask:find_mask",
        MaskOptions,
        """Find own ship's masts, rails and roofs in LOGS, and write a mask of them.

        Own structure returns in the same directions at the same ranges while all else changes, so use a log under way.
        A mask has directions, by beam and azimuth, with a span of ranges; points behind the structure are kept. Several
        LOGS must be of the same lidar in the same place. Nothing is masked if the vessel seems to be at rest.

        `filter -s filter.mask=MASK.csv`, or `mask: MASK.csv` in a configuration, uses it.
        """,
    ),
    command(
        "view",
        "runs.report:view_logs",
        {"logs": option("LOGS...", "Logs.", kind=Anything()), "options": ViewOptions},
        """Show LOGS in the Rerun viewer: raw, removed and kept points, boxes, clusters and threshold curves.

        LOGS are raw logs, which are filtered first, or logs written by `filter --keep-raw --with-removed`. The viewer
        only listens on this computer. It needs the extra `view`.
        """,
        messages=("quiet", "verbose", "log_file"),
    ),
)
