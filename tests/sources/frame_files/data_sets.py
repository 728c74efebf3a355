"""Folders of public data sets, written value by value as their development kits describe them."""

import struct

import numpy as np

US = 1_755_803_770_000_000
"""2025-08-21, in microseconds."""
PERIOD_US = 100_000


def places(frame, size=240):
    """Return coordinates in metres, shape (size, 3), with a mean range of some ten metres."""
    return np.random.default_rng(frame).normal(0, [20, 20, 2], (size, 3)) + np.array([12.0, 0, 0])


def canoe(folder, frames=3, *, poses=True):
    """Write a sequence of CANOE (DATA_REFERENCE.md of pycanoe): lidar/TIME.bin and novatel/lidar_poses.csv."""
    for name in ("lidar", "novatel", "calib"):
        (folder / name).mkdir(parents=True)
    (folder / "calib" / "T_lidar_radar.txt").write_text("1 0 0 0\n")
    lines = ["t,x,y,z,r,p,y,vx,vy,vz,wx,wy,wz,vx_bod,vy_bod,vz_bod"]
    for frame in range(frames):
        time_us = US + frame * PERIOD_US
        rows = (
            struct.pack("<dddHQHH", *place, 500 + number, time_us - 50_000 + number, number % 256, 40)
            for number, place in enumerate(places(frame))
        )
        (folder / "lidar" / f"{time_us}.bin").write_bytes(b"".join(rows))
        values = (1.5 + frame, -2.0, 0.5, 0.01, -0.02, 0.5 + frame, *[0.0] * 9)
        lines.append(",".join(map(str, (time_us, *values))))
    if poses:
        (folder / "novatel" / "lidar_poses.csv").write_text("\n".join(lines) + "\n")
    return folder


def pohang(folder, frames=3, *, dropped=20):
    """Write the lidars of a sequence of Pohang Canal: lidar/lidar_front/points/NANOSECONDS.bin and two more."""
    for lidar in ("lidar_front", "lidar_port", "lidar_starboard"):
        (folder / "lidar" / lidar / "points").mkdir(parents=True)
        (folder / "lidar" / lidar / "imu.txt").write_text("0\n")
        for frame in range(frames):
            data = b""
            for number, place in enumerate(places(frame)):
                if number < dropped:  # no return
                    data += struct.pack("<ffffIHHI", 0, 0, 0, 0, number * 400, 0, 30, 0)
                    continue
                range_mm = round(1000 * float(np.sqrt((place**2).sum())))
                data += struct.pack("<ffffIHHI", *place, 300 + number, number * 400, number % 256, 30, range_mm)
            name = f"{(US + frame * PERIOD_US) * 1000}.bin"
            (folder / "lidar" / lidar / "points" / name).write_bytes(data)
    return folder


def usvinland(folder, frames=3, *, suffix=".bin"):
    """Write the lidar folder of a sequence of USVInland: frames by number and Laser_Timestamp_Middle.txt."""
    folder.mkdir(parents=True)
    times = [f"{(US + frame * PERIOD_US) / 1e6:.6f}" for frame in range(frames)]
    (folder / "Laser_Timestamp_Middle.txt").write_text("\n".join(times) + "\n")
    for frame in range(frames):
        rows = (struct.pack("<ffff", *place, 30) for place in places(frame))
        (folder / f"{frame}{suffix}").write_bytes(b"".join(rows))
    return folder
