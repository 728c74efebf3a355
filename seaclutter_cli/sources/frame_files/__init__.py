"""Files that contain one frame each."""

from collections.abc import Callable, Mapping
from pathlib import Path

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.sources.frame_files.binary import read_bin
from seaclutter_cli.sources.frame_files.csv import read_csv
from seaclutter_cli.sources.frame_files.las import read_las
from seaclutter_cli.sources.frame_files.npy import read_npy
from seaclutter_cli.sources.frame_files.npz import read_npz
from seaclutter_cli.sources.frame_files.pcd import read_pcd
from seaclutter_cli.sources.frame_files.ply import read_ply

FRAME_READERS: Mapping[str, Callable[[Path], Cloud]] = {
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".las": read_las,
    ".laz": read_las,
    ".bin": read_bin,
    ".npy": read_npy,
    ".npz": read_npz,
    ".csv": read_csv,
}
"""Readers by file suffix in lower case; they raise `CloudError` for a damaged file. Add a new format here."""
