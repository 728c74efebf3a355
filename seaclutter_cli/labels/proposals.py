"""Proposed labels from tracks of objects, and their files."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, BinaryIO

from seaclutter_cli.labels.boxes import IGNORE, Labelled, Proposal
from seaclutter_cli.labels.csv import COLUMNS, PROPOSED
from seaclutter_cli.labels.json_boxes import SEEPERSEA, SUSTECHPOINTS, JsonForm

FOLDER_FORMS: Mapping[str, JsonForm] = {"sustechpoints": SUSTECHPOINTS, "seepersea": SEEPERSEA}
"""Forms with a folder for each recording; a CSV file is the other one."""

SURE, DOUBTFUL = "sure", "doubtful"
LEAST_FRAMES = 3


def proposals(rows: Iterable[Mapping[str, Any]]) -> list[Proposal]:
    """Return a box for each row of a table of objects, doubtful tracks first, then by track and frame.

    Tracks that were seen in fewer than three frames are left out. The boxes of a track in which it was not confirmed
    are doubtful.
    """
    tracks: dict[int, list[Mapping[str, Any]]] = {}
    for row in rows:
        tracks.setdefault(row["track_id"], []).append(row)
    found = []
    for number, own in tracks.items():
        if sum(row["state"] != "lost" for row in own) < LEAST_FRAMES:
            continue
        ((kind, _),) = Counter(row["class"] for row in own).most_common(1)
        kind = IGNORE if kind == "structure" else kind
        for row in own:
            center, size = (row["x_m"], row["y_m"], row["z_m"]), (row["length_m"], row["width_m"], row["height_m"])
            labelled = Labelled(str(number), kind, center, size, row["yaw_rad"], proposed=True)
            mark = SURE if row["state"] == "confirmed" else DOUBTFUL
            found.append(Proposal(row["frame"], labelled, row["score"], mark))
    return sorted(found, key=lambda one: (one.mark, one.score, int(one.labelled.track), one.frame))


def write_proposals(stream: BinaryIO, found: Sequence[Proposal], frames: Iterable[int]) -> None:
    """Write a CSV file; frames without an object are labelled as empty, and marked as proposed, too."""
    stream.write(f"{','.join((*COLUMNS, PROPOSED, 'score'))}\n".encode())
    for one in found:
        box = (*one.labelled.center, *one.labelled.size, one.labelled.yaw)
        numbers = ",".join(f"{value:.3f}" for value in box)
        row = f"{one.frame},{one.labelled.track},{one.labelled.kind},{numbers},{one.mark},{one.score:.3f}\n"
        stream.write(row.encode())
    empty = sorted(set(frames) - {one.frame for one in found})
    stream.writelines(f"{frame},,none,,,,,,,,{SURE},\n".encode() for frame in empty)


def files_of(form: JsonForm, found: Iterable[Proposal], frames: Sequence[int]) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the content of the label file of each frame."""
    by_frame: dict[int, list[Proposal]] = {frame: [] for frame in frames}
    for one in found:
        by_frame[one.frame].append(one)
    for frame, own in by_frame.items():
        yield f"{form.folder}/{frame:06d}.json", json.dumps(form.content(own), indent=1).encode() + b"\n"
