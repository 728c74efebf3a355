"""Peculiarities of clouds in files and messages."""

import io

import numpy as np

from tests.peculiarities.case import Case, sea


def file(name, content):
    """Return a function that writes one file."""

    def build(folder):
        path = folder / name
        path.write_bytes(content)
        return path

    return build


def frame(size=600):
    return sea(size=size)


def table(kind="<f4", *, ring=False, time=False, columns=4, size=600):
    """Return a file without a header: columns of numbers of one type."""
    points = frame(size).astype(kind)[:, :columns]
    more = [np.arange(size) % 32] * ring + [np.linspace(0, 0.1, size)] * time
    return np.column_stack([points, *more]).astype(kind).tobytes()


def npy(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def ouster(folder):
    """Write a frame of 28-byte records whose range is the reflectivity, and a third of which have no return."""
    layout = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
    layout += [("t", "<u4"), ("reflectivity", "<u2"), ("ambient", "<u2"), ("range", "<u4")]
    points = np.zeros(900, layout)
    for name, column in zip(("x", "y", "z", "intensity"), frame().T, strict=True):
        points[name][300:] = column
    points["t"] = np.arange(900) // 9 * 1_000_000
    points["reflectivity"] = points["range"] = np.arange(900) % 700
    points["ambient"] = 200
    path = folder / "1625124364185411489.bin"
    path.write_bytes(points.tobytes())
    return path


NUSCENES = "https://github.com/naurril/SUSTechPOINTS/issues/105: frames of nuScenes have five columns, read as four"
WIDE = "https://github.com/naurril/SUSTechPOINTS/issues/105: a reader that assumes one width shows nonsense for others"
COLUMNS = "--columns"
UNKNOWN = "no known layout.*--columns"

HEADERLESS = [
    Case(
        name="KITTI",
        source="https://www.cvlibs.net/datasets/kitti/: x, y, z and intensity in float32, without a header",
        build=file("000000.bin", table()),
        frames=[frame()],
        to=("mcap", "npz"),
    ),
    Case(name="nuScenes", source=NUSCENES, build=file("0.pcd.bin", table(ring=True)), frames=[frame()]),
    Case(
        name="Boreas",
        source="The development kit of Boreas reads six columns: x, y, z, intensity, laser number and time.",
        build=file("0.bin", table(ring=True, time=True)),
        frames=[frame()],
    ),
    Case(name="float64", source=WIDE, build=file("0.bin", table("<f8")), frames=[frame()]),
    Case(name="xyz only", source=WIDE, build=file("0.bin", table(columns=3)), frames=[frame()[:, :3]]),
    Case(
        name="range that is the reflectivity",
        source="Frames of Pohang Canal (Chung et al., IJRR 2023) as converted for cameras: range repeats reflectivity.",
        build=ouster,
        frames=[frame()],
        invalid=300,
        stamps_ns=[1625124364185411489],
    ),
    Case(name="big endian", source=WIDE, build=file("0.bin", table(">f4")), refused=UNKNOWN),
    Case(
        name="big endian, described",
        source=WIDE,
        build=file("0.bin", table(">f4")),
        frames=[frame()],
        words=(COLUMNS, "x,y,z,intensity:>f4"),
    ),
    Case(name="16-bit columns", source=WIDE, build=file("0.bin", table("<i2")), refused=UNKNOWN),
    Case(
        name="columns without names for each",
        source="https://github.com/uzh-rpg and others export rows with a normal, which no reader can know.",
        build=file("0.bin", np.column_stack((frame(), frame()[::-1] / 100)).astype("<f4").tobytes()),
        refused=UNKNOWN,
    ),
    Case(
        name="rows of all x, all y, ...",
        source="The kit of Oxford RobotCar reads frames as four rows of N numbers, not as N rows of four.",
        build=file("0.bin", frame().T.tobytes()),
        refused=UNKNOWN,
    ),
    Case(
        name="few points",
        source="A frame on open water may have three returns, whose layout nothing proves.",
        build=file("0.bin", table(size=3)),
        frames=[frame(3)],
        says={"info": "too few points to show their layout; read as --columns x,y,z,intensity"},
    ),
    Case(
        name="array without names",
        source="Arrays that notebooks save have columns, but no names of them.",
        build=file("0.npy", npy(frame())),
        frames=[frame()],
    ),
    Case(
        name="array with the time first",
        source="Notebooks save columns in any order; seconds since 1970 were read as x.",
        build=file("0.npy", npy(np.column_stack((np.full(600, 1.7e9), frame())))),
        refused="coordinates are out of range.*--columns",
    ),
    Case(
        name="array with the time first, described",
        source="Notebooks save columns in any order; seconds since 1970 were read as x.",
        build=file("0.npy", npy(np.column_stack((np.full(600, 1.7e9), frame())))),
        frames=[frame()],
        words=(COLUMNS, "time,x,y,z,intensity"),
    ),
    Case(
        name="transposed array",
        source="https://github.com/nutonomy/nuscenes-devkit keeps points as columns, and so do arrays saved from it.",
        build=file("0.npy", npy(frame().T)),
        refused="columns",
    ),
    Case(
        name="CSV with an index",
        source="Tables of pandas have an index as their first column unless it is switched off.",
        build=file("0.csv", "".join(f"{k},{','.join(map(str, row))}\n" for k, row in enumerate(frame())).encode()),
        refused="intensity is out of range.*--columns",
    ),
]


def csv(head, row, *, encoding="utf-8"):
    """Return a table whose rows are made by a format string."""
    rows = (row.format(*map(float, point)) for point in frame(40))
    return file("0.csv", "\r\n".join([head, *rows, ""]).encode(encoding))


VELOVIEW = "https://gitlab.kitware.com/LidarView/VeloView: tables that VeloView saves have ParaView's names of vectors."
TABLES = [
    Case(
        name="VeloView",
        source=VELOVIEW,
        build=csv('"intensity","laser_id","Points_m_XYZ:0","Points_m_XYZ:1","Points_m_XYZ:2"', "{3},7,{0},{1},{2}"),
        frames=[frame(40)],
    ),
    Case(
        name="units in names",
        source="Tables of surveyors have units in the names of their columns.",
        build=csv("X [m],Y (m),z [metres],Intensity", "{0},{1},{2},{3}"),
        frames=[frame(40)],
    ),
    Case(
        name="millimetres",
        source="Tables of surveyors have units in the names of their columns, which need not be metres.",
        build=csv("x [mm],y [mm],z [mm],intensity", "{0},{1},{2},{3}"),
        refused="column x is in mm; coordinates must be in metres",
    ),
    Case(
        name="UTF-16",
        source="Spreadsheets and PowerShell write tables as UTF-16 with a byte order mark.",
        build=csv("x,y,z,intensity", "{0},{1},{2},{3}", encoding="utf-16"),
        frames=[frame(40)],
    ),
    Case(
        name="decimal commas",
        source="Spreadsheets in most of Europe write decimal commas.",
        build=csv("x;y;z;intensity", "1,5;2,25;-0,5;{3}"),
        refused="'1,5' is not a number; write decimal points, not commas",
    ),
    Case(
        name="a column of text",
        source="Tables of labels and of ROS exporters have names and dates beside numbers.",
        build=csv("stamp,x,y,z,intensity,class", "2024-05-01T12:00:00Z,{0},{1},{2},{3},buoy"),
        frames=[frame(40)],
    ),
]

CASES = [*HEADERLESS, *TABLES]
