"""Files that contain one frame each."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.registry import imported
from seaclutter_cli.sources.frame_files.reading import reading


def _reader(kind: str, name: str) -> Callable[..., Cloud]:
    """Return a reader that is imported when it reads its first file, so that the start of a run is fast."""

    def read(path: Path, **options: Any) -> Cloud:
        with reading(kind):
            cloud: Cloud = imported(f"sources.frame_files.{name}")(path, **options)
            return cloud

    return read


FRAME_READERS: Mapping[str, Callable[..., Cloud]] = {
    ".pcd": _reader("PCD", "pcd.read_pcd"),
    ".ply": _reader("PLY", "ply.read_ply"),
    ".las": _reader("LAS", "las.read_las"),
    ".laz": _reader("LAS", "las.read_las"),
    ".bin": _reader("BIN", "arrays.read_bin"),
    ".npy": _reader("NPY", "arrays.read_npy"),
    ".npz": _reader("NPZ", "arrays.read_npz"),
    ".csv": _reader("CSV", "csv.read_csv"),
}
"""Readers by file suffix in lower case; they raise `CloudError` for a damaged file. Add a new format here."""


def reader_of(files: Sequence[Path], columns: str | None, warn: Callable[[str], object]) -> Callable[[Path], Cloud]:
    """Return the reader of frame files of one format and layout; `CloudError` if they do not show their layout.

    ``columns`` describe it, if the files have no names of columns. ``warn`` receives a doubt about it, or what the
    reader ignores.
    """
    suffix = files[0].suffix.lower()
    read = FRAME_READERS[suffix]
    if suffix == ".pcd":
        from seaclutter_cli.sources.frame_files.pcd import has_viewpoint

        if has_viewpoint(files[0]):
            warn(f"{files[0].name}: its VIEWPOINT is not applied to the points")
    if suffix not in (".bin", ".npy", ".csv") or (columns is None and suffix != ".bin"):
        return read
    from seaclutter_cli.sources.frame_files.headerless import parse_columns, recognise, title

    if columns is not None:
        layout = parse_columns(columns)
        return partial(read, layout=layout, is_given=True) if suffix == ".bin" else partial(read, columns=layout.names)
    layout, is_proven = recognise(files)
    if not is_proven:
        warn(f"{files[0].name}: too few points to show their layout; read as --columns {title(layout)}")
    return partial(read, layout=layout)
