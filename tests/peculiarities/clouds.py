"""Peculiarities of clouds in files and messages."""

import io
import struct

import numpy as np
import pytest

import seaclutter
from tests import logs
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


def room():
    """Return points on the walls of a room of six metres, rows of x, y, z."""
    random = np.random.default_rng(1)
    bearing = random.uniform(-3.1, 3.1, 480)
    distance = 3 / np.maximum(abs(np.cos(bearing)), abs(np.sin(bearing)))
    slope = np.tan(np.radians(random.integers(-25, 15, 480)))
    return distance[:, None] * np.column_stack((np.cos(bearing), np.sin(bearing), slope))


def depths():
    """Return a depth image in metres, a tenth of which has no depth."""
    random = np.random.default_rng(0)
    row, column = np.mgrid[:150, :32]
    depth = 1 + 0.3 * np.sin(column / 7) + 0.2 * row / 150 + random.normal(0, 0.01, row.shape)
    return np.where(random.random(row.shape) < 0.1, 0, depth)


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
        name="half floats of a room",
        source="Exporters for the web store half floats, pairs of which are plausible float32 within four metres.",
        build=file("0.bin", room().astype("<f2").tobytes()),
        refused=UNKNOWN,
    ),
    Case(
        name="points of PCL in a room",
        source="Memory of pcl::PointXYZI is padded to 32 bytes; within four metres its pairs are plausible float64.",
        build=file("0.bin", np.insert(room(), [3] * 5, [1, 0, 0, 0, 0], axis=1).astype("<f4").tobytes()),
        refused=UNKNOWN,
    ),
    Case(
        name="depth image",
        source="Depth cameras dump images as float32 without a header; pairs of depths are plausible float64.",
        build=file("0.bin", depths().astype("<f4").tobytes()),
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


def pcd(fields, body, encoding="binary", *, points=40, names=("0.pcd",), viewpoint="0 0 0 1 0 0 0"):
    """Return a function that writes a PCD file, with rows of name, type letter, size and count, under some names."""
    columns = [" ".join(map(str, column)) for column in zip(*fields, strict=True)]
    rows = zip(("FIELDS", "TYPE", "SIZE", "COUNT"), columns, strict=True)
    head = "".join(f"{key} {values}\n" for key, values in rows)
    head += f"WIDTH {points}\nHEIGHT 1\nVIEWPOINT {viewpoint}\nPOINTS {points}\nDATA {encoding}\n"

    def build(folder):
        for name in names:
            (folder / name).write_bytes(head.encode() + body)
        return folder / names[0] if len(names) == 1 else folder

    return build


FOUR = [(name, "F", 4, 1) for name in ("x", "y", "z", "intensity")]
STORED = b"".join(column.tobytes() for column in np.ascontiguousarray(frame(40).T))
PACKED = struct.pack("<II", len(STORED), len(STORED)) + STORED
WINDOWS = "\n".join(f"{x} {y} {z} {i}" for x, y, z, i in frame(38).tolist()).encode()
EXPORTER = "https://github.com/ros-perception/perception_pcl: pcl_ros wrote SEC.NSEC without leading zeros until 2025."
LATE = [1741286117 * 10**9 + ns for ns in (11_149_430, 111_149_431, 911_149_430)]
PCDS = [
    Case(
        name="viewpoint of a PCD file",
        source="The PCD format: a pose of the sensor, with which the Point Cloud Library moves no points",
        build=pcd(FOUR, frame(40).tobytes(), viewpoint="1 2 3 1 0 0 0"),
        frames=[frame(40)],
        says=dict.fromkeys(("info", "filter", "convert"), "its VIEWPOINT is not applied to the points"),
    ),
    Case(
        name="a field without values",
        source="PCL writes padding as fields named _, and some drivers give them the count 0.",
        build=pcd([*FOUR, ("_", "F", 4, 0)], frame(40).tobytes()),
        frames=[frame(40)],
    ),
    Case(
        name="stored as compressed",
        source="Exporters that find no saving in compression store the columns as they are.",
        build=pcd(FOUR, PACKED, "binary_compressed"),
        frames=[frame(40)],
    ),
    Case(
        name="not a number in Windows",
        source="Visual C++ writes NaN as 1.#QNAN, and since 2015 as -nan(ind).",
        build=pcd(FOUR, WINDOWS + b"\n1.#QNAN -nan(ind) 1.#IND00 -1.#INF\n-nan(ind) nan(snan) 1.#INF 3\n", "ascii"),
        frames=[frame(38)],
        invalid=2,
    ),
    Case(
        name="nanoseconds without leading zeros",
        source=EXPORTER,
        build=pcd(FOUR, frame(40).tobytes(), names=[f"{ns // 10**9}.{ns % 10**9}.pcd" for ns in LATE]),
        frames=[frame(40)] * 3,
        stamps_ns=LATE,
    ),
    Case(
        name="seconds and nanoseconds",
        source=EXPORTER + " Others write SEC_NSEC.",
        build=pcd(FOUR, frame(40).tobytes(), names=[f"{ns // 10**9}_{ns % 10**9}.pcd" for ns in LATE]),
        frames=[frame(40)] * 3,
        stamps_ns=LATE,
    ),
    Case(
        name="seconds with few decimals",
        source="Python writes seconds with as many digits as needed: 1741286117.5 is half a second.",
        build=pcd(FOUR, frame(40).tobytes(), names=[f"1741286117.{part}.pcd" for part in ("5", "25", "0625")]),
        frames=[frame(40)] * 3,
        stamps_ns=[1741286117 * 10**9 + ns for ns in (62_500_000, 250_000_000, 500_000_000)],
    ),
    Case(
        name="a dark intensity",
        source="Firmware 3 of Ouster leaves the intensity at 0 and fills reflectivity.",
        build=pcd(
            [*FOUR, ("reflectivity", "F", 4, 1)],
            (frame(40)[:, [0, 1, 2, 3, 3]] * [1, 1, 1, 0, 1]).astype("<f4").tobytes(),
        ),
        frames=[frame(40) * [1, 1, 1, 0]],
        says={"info": "intensity is always 0; use --intensity-field reflectivity"},
    ),
]


def las(*, version="1.2", legacy=False, latin=False):
    """Return a function that writes a LAS file; ``legacy`` leaves the number of points of LAS 1.4 at 0."""

    def build(folder):
        laspy = pytest.importorskip("laspy")
        header = laspy.LasHeader(version=version, point_format=3)
        header.scales = [1 / 16] * 3
        header.vlrs.append(laspy.VLR("Geodasie", 7, "", b"abc"))
        out = laspy.LasData(header)
        out.x, out.y, out.z = frame(40)[:, :3].T.astype("f8")
        out.intensity = frame(40)[:, 3].astype("u2")
        path = folder / "0.las"
        out.write(path)
        data = bytearray(path.read_bytes())
        if legacy:
            data[107:111], data[247:255] = struct.pack("<I", 40), bytes(8)
        path.write_bytes(bytes(data).replace(b"Geodasie", "Geodäsie".encode("latin-1") if latin else b"Geodasie"))
        return path

    return build


SURVEYS = [
    Case(
        name="Latin-1 in LAS",
        source="Programs of surveyors write names with umlauts in Latin-1.",
        build=las(latin=True),
        frames=[frame(40)],
    ),
    Case(
        name="legacy count of LAS 1.4",
        source="Writers of LAS 1.4 for older readers fill in the former number of points only.",
        build=las(version="1.4", legacy=True),
        frames=[frame(40)],
    ),
]


def cloud(change=None, **fields):
    """Return a function that writes a log with one cloud, whose named columns follow x, y, z and intensity."""

    def build(folder):
        layout = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
        points = np.zeros(40, [*layout, *fields.items()])
        for name, column in zip(("x", "y", "z", "intensity"), frame(40).T, strict=True):
            points[name] = column
        for name in fields:
            points[name] = 7
        if change:
            change(points)
        data = logs.cloud_message("ros2", points, logs.START_NS).replace(b"h#he", "höhe".encode("latin-1"))
        return logs.write_log(
            folder / "log.mcap", [logs.cloud_topic("/points")], [logs.Entry("/points", logs.START_NS, data)]
        )

    return build


def wild(points):
    points["x"][3] = 1e9


FULL = "full names of fields"
LASSES = "Clouds of drivers have fields of any name, which a survey format may use for something else."
WRITTEN = [
    Case(
        name="fields X, Y and Z in LAS",
        source=LASSES,
        build=cloud(X="<f8", Y="<f8", Z="<f8"),
        frames=[frame(40)],
        to=("las", "mcap"),
    ),
    Case(
        name="fields xy and yz in LAS",
        source=LASSES,
        build=cloud(xy="<f4", yz="<f4", xyz="<u2"),
        frames=[frame(40)],
        to=("las",),
        also=lambda out: has_fields(out, "xy", "yz", "xyz"),
    ),
    *(
        Case(
            name=f"{kind} of a field in {form.upper()}",
            source=LASSES,
            build=cloud(**{name: "<f4"}),
            frames=[frame(40)],
            to=(form,),
            also=lambda out, kept=kept: has_fields(out, *kept),
            says=dict.fromkeys(("filter", "convert"), said and f"{form.upper()} files cannot keep: {said}"),
        )
        for form, kind, name, kept, said in (
            ("las", "long name", "q" * 40, ["q" * 32], FULL),
            ("laz", "long name", "q" * 40, ["q" * 32], FULL),
            ("las", "umlauts in the name", "ä" * 20, ["ä" * 16], FULL),
            ("las", "wrong bytes in the name", "h#he", ["h?he"], FULL),
            ("npz", "wrong bytes in the name", "h#he", ["h?he"], FULL),
            ("pcd", "wrong bytes in the name", "h#he", ["h?he"], FULL),
            ("pcd", "name with a space", "a b", ["a_b"], FULL),
            ("pcd", "padding as the name", "_", ["__"], FULL),
            ("pcd", "long name", "q" * 400, ["q" * 400], ""),
            ("las", "dimension with another type", "classification", ["original_classification"], ""),
        )
    ),
    *(
        Case(
            name=f"more than LAS has room for: {kind}",
            source=LASSES,
            build=cloud(**fields),
            refused="LAS has room for .* values of a point.* write npz or pcd",
            refused_by=("filter", "convert"),
            to=("las",),
        )
        for kind, fields in {
            "fields": {f"f{number}": "<f4" for number in range(500)},
            "values": {"beams": ("<f4", (400,))},
        }.items()
    ),
    Case(
        name="many values in NPZ",
        source=LASSES,
        build=cloud(beams=("<f4", (400,))),
        frames=[frame(40)],
        to=("npz", "pcd"),
        also=lambda out: has_fields(out, "beams"),
    ),
    Case(
        name="a wild point in LAS",
        source="One echo at a billion metres must not coarsen the resolution of all others.",
        build=cloud(wild),
        frames=[np.delete(frame(40), 3, axis=0)],
        to=("las",),
        says={"filter": "1 point too far away", "convert": "1 point too far away"},
        atol=1e-4,
        raw=[frame(40) + [[1e9 - frame(40)[3, 0], 0, 0, 0] if k == 3 else [0] * 4 for k in range(40)]],
    ),
]


def has_fields(out, *names):
    with seaclutter.open_log(out) as log:
        found = next(iter(log.frames())).cloud.points
    assert all((found[name] == 7).all() for name in names), found.dtype.names


CASES = [*HEADERLESS, *TABLES, *PCDS, *SURVEYS, *WRITTEN]
