"""Layouts of points in files without a header, told by what their bytes would mean.

Every known layout is judged by the values that it would give: coordinates must be within reach of a lidar, other
columns within their limits, and columns must differ from each other, which those of a wrong width do not. Bytes that
fit none, or several, are not read.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError
from seaclutter_cli.paths import open_regular
from seaclutter_cli.text import count

Points = NDArray[np.void]

_TABLE = ("x", "y", "z", "intensity", "ring", "time")
_FLOATS = [np.dtype([(name, kind) for name in _TABLE[:width]]) for kind in ("<f4", "<f8") for width in (3, 4, 5, 6)]
# github.com/utiasASRL/pycanoe, DATA_REFERENCE.md; times are in microseconds.
_CANOE = np.dtype(
    [
        *((axis, "<f8") for axis in "xyz"),
        *(("intensity", "<u2"), ("timestamp", "<u8"), ("reflectivity", "<u2"), ("ambient", "<u2")),
    ]
)
# Pohang Canal, as the Ouster driver publishes points: nanoseconds in the scan; the range may be another column's.
_OUSTER = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z", "intensity")),
        *(("t", "<u4"), ("reflectivity", "<u2"), ("ambient", "<u2"), ("range", "<u4")),
    ]
)
KITTI = _FLOATS[1]
LAYOUTS: Sequence[np.dtype[np.void]] = (*_FLOATS, _CANOE, _OUSTER)
"""Layouts by use: KITTI has four columns of float32, nuScenes five, Boreas six. Add a new one here."""

_LIMITS = {
    "intensity": (0, 100_000),
    "ring": (0, 255),
    "time": (-1, 1),
    "t": (0, 250_000_000),
    "timestamp": (946_684_800_000_000, 4_102_444_800_000_000),  # the years 2000 and 2100
}
_REACH_M = 5000
_TINY = 1e-9
"""Nonzero numbers below are other numbers' bytes."""
_RARE, _OFTEN = 0.001, 0.1
_FEW_POINTS, _FEW_VALUES = 8, 400
MANY_POINTS, _LOOKED_AT = 64, 4096
_BLOCK_BYTES, _BLOCKS = 12 * 31_920, 4
"""Blocks of a file that are looked at: whole groups of 2, 3 and 4 points of every known layout."""
_LEAST_HALF, _GREATEST_HALF, _MOST_HALVES = 0.03, 100, 0.8
_FILES = 8
_WIDEST = 16
_PERIODS = (2, 3, 4)
_TYPE = re.compile(r"[<>]?(?:[iu][1248]|f[248])")


def parse_columns(text: str) -> np.dtype[np.void]:
    """Return the layout that a list of columns describes; `ValueError` if it is not valid.

    A type after a colon is that of its column and of those before it without one; float32 is the default. Columns named
    ``_`` are left out.

    Examples
    --------
    >>> parse_columns("x,y,z,intensity,ring:f8").itemsize, parse_columns("x,y,z:f4,intensity:u2").itemsize
    (40, 14)
    """
    names, types = list[str](), list[str]()
    for part in text.split(","):
        name, colon, kind = (piece.strip() for piece in part.partition(":"))
        if not name or (colon and not _TYPE.fullmatch(kind)):
            raise ValueError("expected names, as in x,y,z,intensity,ring:f4 (types f4, f8, u1, u2, i2, ...; >f4)")
        names.append(f"_ {len(names)}" if name == "_" else name)
        types += [kind] * (len(names) - len(types)) if kind else []
    types += ["f4"] * (len(names) - len(types))
    if repeated := next((name for name in names if names.count(name) > 1), None):
        raise ValueError(f"{repeated} is named twice")
    if missing := next((axis for axis in "xyz" if axis not in names), None):
        raise ValueError(f"no column {missing}")
    return np.dtype([(name, kind if kind[0] in "<>" else f"<{kind}") for name, kind in zip(names, types, strict=True)])


def title(layout: np.dtype[np.void]) -> str:
    """Return a layout as `parse_columns` reads it."""
    alike = groupby(layout.names or (), lambda name: layout[name].str.removeprefix("<").removeprefix("|"))
    parts = [f"{','.join(name.partition(' ')[0] for name in names)}:{kind}" for kind, names in alike]
    return ",".join(parts).removesuffix(":f4")


def known_columns(text: str) -> str:
    """Return a list of columns in its usual spelling."""
    return title(parse_columns(text))


def recognise(files: Sequence[Path]) -> tuple[np.dtype[np.void], bool]:
    """Return the only layout that the bytes of files can have, judged by the largest, and whether it is proven.

    Few returns, or equal numbers, prove nothing; they are KITTI's if they can be. Files without bytes have no points in
    any layout. `CloudError` if the bytes fit no layout, or several.
    """
    largest = sorted((file for file in files if file.is_file()), key=lambda file: file.stat().st_size)[-_FILES:]
    excerpts = [excerpt for file in largest if (excerpt := _Excerpt(file)).size]
    if not excerpts:
        return KITTI, True
    votes = [sum(_fits(excerpt, layout) for excerpt in excerpts) for layout in LAYOUTS]
    structure = {kind: _Structure(excerpt.values(kind) for excerpt in excerpts) for kind in ("<f4", "<f8")}
    found = [
        layout
        for layout, number in zip(LAYOUTS, votes, strict=True)
        if number == max(votes) >= len(excerpts) / 2
        and (layout not in _FLOATS or structure[layout[0].str].allows(_width(layout)))
    ]
    few = [layout for layout in found if not structure["<f4"].varies or _are_few(excerpts, layout)]
    choice = KITTI if KITTI in few else found[0] if len(found) == 1 else None
    if choice is not None:
        is_proven = choice not in _FLOATS or structure[choice[0].str].proves(_width(choice))
        if is_proven or choice in few:
            return choice, is_proven and choice not in few
        found = []
    problem = f"{largest[-1].name} has no header, and its {count(excerpts[-1].size, 'byte')} "
    if not found:
        raise CloudError(
            f"{problem}are points of no known layout; describe it, as in --columns x,y,z,intensity,ring:f4"
        )
    choices = " or --columns ".join(map(title, found[:3]))
    raise CloudError(f"{problem}could be points of several layouts; choose one: --columns {choices}")


def points_of(content: bytes, layout: np.dtype[np.void]) -> Points:
    """Return the points in the bytes of a file; `CloudError` if they are not a whole number."""
    if len(content) % layout.itemsize:
        size = f"{layout.itemsize}, the size of a point ({title(layout)})"
        raise CloudError(f"{len(content)} bytes is not a multiple of {size}")
    points = np.frombuffer(content, layout)
    kept = [name for name in layout.names or () if not name.startswith("_ ")]
    return points if len(kept) == _width(layout) else points[kept]


def check_usual(points: Points) -> Points:
    """Return points whose columns have usual names because they had none; `CloudError` if they can hardly be that.

    A fifth column that has no numbers of rings gets a number as its name.
    """
    names, step = points.dtype.names or (), max(len(points) // _LOOKED_AT, 1)
    if "ring" in names and not _within("ring", points["ring"][::step].astype(np.float64)).all():
        points = points.view(np.dtype([(name.replace("ring", "field_4"), points.dtype[name]) for name in names]))
    if problem := doubt(points[::step]):
        raise CloudError(f"{problem}, read as {title(points.dtype)}; name the columns with --columns")
    return points


def doubt(points: Points, most: float = _OFTEN) -> str | None:
    """Return why points of columns without names are implausible for a lidar; None if they are plausible.

    A share of ``most`` of the points may be wrong in any way. Points without a return are NaN or zero.
    """
    if not len(points):
        return None
    with np.errstate(invalid="ignore"):
        xyz = np.array([points[axis] for axis in "xyz"], np.float64)
    finite = np.isfinite(xyz)
    valid = finite.all(axis=0)
    returns = valid & (xyz != 0).any(axis=0)
    with np.errstate(invalid="ignore"):
        wrong = {"coordinates": np.where(valid, (np.abs(xyz) > _REACH_M).any(axis=0), finite.any(axis=0))}
        for name in _LIMITS.keys() & set(points.dtype.names or ()):
            values = points[name].astype(np.float64)
            wrong[name] = ~(_within(name, values) | (np.isnan(values) & ~returns))
    for name, found in wrong.items():
        if np.count_nonzero(found) > most * len(points):
            return f"{name} are out of range" if name == "coordinates" else f"{name} is out of range"
    floats = [name for name in points.dtype.names or () if points.dtype[name].kind == "f"]
    tiny = [name for name in floats if _is_tiny(points[name]) or _is_pair(points[name][returns])]
    return f"values of {tiny[0]} are no measured numbers" if tiny else _odd_axis(xyz[:, returns], points)


def _within(name: str, values: NDArray[np.float64]) -> NDArray[np.bool_]:
    least, limit = _LIMITS[name]
    is_within = (values >= least) & (values <= limit)
    return is_within & (values == np.rint(values)) if name == "ring" else is_within


def _is_tiny(values: NDArray[np.floating]) -> bool:
    nonzero = np.abs(values[(values != 0) & np.isfinite(values)])
    return int(np.count_nonzero(nonzero < _TINY)) > max(_OFTEN * len(nonzero), _FEW_POINTS / 2)


def _is_pair(values: NDArray[np.floating]) -> bool:
    """Return whether numbers are two of half their size: the lower half of their bytes is a usual number, too."""
    half = values.dtype.itemsize // 2
    if half == 1 or len(values) < _FEW_POINTS:
        return False
    low = np.abs(np.ascontiguousarray(values, f"<f{2 * half}").view(f"<f{half}")[::2])
    return bool(np.mean((low > _LEAST_HALF) & (low < _GREATEST_HALF)) > _MOST_HALVES)


def _odd_axis(xyz: NDArray[np.float64], points: Points) -> str | None:
    """Return what is odd about the coordinates of returns, shape (3, N): counters, classes or brightness."""
    if xyz.shape[1] < _FEW_POINTS:
        return None
    whole = [bool((axis == np.rint(axis)).all()) for axis in xyz]
    odd = [name for name, axis, one in zip("xyz", xyz, whole, strict=True) if one and len(np.unique(axis)) > 3]
    if odd and not all(whole):
        return f"{odd[0]} has whole numbers only"
    if xyz.shape[1] >= MANY_POINTS:
        spans = np.ptp(xyz, axis=1)
        constant = [name for name, span in zip("xy", spans[:2], strict=True) if not span]
        if constant and spans.any():
            return f"{constant[0]} is always the same"
        if points.dtype.names == ("x", "y", "z") and xyz[2].min() >= 0 and spans[2]:
            return "z is never negative"
    return None


class _Excerpt:
    """Parts of a file: all of it, or some blocks."""

    def __init__(self, path: Path) -> None:
        self.size = path.stat().st_size
        whole = max(self.size - _BLOCK_BYTES, 0)
        starts = [number * whole // (_BLOCKS - 1) // _BLOCK_BYTES * _BLOCK_BYTES for number in range(_BLOCKS)]
        self._blocks: list[tuple[int, bytes]] = []
        with open_regular(path) as file:
            for start in dict.fromkeys(starts):
                file.seek(start)
                self._blocks.append((start, file.read(_BLOCK_BYTES)))

    def points(self, layout: np.dtype[np.void]) -> Points:
        size = layout.itemsize
        return np.concatenate([np.frombuffer(data[: len(data) // size * size], layout) for _, data in self._blocks])

    def values(self, kind: str) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Yield indices in the file and values, both of shape (M,), of the numbers of a type."""
        size = np.dtype(kind).itemsize
        for start, data in self._blocks:
            with np.errstate(invalid="ignore"):
                values = np.frombuffer(data[: len(data) // size * size], kind).astype(np.float64)
            yield start // size + np.arange(len(values)), values


def _are_few(excerpts: Sequence[_Excerpt], layout: np.dtype[np.void]) -> bool:
    """Return whether fewer points than a proof needs have a return."""
    points = [excerpt.points(layout) for excerpt in excerpts]
    return sum(int(np.count_nonzero((some["x"] != 0) | (some["y"] != 0))) for some in points) < MANY_POINTS


def _width(layout: np.dtype[np.void]) -> int:
    return len(layout.names or ())


def _fits(excerpt: _Excerpt, layout: np.dtype[np.void]) -> bool:
    """Return whether the bytes of a file are whole, plausible points of a layout, alike from row to row."""
    if excerpt.size % layout.itemsize:
        return False
    points = excerpt.points(layout)
    return doubt(points, _RARE) is None and (layout not in _FLOATS or not _alternates(points))


def _alternates(points: Points) -> bool:
    """Return whether every second, third or fourth row is of another kind, as if several rows were one point."""
    table = np.array([points[name] for name in points.dtype.names or ()], np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        is_zero, near = table == 0, np.sqrt((table[:3] ** 2).sum(axis=0)) < 2
        kinds = np.concatenate((is_zero, ~is_zero & (table == np.rint(table)), [near]))
    empty = is_zero[:3].all(axis=0)
    for period in _PERIODS:
        rows = [np.arange(start, len(points), period) for start in range(period)]
        full = [some[~empty[some]] for some in rows]
        shares = np.array([kinds[:, some].mean(axis=1) for some in full if len(some) >= 2 * _FEW_POINTS])
        gaps = np.array([empty[some].mean() for some in rows if len(some) >= 2 * _FEW_POINTS])
        if (len(shares) and (np.ptp(shares, axis=0) > 0.8).any()) or (len(gaps) and np.ptp(gaps) > 0.95):
            return True
    return False


class _Structure:
    """How much columns of each width differ from each other.

    Numbers of one column are of one kind. If numbers are counted in a wrong width, each column has those of all kinds,
    so that their shares of negative, whole and large numbers are equal but for chance.
    """

    def __init__(self, values: Iterable[Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]]) -> None:
        parts = [part for one in values for part in one]
        index, found = (np.concatenate(some) for some in zip(*parts, strict=True))
        with np.errstate(invalid="ignore"):
            size = np.abs(found)
            middle = np.nanmedian(size[size > 0]) if (size > 0).any() else 0.0
            kinds = [found < 0, (size > 0) & (size == np.rint(size)), size > middle, size > middle / 8, size == 0]
        self._number = len(found)
        self.varies = any((values != values[0]).any() for _, values in parts if len(values))
        self._differences = {width: _difference(index % width, kinds, width) for width in range(2, _WIDEST + 1)}

    def allows(self, width: int) -> bool:
        """Return whether no other width explains the numbers better; many numbers need an explanation."""
        own, chance = self._differences[width], _chance(width)
        for other, found in self._differences.items():
            if other % width and found > max(2 * own, _chance(other)):
                return False
            if width % other == 0 and other < width and own > chance and own - found < _chance(width - other):
                return False
        return own > chance or self._number < _FEW_VALUES or not self.varies

    def proves(self, width: int) -> bool:
        """Return whether the columns of a width differ from each other by more than chance."""
        return self._differences[width] > _chance(width)


def _chance(width: int) -> float:
    """Return what the difference of columns of one kind can hardly exceed (chi-square distribution)."""
    return width - 1 + 8 * float(np.sqrt(2 * (width - 1))) + 8


def _difference(column: NDArray[np.int64], kinds: Sequence[NDArray[np.bool_]], width: int) -> float:
    """Return the greatest difference of the shares of a kind among columns: its sum of squares over its variance."""
    totals = np.bincount(column, minlength=width).astype(np.float64)
    greatest = 0.0
    for kind in kinds:
        share = kind.mean() if len(kind) else 0
        if 0 < share < 1 and totals.min() > 0:
            shares = np.bincount(column, kind, width) / totals
            greatest = max(greatest, float((totals * (shares - share) ** 2).sum() / (share * (1 - share))))
    return greatest
