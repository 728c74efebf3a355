"""Masks of own ship's structure by beam and azimuth: directions, with the ranges at which the structure returns.

A mask is a table (CSV) with a row for each sector, or an image (PNG) of beams by columns. In tables, elevation and
azimuth are those of a point in the cloud's frame, so a table fits every cloud of the same lidar in the same place, with
or without a field for the beam.
"""

import csv
import io
from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Self

import numpy as np

from seaclutter_cli.arrays import Floats, Mask
from seaclutter_cli.errors import ConfigError, FieldError, opening, requiring
from seaclutter_cli.frame import Frame
from seaclutter_cli.paths import open_regular
from seaclutter_cli.text import count

_MAX_BYTES = 16 * 2**20
_MAX_CELLS = 2**22
_DECIMALS = 3
_PNG, _DARK = b"\x89PNG\r\n\x1a\n", 128


@dataclass(frozen=True, slots=True)
class Sector:
    """A range of directions and distances that own structure occupies; lower bounds are included, upper ones not.

    Elevations are above the plane z = 0 of the cloud, azimuths from x towards y, -180 to 180.
    """

    elevation_min_deg: float
    elevation_max_deg: float
    azimuth_min_deg: float
    azimuth_max_deg: float
    range_min_m: float
    range_max_m: float

    def __post_init__(self) -> None:
        names = [field.name for field in fields(self)]
        values = astuple(self)
        if not np.isfinite(values).all():
            raise ValueError("all values must be finite numbers")
        for low, high in zip(range(0, 6, 2), range(1, 6, 2), strict=True):
            if not values[low] < values[high]:
                raise ValueError(f"{names[low]} ({values[low]:g}) must be less than {names[high]} ({values[high]:g})")
        if self.azimuth_min_deg < -180 or self.azimuth_max_deg > 180:
            raise ValueError("azimuths must be from -180 to 180")


COLUMNS = tuple(field.name for field in fields(Sector))


class StructureMask:
    """A mask of own structure, as a grid; overlapping sectors are joined, `ValueError` above 4 million cells."""

    def __init__(self, sectors: tuple[Sector, ...]) -> None:
        self.sectors = sectors
        table = np.array([astuple(one) for one in sectors], np.float64).reshape(-1, len(COLUMNS))
        self._elevations, self._azimuths = np.unique(table[:, :2]), np.unique(table[:, 2:4])
        shape = max(len(self._elevations) - 1, 0), max(len(self._azimuths) - 1, 0)
        if shape[0] * shape[1] > _MAX_CELLS:
            raise ValueError(f"{count(len(sectors), 'sector')} with too many different limits")
        self._nearest, self._farthest = np.full(shape, np.inf), np.full(shape, -np.inf)
        rows = np.searchsorted(self._elevations, table[:, :2])
        columns = np.searchsorted(self._azimuths, table[:, 2:4])
        for (top, bottom), (left, right), (near, far) in zip(rows, columns, table[:, 4:], strict=True):
            cells = np.s_[top:bottom, left:right]
            self._nearest[cells] = np.minimum(self._nearest[cells], near)
            self._farthest[cells] = np.maximum(self._farthest[cells], far)

    def contains(self, xyz: Floats, range_m: Floats) -> Mask:
        """Return whether points, shape (3, N), at ranges, shape (N,), belong to own structure."""
        inside = np.zeros(len(range_m), np.bool_)
        if not self.sectors:
            return inside
        near = np.flatnonzero(range_m < self._farthest.max())
        row = np.searchsorted(self._elevations, elevation_deg(xyz[:, near], range_m[near]), "right") - 1
        column = np.searchsorted(self._azimuths, azimuth_deg(xyz[:, near]), "right") - 1
        known = (row >= 0) & (row < len(self._nearest)) & (column >= 0) & (column < self._nearest.shape[1])
        near, cell = near[known], (row[known], column[known])
        inside[near] = (range_m[near] >= self._nearest[cell]) & (range_m[near] < self._farthest[cell])
        return inside

    def covers(self, frame: Frame) -> Mask:
        """Return whether each point of a frame belongs to own structure, shape (N,)."""
        return self.contains(frame.coordinates, frame.range_m)

    def as_csv(self) -> str:
        """Return the text of a file for `load_mask`."""
        out = io.StringIO()
        write = csv.writer(out, lineterminator="\n")
        write.writerow(COLUMNS)
        write.writerows([f"{value:.{_DECIMALS}f}" for value in astuple(one)] for one in self.sectors)
        return out.getvalue()


@dataclass(frozen=True)
class ImageMask:
    """A mask drawn as an image of beams by columns, shape (rows, columns), True where own structure is, at any range.

    Its pixels are those of clouds of the same height and width. In other clouds, a row is a beam by the field of the
    ring, the uppermost beam first, and columns are azimuths from 180° on the left to -180°.
    """

    hidden: Mask
    name: str

    def covers(self, frame: Frame) -> Mask:
        """Return whether each point of a frame belongs to own structure, shape (N,)."""
        cloud, (rows, columns) = frame.cloud, self.hidden.shape
        if (cloud.height, cloud.width) == (rows, columns):
            return self.hidden.reshape(-1).copy()
        name = cloud.ring_name
        if name is None or cloud.dtype[name].shape or cloud.dtype[name].kind not in "iu":
            size = f"{cloud.height:,} by {cloud.width:,}"
            need = f"clouds of {rows:,} by {columns:,} points, or with a field for the ring"
            raise FieldError(f"filter.mask: {self.name} needs {need}; these have {size} and none")
        found, valid = np.zeros(frame.size, np.bool_), np.flatnonzero(frame.valid)
        ring, xyz = cloud.points[name][valid].astype(np.int64), frame.coordinates[:, valid]
        if len(ring) and not 0 <= ring.min() <= ring.max() < rows:
            raise FieldError(f"filter.mask: {self.name} has {rows:,} rows, but the rings are up to {ring.max():,}")
        upwards = len(ring) > 0 and np.cov(ring, elevation_deg(xyz, frame.range_m[valid]), bias=True)[0, 1] > 0
        column = np.clip((180 - azimuth_deg(xyz)) * (columns / 360), 0, columns - 1).astype(np.int64)
        found[valid] = self.hidden[rows - 1 - ring if upwards else ring, column]
        return found

    @classmethod
    def of_png(cls, data: bytes, name: str) -> Self:
        """Return the mask of an image, in which dark pixels are own structure; `ValueError` if it is damaged."""
        with requiring("Masks that are images", "plot"):
            from PIL import Image
        try:
            with Image.open(io.BytesIO(data), formats=("PNG",)) as image:
                if image.width * image.height > _MAX_CELLS:
                    raise ValueError(f"{image.width:,} by {image.height:,} pixels are too many")
                over = Image.new("RGBA", image.size, "white")
                over.alpha_composite(image.convert("RGBA"))
                return cls(np.asarray(over.convert("L")) < _DARK, name)
        except (OSError, SyntaxError, Image.DecompressionBombError) as error:
            raise ValueError(f"cannot be decoded ({error})") from error


def load_mask(path: Path) -> StructureMask | ImageMask:
    """Return the mask in a file, CSV or PNG; `ConfigError` if it cannot be read or is not a mask."""
    with opening(f"filter.mask: {path}", ConfigError, "cannot be read"), open_regular(path) as file:
        data = file.read(_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise ConfigError(f"filter.mask: {path}: has more than {_MAX_BYTES:,} bytes")
    try:
        if data.startswith(_PNG):
            return ImageMask.of_png(data, str(path))
        return StructureMask(tuple(_sectors(data.decode())))
    except UnicodeDecodeError as error:
        raise ConfigError(f"filter.mask: {path}: neither UTF-8 text nor PNG") from error
    except (ValueError, csv.Error) as error:
        raise ConfigError(f"filter.mask: {path}: {error}") from error


def _sectors(text: str) -> Iterator[Sector]:
    rows = csv.reader(io.StringIO(text))
    head = next(rows, [])
    if sorted(head) != sorted(COLUMNS):
        raise ValueError(f"line 1: must have the columns {', '.join(COLUMNS)}")
    for row in rows:
        try:
            if len(row) != len(head):
                raise ValueError(f"must have {len(head)} values, has {len(row)}")  # noqa: TRY301 - gets its line
            yield Sector(**{name: float(value) for name, value in zip(head, row, strict=True)})
        except ValueError as error:
            raise ValueError(f"line {rows.line_num}: {error}") from error


def elevation_deg(xyz: Floats, range_m: Floats) -> Floats:
    """Return the elevation of points above the plane z = 0, shape (N,); 0 at the origin."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.degrees(np.arcsin(np.clip(np.where(range_m > 0, xyz[2] / range_m, 0), -1, 1))))


def azimuth_deg(xyz: Floats) -> Floats:
    """Return the azimuth of points from x towards y, shape (N,), in [-180, 180)."""
    azimuth = np.degrees(np.arctan2(xyz[1], xyz[0]))
    return np.asarray(np.where(azimuth == 180, -180.0, azimuth))
