"""Files that contain one frame each."""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.sources.frame_files.reading import reading


def _reader(kind: str, module: str, function: str) -> Callable[[Path], Cloud]:
    """Return a reader that is imported when it reads its first file, so that the start of a run is fast."""

    def read(path: Path) -> Cloud:
        with reading(kind):
            cloud: Cloud = getattr(import_module(f"{__name__}.{module}"), function)(path)
            return cloud

    return read


FRAME_READERS: Mapping[str, Callable[[Path], Cloud]] = {
    ".pcd": _reader("PCD", "pcd", "read_pcd"),
    ".ply": _reader("PLY", "ply", "read_ply"),
    ".las": _reader("LAS", "las", "read_las"),
    ".laz": _reader("LAS", "las", "read_las"),
    ".bin": _reader("BIN", "arrays", "read_bin"),
    ".npy": _reader("NPY", "arrays", "read_npy"),
    ".npz": _reader("NPZ", "arrays", "read_npz"),
    ".csv": _reader("CSV", "csv", "read_csv"),
}
"""Readers by file suffix in lower case; they raise `CloudError` for a damaged file. Add a new format here."""
