"""Formats of logs: which files are in one, and how they are opened."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from seaclutter_cli.errors import InputError, opening
from seaclutter_cli.interfaces import Source
from seaclutter_cli.paths import open_regular
from seaclutter_cli.registry import Registry, imported
from seaclutter_cli.sensors.catalog import ADVICE
from seaclutter_cli.sensors.packets import DecoderOptions
from seaclutter_cli.sources.frame_files import FRAME_READERS
from seaclutter_cli.sources.frame_files.folder import FolderSource, is_frame_folder
from seaclutter_cli.sources.pcap import CAPTURE_MAGICS
from seaclutter_cli.sources.rosbag2 import is_rosbag2_folder, open_rosbag2
from seaclutter_cli.sources.shared.packet_messages import is_undecoded, packet_type
from seaclutter_cli.threads import keep_freed_memory

_HEAD_BYTES = 16


@dataclass(frozen=True)
class Format:
    """A format of single files; their first bytes (``magics``) take precedence over the suffixes of their names."""

    title: str
    suffixes: tuple[str, ...]
    magics: tuple[bytes, ...]
    source: str | type[Source]
    """Class of the source; its module and name if built in, so that the start of a run is fast."""
    decodes: bool = False

    def open(self, path: Path, decoding: DecoderOptions) -> Source:
        """Open a file of the format."""
        make: Any = imported(f"sources.{self.source}") if isinstance(self.source, str) else self.source
        source: Source = make(path, decoding) if self.decodes else make(path)
        return source


_BUILT_IN: Mapping[str, Format] = {
    "mcap": Format("MCAP", (".mcap", ".mcap.zstd"), (b"\x89MCAP0\r\n",), "mcap.source.McapSource"),
    "bag": Format("ROS 1 bag", (".bag", ".bag.active"), (b"#ROSBAG V2.0\n",), "rosbag1.source.BagSource"),
    "db3": Format("ROS 2 sqlite3", (".db3", ".db3.zstd"), (b"SQLite format 3\0",), "rosbag2.db3.Db3Source"),
    "detections": Format("Autoferry detections", ("_detections.json",), (), "detections.DetectionSource"),
    "capture": Format("PCAP", (".pcap", ".pcapng", ".cap"), CAPTURE_MAGICS, "pcap.source.CaptureSource", decodes=True),
}
"""Formats of log files. Add a new format here; formats of single frames are in `FRAME_READERS`."""


def _of_plugin(name: str, kind: type[Source]) -> Mapping[str, Format]:
    if not issubclass(kind, Source) or not (kind.suffixes or kind.magics):
        raise TypeError("must be a class based on Source with suffixes or magics")
    built_in = (*FRAME_READERS, *(suffix for form in _BUILT_IN.values() for suffix in form.suffixes))
    if taken := [suffix for suffix in kind.suffixes if suffix.endswith(built_in)]:
        raise ValueError(f"{', '.join(taken)} is taken")
    return {name: Format(kind.format, kind.suffixes, kind.magics, kind)}


SOURCES = Registry("sources", _BUILT_IN, _of_plugin)
"""Formats of log files by name."""


def is_log_name(name: str) -> bool:
    """Return whether a file is a log by its name."""
    return any(name.lower().endswith(form.suffixes) for form in SOURCES.values())


def open_source(
    path: Path, *, rate_hz: float = 10.0, columns: str | None = None, decoding: DecoderOptions | None = None
) -> Source:
    """Open a log file, a rosbag2 folder, a folder of frames or a single frame; `InputError` if it cannot be read."""
    keep_freed_memory()
    if path.is_dir():
        if is_rosbag2_folder(path):
            return wrap_packets(open_rosbag2(path, partial(open_file, decoding=decoding)), decoding)
        if is_frame_folder(path):
            return FolderSource(path, rate_hz=rate_hz, columns=columns)
        raise InputError(f"{path}: no logs or frames in this folder; supported formats: {format_names()}")
    if path.suffix.lower() in FRAME_READERS and _form_of(path) is None:
        return FolderSource(path, rate_hz=rate_hz, columns=columns)
    return wrap_packets(open_file(path, decoding), decoding)


def open_file(path: Path, decoding: DecoderOptions | None = None) -> Source:
    """Open a log file, whose format its first bytes show, else its name; raise `InputError` if it cannot be read."""
    form = _form_of(path) or next((f for f in SOURCES.values() if path.name.lower().endswith(f.suffixes)), None)
    if form is None:
        raise InputError(f"{path}: unknown format; supported formats: {format_names()}")
    return form.open(path, decoding or DecoderOptions())


def _form_of(path: Path) -> Format | None:
    """Return the format that the first bytes of a file show."""
    with opening(path), open_regular(path) as file:
        head = file.read(_HEAD_BYTES)
    return next((form for form in SOURCES.values() if head.startswith(form.magics)), None)


def wrap_packets(source: Source, options: DecoderOptions | None = None) -> Source:
    """Return a source with point clouds for its packet topics; a source without them is returned as it is.

    The first messages of packet topics are read. Known topics that cannot be decoded become warnings.
    """
    source.warnings += [
        f"{channel.topic} is not decoded: {channel.schema.name} is not supported; {ADVICE}, or convert it to this"
        for channel in source.channels
        if channel.schema and is_undecoded(channel)
    ]
    if not any(map(packet_type, source.channels)):
        return source
    from seaclutter_cli.sources.shared.packet_topics import PacketTopics

    try:
        return PacketTopics(source, options or DecoderOptions())
    except BaseException:
        source.close()
        raise


def format_names() -> str:
    """Return the names of all formats, for messages."""
    frames = (suffix.removeprefix(".").upper() for suffix in FRAME_READERS)
    return ", ".join((*(form.title for form in SOURCES.values()), *frames))
