"""Labelled frames, and a writer for every label format; the writers share no code with the readers."""

import csv
import json
from pathlib import Path

import numpy as np

from seaclutter_cli.cloud import from_array
from seaclutter_cli.frame import Frame
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.truth import Boxes

START_NS = 1_700_000_000 * 10**9
PERIOD_NS = 100_000_000
CHANNEL = Channel(1, "/points", "cdr", None)
HEADER = ("frame", "track_id", "class", "x", "y", "z", "length", "width", "height", "yaw")
XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]


def frame(index=0, points=None, *, stamp_ns=None, sequence=None):
    """Return a frame; by default its stamp follows from its index at ten frames per second."""
    stamp_ns = START_NS + index * PERIOD_NS if stamp_ns is None else stamp_ns
    points = np.zeros(3, XYZ) if points is None else points
    message = Message(CHANNEL, stamp_ns, stamp_ns, index if sequence is None else sequence, b"")
    return Frame.of_message(message, from_array(points, stamp_ns=stamp_ns), index)


def boxes(*rows):
    """Return boxes from rows of the native format without the frame."""
    values = np.array([row[2:] for row in rows], float).reshape(-1, 7)
    tracks, kinds = tuple(str(row[0]) for row in rows), tuple(row[1] for row in rows)
    return Boxes(tracks, kinds, values[:, :3], values[:, 3:6], values[:, 6])


def rows_of(targets):
    for track, kind, center, size, yaw in zip(
        targets.tracks, targets.classes, targets.centers, targets.sizes, targets.yaws, strict=True
    ):
        yield track, kind, *center.tolist(), *size.tolist(), float(yaw)


def points_of(targets, seed):
    """Return points of the sea and in each box, and the number of each point's box, from 1; 0 for the sea."""
    rng = np.random.default_rng(seed)
    sizes = [30 + seed, *[8] * len(targets)]
    xyz = rng.uniform(200, 300, (sum(sizes), 3))
    owner = np.repeat(np.arange(len(sizes)), sizes)
    for number, (center, size) in enumerate(zip(targets.centers, targets.sizes, strict=True), 1):
        xyz[owner == number] = center + rng.uniform(-0.01, 0.01, (8, 3)) * size
    points = np.zeros(len(xyz), [*XYZ, ("label", "<u2")])
    points["x"], points["y"], points["z"] = xyz.T
    return points, owner


def put(path, content=b""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def write_csv(folder, scene, owners):
    path = folder / "log.labels.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        for number, targets in enumerate(scene):
            rows = list(rows_of(targets)) or [("", "none", *[""] * 7)]
            writer.writerows([number, *row] for row in rows)
    return path


def seepersea_json(targets):
    return {
        "labels": [
            {
                "id": track,
                "category": kind,
                "box3d": {
                    "dimension": {"width": along, "length": across, "height": height},
                    "location": {"x": x, "y": y, "z": z},
                    "orientation": {"rotationYaw": yaw, "rotationPitch": 0, "rotationRoll": 0},
                },
            }
            for track, kind, x, y, z, along, across, height, yaw in rows_of(targets)
        ]
    }


def write_seepersea(folder, scene, owners):
    for number, targets in enumerate(scene):
        put(folder / "point_clouds" / f"{number:06d}.pcd")
        put(folder / "annotations" / f"{number:06d}.json", json.dumps(seepersea_json(targets)))
    return folder


def sustechpoints_json(targets):
    return [
        {
            "obj_id": track,
            "obj_type": kind,
            "psr": {
                "position": dict(zip("xyz", row[:3], strict=True)),
                "scale": dict(zip("xyz", row[3:6], strict=True)),
                "rotation": {"x": 0, "y": 0, "z": row[6]},
            },
        }
        for track, kind, *row in rows_of(targets)
    ]


def write_sustechpoints(folder, scene, owners):
    for number, targets in enumerate(scene):
        put(folder / "lidar" / f"{number:06d}.pcd")
        put(folder / "label" / f"{number:06d}.json", json.dumps(sustechpoints_json(targets)))
    return folder


def write_semantickitti(folder, scene, owners):
    for number, owner in enumerate(owners):
        put(folder / "velodyne" / f"{number:06d}.bin")
        labels = np.where(owner == 0, 110, 10 + (owner << 16)).astype("<u4")
        put(folder / "labels" / f"{number:06d}.label", labels.tobytes())
    return folder


def write_cloud(folder, scene, owners):
    return put(folder / "log.mcap", b"\x89MCAP0\r\n")  # the labels are in the frames


WRITERS = {
    "csv": write_csv,
    "seepersea": write_seepersea,
    "sustechpoints": write_sustechpoints,
    "semantickitti": write_semantickitti,
    "cloud": write_cloud,
}
BOX_FORMATS = ("csv", "seepersea", "sustechpoints")

SCENE = (
    boxes(("1", "ship", 10, 20, 1.5, 12, 4, 3, 0.5), ("2", "buoy", -30, 5, 0.25, 1, 1, 1.5, 0)),
    boxes(("2", "buoy", -29, 5, 0.25, 1, 1, 1.5, 0)),
    boxes(),
    boxes(("7", "other", 0, -40.125, 0, 2, 0.5, 0.75, -3)),
)
"""Targets of four frames; one frame is empty."""


def write(name, folder):
    """Write the scene's labels; return their path and the frames."""
    frames, owners = [], []
    for number, targets in enumerate(SCENE):
        points, owner = points_of(targets, number)
        if name == "cloud":
            points["label"] = owner
        else:
            points = points[["x", "y", "z"]].copy()
        frames.append(frame(number, points))
        owners.append(owner)
    return Path(WRITERS[name](folder, SCENE, owners)), frames


def assert_same(found, expected):
    assert (found.tracks, found.classes) == (expected.tracks, expected.classes)
    for name in ("centers", "sizes", "yaws"):
        value = getattr(found, name)
        np.testing.assert_array_equal(value, getattr(expected, name))
        assert value.dtype == np.float64
