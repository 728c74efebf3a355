"""Formats of outputs: how each is written, and which names select it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seaclutter_cli.errors import UsageError
from seaclutter_cli.messages.metadata import SIDECAR
from seaclutter_cli.registry import Registry, imported
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.options import ROSBAG2_METADATA, McapOptions

if TYPE_CHECKING:
    from seaclutter_cli.sinks.frames import FrameSink
    from seaclutter_cli.sinks.log import LogSink


@dataclass(frozen=True)
class OutputFormat:
    """A format of outputs, named by its title in the plural.

    Its writer is a `LogOutput`, or a function that writes a frame, as those in `FRAME_WRITERS`; those that are built in
    are given by module and name, or by name. A suffix selects the format, unless it has folders only; ``compressions``
    have their names in MCAP. If a recording becomes a folder, the file ``marker`` in it tells so.
    """

    title: str
    writer: Any
    suffix: str
    compressions: tuple[str, ...] = ("",)
    marker: str = ""

    @property
    def is_folder(self) -> bool:
        """Whether a recording becomes a folder."""
        return bool(self.marker)

    @property
    def has_topics(self) -> bool:
        """Whether it is a log, not files that have one frame of one topic each."""
        return "." in self.writer if isinstance(self.writer, str) else isinstance(self.writer, type)

    def make_sink(self, path: Path, options: McapOptions, group: OutputGroup) -> "LogSink | FrameSink":
        """Return the sink, which is imported on demand, with the libraries for its format."""
        if not self.has_topics:
            from seaclutter_cli.sinks.frames import FrameSink
            from seaclutter_cli.sinks.point_files import FRAME_WRITERS

            write = FRAME_WRITERS[self.writer] if isinstance(self.writer, str) else self.writer
            return FrameSink(path, options, group, write, self.suffix)
        from seaclutter_cli.sinks.log import LogSink

        output = imported(f"sinks.{self.writer}") if isinstance(self.writer, str) else self.writer
        return LogSink(path, options, group, output)


_MCAP = ("zstd", "lz4", "")

_BUILT_IN: Mapping[str, OutputFormat] = {
    "mcap": OutputFormat("MCAP files", "mcap_writer.McapOutput", ".mcap", _MCAP),
    "bag": OutputFormat("ROS 1 bags", "bag_writer.BagOutput", ".bag", ("lz4", "")),
    "rosbag2-db3": OutputFormat("ROS 2 recordings in sqlite3", "rosbag2.Db3Output", ".db3", marker=ROSBAG2_METADATA),
    "rosbag2-mcap": OutputFormat("ROS 2 recordings in MCAP", "rosbag2.McapFolderOutput", "", _MCAP, ROSBAG2_METADATA),
    **{
        name: OutputFormat(f"{name.upper()} files", name, f".{name}", marker=SIDECAR)
        for name in ("pcd", "las", "laz", "npz")
    },
}
"""Formats by the names that ``--to`` takes. To add a format, add a line here."""


def _of_plugin(name: str, form: OutputFormat) -> Mapping[str, OutputFormat]:
    if not isinstance(form, OutputFormat) or not form.suffix:
        raise TypeError("must be an OutputFormat with a suffix")
    if form.suffix in (known.suffix for known in _BUILT_IN.values()):
        raise ValueError(f"{form.suffix} is taken")
    return {name: form if form.has_topics else replace(form, marker=SIDECAR)}


OUTPUT_FORMATS = Registry("sinks", _BUILT_IN, _of_plugin)
"""Formats of outputs by name."""


def check_options(form: str, options: McapOptions, *, with_scene: bool = False) -> None:
    """Raise `UsageError` if a format does not have what options ask for."""
    kind = OUTPUT_FORMATS[form]
    if options.compression is not None and options.compression not in kind.compressions:
        names = ", ".join(name or "none" for name in kind.compressions)
        raise UsageError(f"--compression: {kind.title} have {names}")
    if kind.has_topics:
        return
    given = {
        "--keep-raw": options.keep_raw,
        "--with-removed": options.with_removed,
        "--with-scene": with_scene,
        "--split": options.split is not None,
        "--include": options.include,
        "--exclude": options.exclude,
    }
    if wrong := [name for name, is_given in given.items() if is_given]:
        raise UsageError(f"{', '.join(wrong)}: {kind.title} have no topics; write a log, or leave out the option")


def format_of(output: Path, name: str | None) -> str:
    """Return the format that was asked for, or of the suffix, or MCAP; `UsageError` if the suffix is another."""
    meant = format_of_suffix(output.suffix.lower())
    chosen = name or meant or "mcap"
    if meant and OUTPUT_FORMATS[meant].is_folder and OUTPUT_FORMATS[meant].has_topics:
        raise UsageError(f"{output}: a ROS 2 recording is a folder; use -o {output.stem} --to {meant}")
    if meant and meant != chosen:
        raise UsageError(f"{output}: has the suffix of other files than --to {chosen}; choose another name")
    return chosen


def is_single_frame(output: Path) -> bool:
    """Return whether the name of an output is that of a file with one frame."""
    form = format_of_suffix(output.suffix.lower())
    return form is not None and not OUTPUT_FORMATS[form].has_topics


def format_of_suffix(suffix: str) -> str | None:
    """Return the name of the format that a suffix selects; None if there is none."""
    return next((name for name, form in OUTPUT_FORMATS.items() if suffix and form.suffix == suffix), None)
