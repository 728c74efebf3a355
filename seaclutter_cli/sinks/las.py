"""LAS and LAZ files that preserve everything in their source file."""

from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import MissingExtraError, OutputError, requiring
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup

Column = NDArray[Any]
ExtraDims = Mapping[str, tuple[str, str]]
"""Numpy type string and description of each extra dimension, by name."""

_USER = "seaclutter"
_INDEX_USER = "copc"
_FIRST = "1.0"
_DIMENSIONS = ("LASF_Spec", 4)
"""User id and record id of the record that describes extra dimensions."""
_DIMENSION_BYTES = 192
"""Size of the description of one extra dimension."""
_LAYERED_WAVEFORMS = (9, 10)
"""Point formats whose waveform packets LAZ compresses by scanner channel."""
_KEPT = ("maxs", "mins", "number_of_points_by_return")


@dataclass(frozen=True)
class TextRecord:
    """Record (VLR) of a LAS file with text, under the user id ``seaclutter``; descriptions have up to 32 bytes."""

    number: int
    description: str


def import_laspy(*, packed: bool = False) -> Any:
    """Return laspy; raise `MissingExtraError` if it, or its backend for ``packed`` files, is not installed."""
    with requiring("LAS/LAZ", "las"):
        import laspy  # optional dependency
    if packed and not laspy.LazBackend.LazrsParallel.is_available():
        raise MissingExtraError("LAZ", "las")
    return laspy


def with_texts(header: Any, texts: Mapping[TextRecord, str]) -> Any:
    """Return a copy of a header with text records; they replace those of an earlier run."""
    changed, vlr = deepcopy(header), import_laspy().VLR
    own = {record.number for record in texts}
    changed.vlrs[:] = [one for one in changed.vlrs if one.user_id != _USER or one.record_id not in own]
    changed.vlrs.extend(vlr(_USER, record.number, record.description, text.encode()) for record, text in texts.items())
    return changed


def text_in(header: Any, record: TextRecord) -> str | None:
    """Return the text of a record in a header; None if there is none."""
    found = [one for one in header.vlrs if (one.user_id, one.record_id) == (_USER, record.number)]
    return bytes(found[-1].record_data).decode(errors="replace") if found else None


def _add(laspy: Any, header: Any, added: ExtraDims) -> None:
    """Add dimensions to a header and their descriptions to its records; other records are not changed."""
    records = list(header.vlrs)
    header.add_extra_dims([laspy.ExtraBytesParams(name, kind, text) for name, (kind, text) in added.items()])
    whole = header.vlrs.get("ExtraBytesVlr")[0].record_data_bytes()
    new = whole[-_DIMENSION_BYTES * len(added) :]
    old = next((one for one in records if (one.user_id, one.record_id) == _DIMENSIONS), None)
    intact = old is not None and len(old.record_data_bytes()) + len(new) == len(whole)
    data = old.record_data_bytes() + new if old is not None and intact else whole
    described = laspy.VLR(*_DIMENSIONS, old.description if old is not None else "Extra Bytes Record", data)
    header.vlrs[:] = [described if one is old else one for one in records] + ([described] if old is None else [])


def _checked(laspy: Any, path: Path, header: Any) -> Any:
    """Return a header that can be written; LAS 1.0 becomes LAS 1.2, which gives four reserved bytes a meaning."""
    for records in (header.vlrs, getattr(header, "evlrs", None)):
        if records:  # the index of a COPC file is of chunks that an output does not have
            records[:] = [one for one in records if one.user_id != _INDEX_USER]
    if str(header.version) == _FIRST:
        header.version = laspy.header.Version(1, 2)
        header.file_source_id = 0
        header.global_encoding = laspy.header.GlobalEncoding()
    if str(header.version) not in laspy.supported_versions():
        raise OutputError(f"{path}: LAS {header.version} cannot be written; convert the source to LAS 1.4 or earlier")
    return header


def write_las(
    path: Path,
    header: Any,
    parts: Iterable[tuple[Any, Mapping[str, Column]]],
    extra: ExtraDims,
    *,
    whole: bool = False,
    group: OutputGroup | None = None,
) -> None:
    """Write points of a LAS or LAZ file, part by part, with some dimensions changed or added.

    A part is n points of the source, which are not modified, and new values, shape (n,), for some dimensions. Scale,
    offset and all other dimensions are preserved, as are the packed coordinates, the header and its records (VLR and
    EVLR). The file extension of the target selects LAZ or LAS. LAS 1.0 becomes LAS 1.2. If the ``whole`` source is
    written, its extents and counts are kept, even if they are wrong.

    `MissingExtraError` if laspy or its LAZ backend is not installed; `OutputError` if the file cannot be written, or
    waveform packets of the source would be changed.
    """
    packed = path.suffix.lower() == ".laz"
    laspy = import_laspy(packed=packed)
    own = _checked(laspy, path, deepcopy(header))
    known = set(header.point_format.dimension_names)
    added = {name: spec for name, spec in extra.items() if name not in known}
    if added:
        _add(laspy, own, added)
    with AtomicFile(path, group) as file:
        writer = _start(laspy, file, own, packed=packed)
        has_layers, channels = packed and own.point_format.id in _LAYERED_WAVEFORMS, set[int]()
        for points, columns in parts:
            if has_layers:
                channels.update(np.unique(np.asarray(points["scanner_channel"])).tolist())
            if len(channels) > 1:  # from the second channel on, lazrs compresses wrong values
                raise OutputError(
                    f"{path}: waveform packets of several scanner channels would be changed in LAZ; write LAS"
                )
            record = laspy.PackedPointRecord(points.array.copy(), points.point_format)
            if added:
                record = laspy.PackedPointRecord.from_point_record(record, own.point_format)
            for name, values in columns.items():
                record[name] = values
            writer.write_points(record)
        if evlrs := getattr(own, "evlrs", None):
            writer.write_evlrs(evlrs)
        for name in _KEPT if whole else ():
            setattr(writer.header, name, getattr(own, name))
        writer.close()


def _start(laspy: Any, file: AtomicFile, header: Any, *, packed: bool) -> Any:
    try:
        return laspy.LasWriter(
            file.stream,
            header,
            do_compress=packed,
            laz_backend=laspy.LazBackend.LazrsParallel if packed else None,
            closefd=False,
            encoding_errors="surrogateescape",  # descriptions should be ASCII, but need not be
        )
    except Exception as error:
        raise OutputError(f"{file.path}: cannot be written as LAS ({error})") from error
