"""Quays, jetties, bridges, banks and beaches of `mesh_sea`: lists of meshes in the axes of the world."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from mesh_parts import RUBBER, STEEL, WOOD, Array, Mesh, Random, crate, join, moved, quad, rod, skin, split, tris


class Line:
    """Line from one place to another: its length, its direction, and what is on the left of it."""

    def __init__(self, start: Any, end: Any) -> None:
        self.start, end = np.asarray(start, float), np.asarray(end, float)
        self.length = float(np.linalg.norm(end - self.start))
        self.along = (end - self.start) / self.length
        self.left = np.array([-self.along[1], self.along[0]])

    def place(self, along: float, left: float, z: float) -> Array:
        return np.array([*(self.start + self.along * along + self.left * left), z])


def wall(rng: Random, start: Any, end: Any, height: float) -> list[Mesh]:
    """Return a quay in pieces, with land on the left and weed at the water line."""
    line, rho = Line(start, end), rng.uniform(0.15, 0.4)
    number, meshes = int(np.ceil(line.length / 10)), []
    for k in range(number):
        low, high = k * line.length / number, (k + 1) * line.length / number
        bottom, top, back = ([line.place(x, *at) for x in (low, high)] for at in ((0, -2), (0, height), (12, height)))
        weed = [
            line.place(low, 0, -0.1),
            line.place(high, 0, -0.1),
            line.place(high, 0, 0.35),
            line.place(low, -0.02, 0.35),
        ]
        faces = [quad([*bottom, *top[::-1]], rho), quad([*top, *back[::-1]], rho), quad(weed, 0.06)]
        meshes.append(join(split(join(*faces), 2.5), *furniture(rng, line, (low, high), height)))
    return meshes


def furniture(rng: Random, line: Line, ends: tuple[float, float], height: float) -> Iterator[Mesh]:
    """Yield a ladder, tyres, a bollard and a shed; of these, only the bollard is always there."""
    low, high = ends
    s = rng.uniform(low + 0.5, high - 0.5)
    if rng.random() < 0.5:
        for q in (-0.2, 0.2):
            yield rod(line.place(s + q, -0.12, -0.8), line.place(s + q, -0.12, height), 0.03, 4, STEEL)
        for z in np.arange(0.1, height, 0.3):
            rung = line.place(s - 0.2, -0.12, z), line.place(s + 0.2, -0.12, z)
            yield rod(*rung, 0.015, 4, STEEL, caps=False)
    for _ in range(rng.integers(0, 3)):
        s = rng.uniform(low + 0.6, high - 0.6)
        z = rng.uniform(0.4, max(0.5, height - 0.6))
        yield rod(line.place(s, -0.28, z), line.place(s, 0, z), 0.42, 10, RUBBER)
    s = rng.uniform(low + 1, high - 1)
    yield rod(line.place(s, 0.6, height), line.place(s, 0.6, height + 0.5), (0.14, 0.2), 7, 0.2)
    if rng.random() < 0.4:
        back, wide, tall = rng.uniform(3, 7), rng.uniform(2, 8), rng.choice([1.5, 2.6, 4.5])
        s = rng.uniform(low, max(low + 0.1, high - wide))
        corners = ((s, back), (s + wide, back), (s + wide, back + 4), (s, back + 4))
        floor = [line.place(*corner, height) for corner in corners]
        roof = floor + np.array([0, 0, tall])
        yield split(join(skin([floor, roof], 0.4, close=True), quad(roof, 0.3)), 2.5)


def jetty(rng: Random, start: Any, end: Any, height: float) -> list[Mesh]:
    """Return a wooden deck on piles, in pieces."""
    line = Line(start, end)
    side, meshes = line.left * 1.1, []
    number = max(1, int(np.ceil(line.length / 8)))
    for k in range(number):
        p, q = (line.start + line.along * each * line.length / number for each in (k, k + 1))
        low = np.array([[*corner, height - 0.25] for corner in (p - side, q - side, q + side, p + side)])
        top = low + np.array([0, 0, 0.25])
        parts = [split(join(skin([low, top], WOOD, close=True), quad(top, WOOD), quad(low, WOOD)), 2.5)]
        feet = p - side, p + side, (p + q) / 2 - side, (p + q) / 2 + side
        parts += [rod([*foot, -1], [*foot, height + rng.choice([0, 0.9])], 0.12, 7, 0.2) for foot in feet]
        meshes.append(join(*parts))
    return meshes


def bridge(centre: Any, yaw: float, span: float, height: float, width: float) -> list[Mesh]:
    """Return a deck with rails, in pieces, and piers with piles."""
    across, along = np.array([-np.sin(yaw), np.cos(yaw)]), np.array([np.cos(yaw), np.sin(yaw)])
    centre, half, meshes = np.asarray(centre, float), width / 2, []
    for k in range(int(3 * span // 8)):
        s = -3 * span / 2 + 8 * k
        corners = ((s, -half), (s + 8, -half), (s + 8, half), (s, half))
        flat = np.array([[*(centre + across * a + along * b), 0] for a, b in corners])
        low, top, rail = (flat + np.array([0, 0, z]) for z in (height, height + 1.0, height + 2.0))
        parts = [skin([low, top], 0.3, close=True), quad(low, 0.3), quad(top, 0.3)]
        for i, j in ((0, 1), (3, 2)):
            parts.append(rod(rail[i], rail[j], 0.04, 4, 0.3))
            for f in (0, 0.33, 0.66):
                post = (each[i] * (1 - f) + each[j] * f for each in (top, rail))
                parts.append(rod(*post, 0.03, 4, 0.3))
        meshes.append(split(join(*parts), 2.0))
    for k in (-1.5, -0.5, 0.5, 1.5):
        at = [*(centre + across * span * k), 0]
        meshes.append(split(moved(crate([-half, -0.7, -2], [half, 0.7, height], 0.3), at, yaw), 2.0))
        feet = [(s * width * 0.75, q) for s in (-1, 1) for q in (-0.4, 0.4)]
        meshes.append(moved(join(*(rod([*foot, -1], [*foot, 2], 0.15, 6, 0.2) for foot in feet)), at, yaw))
    return meshes


def bank(rng: Random, start: Any, end: Any, rise: float) -> list[Mesh]:
    """Return a sloping shore with bumps in pieces, on the left; reeds in front of some, bushes behind some."""
    line, step, meshes = Line(start, end), 9.0, []
    number, cells = max(1, int(np.ceil(line.length / step))), int(step / 1.8)
    s, d = np.linspace(0, line.length, number * cells + 1), np.array([-3, -1, -0.3, 0.5, 1.5, 3, 5, 8, 14])
    wiggle = np.convolve(rng.normal(0, 1.2, len(s) + 8), np.ones(9) / 9, "valid")
    z = np.where(d < 0, 0.5 * d, rise * d) + rng.normal(0, 0.1, (len(s), len(d))) * (d > 0.3)
    level = line.start + line.along * s[:, None, None] + line.left * (d[None, :, None] + wiggle[:, None, None])
    places = np.concatenate([level, z[..., None]], 2)
    for k in range(number):
        parts = [skin(places[k * cells : (k + 1) * cells + 1], rng.uniform(0.15, 0.35))]
        middle = (k + 0.5) * line.length / number
        if rng.random() < 0.5:
            parts += [bush(rng, line, middle) for _ in range(rng.integers(1, 4))]
        meshes.append(join(*parts))
        if rng.random() < 0.6:
            meshes.append(reeds(rng, line, (middle, step), wiggle[int((k + 0.5) * cells)]))
    return meshes


def bush(rng: Random, line: Line, middle: float) -> Mesh:
    at, height = line.place(middle + rng.uniform(-3, 3), rng.uniform(3, 8), 0), rng.uniform(1.5, 5)
    leaves = rng.normal(0, 1, (60, 1, 3)) * [0.9, 0.9, height / 4] + [0, 0, height / 2 + 1.5]
    return tris(leaves + rng.normal(0, 0.16, (60, 3, 3)) + at, 0.4)


def reeds(rng: Random, line: Line, along: tuple[float, float], offset: float) -> Mesh:
    """Return blades around the middle of some step of a line."""
    (middle, step), number = along, rng.integers(120, 260)
    root = line.start + line.along * (middle + rng.uniform(-step / 2, step / 2, number))[:, None]
    root = root + line.left * rng.uniform(-2.5, 0.5, number)[:, None] + offset * line.left
    height, lean = rng.uniform(1.0, 2.4, number), rng.normal(0, 0.15, (number, 2))
    side = rng.normal(0, 1, (number, 2))
    side *= 0.012 / np.linalg.norm(side, axis=1, keepdims=True)
    foot, tip = np.column_stack([root, np.full(number, -0.3)]), np.column_stack([root + lean * height[:, None], height])
    wide = np.column_stack([side, np.zeros(number)])
    return tris(np.stack([foot - wide, foot + wide, tip], 1), 0.35)


def beach(origin: Array, inland: Array, slope: float) -> list[Mesh]:
    """Return sand that rises inland from the shore line, in pieces."""
    along, meshes = np.array([-inland[1], inland[0]]), []
    d = np.array([-6, -3, -1, 0, 1, 2.5, 4, 6, 9, 13, 18, 25.0])
    z = np.where(d < 0, slope * d, slope * d * 1.5 + 0.06 * np.maximum(d - 9, 0))
    for k in range(10):
        s = np.linspace(-80 + 16 * k, -64 + 16 * k, 6)[:, None]
        places = origin + along * s[..., None] + inland * d[None, :, None]
        height = z + 0.15 * np.sin(s * 0.4 + d) * (d > 8)
        meshes.append(skin(np.concatenate([places, height[..., None]], 2), 0.35))
    return meshes
