"""Point clouds in plain Python: generated at random, and read with loops and ``struct``."""

import struct
from dataclasses import dataclass
from typing import NamedTuple

from hypothesis import strategies as st

from seaclutter_cli.cloud import Cloud, PointField

TYPES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
SIZES = {kind: struct.calcsize(f"={code}") for kind, code in TYPES.items()}


class Field(NamedTuple):
    """A field of a cloud."""

    name: str
    offset: int
    type: str
    count: int = 1


@dataclass(frozen=True)
class Plain:
    """A cloud without derived values."""

    height: int
    width: int
    fields: tuple[Field, ...]
    point_step: int
    row_step: int
    big_endian: bool
    data: bytes
    dense: bool = True
    stamp_ns: int = 0
    frame_id: str = ""

    @property
    def points(self):
        """Return the bytes of each point."""
        starts = [row * self.row_step + k * self.point_step for row in range(self.height) for k in range(self.width)]
        return [self.data[start : start + self.point_step] for start in starts]

    def values(self, field):
        """Return the values of a field in all points as little-endian bytes, which preserve every form of NaN."""
        size = SIZES[field.type]
        starts = [field.offset + size * k for k in range(max(field.count, 1))]
        numbers = [point[start : start + size] for point in self.points for start in starts]
        return b"".join(number[::-1] if self.big_endian else number for number in numbers)

    def cloud(self, **changes):
        """Return the cloud as a `Cloud`."""
        values = {**vars(self), "fields": tuple(PointField(*field) for field in self.fields), **changes}
        return Cloud(**values)


NAMES = st.one_of(
    st.sampled_from(["x", "y", "z", "intensity", "ring", "", "unnamed", "x_"]),
    st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8),
)
STAMPS = {
    "cdr": st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1),
    "ros1": st.integers(0, 2**32 * 10**9 - 1),
}


@st.composite
def layouts(draw, *, counts=True, distinct=False):
    """Return fields in any order, with or without gaps and overlaps, and a point step that contains them."""
    fields, end = [], 0
    names = draw(st.lists(NAMES, max_size=7, unique=distinct))
    for name in names:
        kind = draw(st.sampled_from(sorted(TYPES)))
        count = draw(st.sampled_from([0, 1, 1, 1, 2, 5])) if counts else 1
        offset = draw(st.integers(0, end + 5)) if draw(st.booleans()) else end
        fields.append(Field(name, offset, kind, count))
        end = max(end, offset + SIZES[kind] * max(count, 1))
    step = end + draw(st.integers(0, 6))
    return tuple(draw(st.permutations(fields))), step


@st.composite
def plain_clouds(draw, encoding="cdr", **options):
    """Return a cloud that an encoding can represent."""
    fields, step = draw(layouts(**options))
    height = draw(st.sampled_from([1, 1, 2, 3]))
    width = draw(st.integers(0, 6)) if step else 0
    row_step = width * step + draw(st.sampled_from([0, 0, 7])) * (width > 0)
    size = height * row_step
    return Plain(
        height,
        width,
        fields,
        step,
        row_step,
        draw(st.booleans()),
        draw(st.binary(min_size=size, max_size=size)),
        draw(st.booleans()),
        draw(STAMPS[encoding]),
        draw(st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)),
    )


@st.composite
def broken(draw, data):
    """Truncate a message, change some of its bytes, or overwrite one of its sizes with a large number."""
    data = bytearray(data[: draw(st.integers(0, len(data)))] if draw(st.booleans()) else data)
    for _ in range(draw(st.integers(0, 4)) if data else 0):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    if len(data) >= 4 and draw(st.booleans()):
        at = draw(st.integers(0, len(data) - 4))
        data[at : at + 4] = struct.pack("<I", draw(st.sampled_from([0, 1, 2**16, 2**31 - 1, 2**31, 2**32 - 1])))
    return bytes(data)
