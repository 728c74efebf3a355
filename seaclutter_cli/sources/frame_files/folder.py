"""Folders of frames, and single frame files."""

import os
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from seaclutter_cli.documents import read_document
from seaclutter_cli.errors import CloudError, InputError, opening
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import POINT_CLOUD, POSE, ros2_schema
from seaclutter_cli.messages.metadata import SIDECAR, from_text
from seaclutter_cli.paths import natural_order
from seaclutter_cli.records import Channel, Message, Record
from seaclutter_cli.sources.frame_files import FRAME_READERS, reader_of
from seaclutter_cli.sources.frame_files.sidecars import Pose, from_names, from_time_files, pose_message, poses_beside
from seaclutter_cli.sources.shared import TimedSource

_LAYOUTS = ("point_clouds", "velodyne", "velodyne_points/data", "lidar", "points", "")
_MAX_MESSAGE_BYTES = 2**32 - 2**16


class FolderSource(TimedSource):
    """A folder of frames of one format, or a single frame file, as ROS 2 point clouds on ``/points``.

    Known layouts are SeePerSea (``point_clouds/*.pcd``), KITTI (``velodyne/*.bin`` or ``velodyne_points/data/*.bin``),
    CANOE (``lidar/*.bin``), and a lidar of Pohang Canal (``points/*.bin``); otherwise the frames are in the folder
    itself. Stamps come from the file names if all contain a time, otherwise from the files of times in `sidecars`,
    otherwise from the rate. ``columns`` describe files that do not name theirs, see `parse_columns`. `InputError` if
    there are no frames, frames of several formats, or they cannot be read.
    """

    is_numbered = True

    def __init__(self, path: Path, *, rate_hz: float = 10.0, columns: str | None = None) -> None:
        super().__init__()
        doubts: list[str] = []
        with opening(path):
            files = _find_frames(path)
            self._read = reader_of(files, columns, doubts.append)
        with suppress(InputError):  # written by this program
            self.metadata = from_text(read_document(files[0].parent / SIDECAR)) if path.is_dir() else ()
        self._frames = self._stamped(files, rate_hz)
        stamps = [stamp_ns for stamp_ns, _ in self._frames]
        self._poses: Mapping[int, Pose] = {}
        try:
            found = poses_beside(files[0].parent)
            self._poses = {stamp_ns: found[stamp_ns] for stamp_ns in stamps if stamp_ns in found}
        except InputError as error:
            self.warnings.append(f"{error}; the log has no poses")
        self.warnings += doubts
        self._channel = Channel(1, "/points", "cdr", ros2_schema(POINT_CLOUD))
        self._pose_channel = Channel(2, "/pose", "cdr", ros2_schema(POSE))
        self.channels = [self._channel, self._pose_channel] if self._poses else [self._channel]
        self._times_ns = {1: stamps, 2: list(self._poses)} if self._poses else {1: stamps}
        kind = files[0].suffix[1:].upper()
        single = files == [path]
        self.format = f"{kind} file" if single else f"folder of {kind}"
        self.name = path.stem if single else (path if path.name not in ("", "..") else path.resolve()).name

    def _stamped(self, files: list[Path], rate_hz: float) -> list[tuple[int, Path]]:
        if (stamps := from_names(files)) is not None:
            return sorted(zip(stamps, files, strict=True))
        try:
            stamps = from_time_files(files)
        except InputError as error:
            self.warnings.append(f"{error}; using {rate_hz:g} frames per second")
        self.has_times = stamps is not None
        period_ns = 10**9 / Fraction(str(rate_hz))
        return list(zip(stamps or [round(index * period_ns) for index in range(len(files))], files, strict=True))

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield metadata, then a message for each readable frame, after its pose; add the others to the damage."""
        yield from self.metadata
        stamps = self._times_ns[1]
        first = 0 if start_ns is None else bisect_left(stamps, start_ns)
        last = len(stamps) if end_ns is None else bisect_left(stamps, end_ns)
        for index, (stamp_ns, file) in list(enumerate(self._frames))[first:last]:
            if stamp_ns in self._poses:
                data = pose_message(self._poses[stamp_ns], stamp_ns)
                yield Message(self._pose_channel, max(stamp_ns, 0), max(stamp_ns, 0), index, data)
            try:
                message = self._message(index, stamp_ns, file)
            except (CloudError, OSError) as error:
                problem = str(error) if isinstance(error, CloudError) else f"cannot be read: {error.strerror}"
                size = 0
                with suppress(OSError):
                    size = file.stat().st_size
                self.report(problem, size, 1, path=file)
            else:
                yield message
                del message

    def _message(self, index: int, stamp_ns: int, file: Path) -> Message:
        cloud = replace(self._read(file), stamp_ns=stamp_ns, frame_id="lidar")
        if len(cloud.data) > _MAX_MESSAGE_BYTES:
            raise CloudError(f"{len(cloud.data)} bytes of points exceed the size of a PointCloud2 message")
        data = CODECS[POINT_CLOUD, "cdr"].encode(cloud)
        return Message(self._channel, max(stamp_ns, 0), max(stamp_ns, 0), index, data)


def is_frame_folder(path: Path) -> bool:
    """Return whether a folder contains frame files, by their names and, as they may be any table, by lines of CSV."""
    from seaclutter_cli.sources.frame_files.csv import is_point_table

    with suppress(OSError):
        frames = (file for layout in _LAYOUTS for file in _frames_in(path / layout))
        return any(file.suffix.lower() != ".csv" or is_point_table(file) for file in frames)
    return False


def _find_frames(path: Path) -> list[Path]:
    if path.is_file():
        if path.suffix.lower() not in FRAME_READERS:
            raise InputError(f"{path}: not a frame file; supported suffixes: {', '.join(FRAME_READERS)}")
        return [path]
    path.stat()
    for layout in _LAYOUTS:
        if files := list(_frames_in(path / layout)):
            return sorted(_of_one_format(path, files), key=natural_order)
    raise InputError(f"{path}: no frames in this folder; supported suffixes: {', '.join(FRAME_READERS)}")


def _frames_in(folder: Path) -> Iterator[Path]:
    if folder.is_dir():
        with os.scandir(folder) as entries:
            for entry in entries:
                name = entry.name.lower()
                is_frame = Path(name).suffix in FRAME_READERS and not name.startswith(".")
                if is_frame and not name.endswith("labels.csv") and not entry.is_dir():
                    yield Path(entry.path)


def _of_one_format(path: Path, files: list[Path]) -> list[Path]:
    numbers = Counter(file.suffix.lower() for file in files)
    most, number = numbers.most_common(1)[0]
    # A few CSV files next to more frames of another format are tables about them: poses, labels, results.
    if numbers[".csv"] < number:
        del numbers[".csv"]
    if len(numbers) > 1:
        found = ", ".join(f"{number} {suffix}" for suffix, number in sorted(numbers.items()))
        raise InputError(f"{path}: frames of several formats ({found}); move each format to its own folder")
    return [file for file in files if file.suffix.lower() == most]
