"""Craft of `mesh_sea`."""

import numpy as np
from mesh_parts import (
    GLASS,
    Hull,
    Mesh,
    Random,
    Shape,
    chain,
    crate,
    join,
    moved,
    person,
    plank,
    quad,
    rod,
    skin,
    split,
    tris,
)

OUTLINE = (
    (0.2, -0.6), (0.9, -0.3), (1, 0.4), (0.6, 0.9), (0, 1.0), (-0.6, 0.9), (-1, 0.4), (-0.9, -0.3), (-0.2, -0.6),
)  # fmt: skip


def outboard(x: float, z: float, rng: Random) -> Mesh:
    rho = rng.choice([0.04, 0.1, 0.55])
    shaft = crate([x - 0.35, -0.08, -0.5], [x - 0.15, 0.08, z], rho)
    return join(crate([x - 0.5, -0.18, z], [x, 0.18, z + 0.45], rho, 0.8), shaft)


def motorboat(rng: Random, length: float) -> Shape:
    beam, free = length * rng.uniform(0.34, 0.4), np.clip(length * rng.uniform(0.11, 0.14), 0.5, 1.5)
    hull = Hull(length, beam, free, 0.35, rng.choice([0.6, 0.6, 0.6, 0.45, 0.08, 0.03]), flare=0.25)
    parts = [hull.mesh(), hull.fender(rng.choice([0.05, 0.5]))]
    floor, front = max(0.14, 0.2 * free), length * 0.08
    fore, aft = np.linspace(front, length / 2, 5), np.linspace(-length * 0.46, front, 4)
    z, b = hull.deck(front), hull.half(front) * 0.85
    frame = [front, -b * 0.9, z + 0.55], [front, b * 0.9, z + 0.55]
    parts += [
        hull.plank(fore, hull.deck(fore) + 0.05, 0.5),
        hull.tub(aft, floor, 0.5),
        quad([[front + 0.5, -b, z], [front + 0.5, b, z], frame[1], frame[0]], GLASS),
        rod(*frame, 0.02, 4, 0.3),
        crate([-0.5, -b * 0.7, floor], [0, -b * 0.2, floor + 0.5], 0.4),
        crate([-0.5, b * 0.2, floor], [0, b * 0.7, floor + 0.5], 0.4),
    ]
    for q in (1, -1):
        low = [front + 0.5, q * b, z], [front - 0.6, q * b, z]
        parts.append(quad([*low, [front - 0.6, q * b * 0.95, z + 0.3], [front, q * b * 0.9, z + 0.55]], GLASS))
    for _ in range(rng.integers(0, 3)):
        seated = rng.random() < 0.6
        at = [rng.uniform(-0.35, 0) * length, rng.uniform(-0.25, 0.25) * beam, floor + 0.3]
        parts.append(person(rng, at, seated=seated))
    parts.append(outboard(-length / 2, free * 0.7, rng))
    if rng.random() < 0.4:  # pulpit
        for q in (1, -1):
            low, top = (hull.rail(np.linspace(length * 0.2, length * 0.49, 4), q * 0.93, up) for up in (0, 0.5))
            parts += chain(top, 0.015, 4, 0.5)
            parts += [rod(*ends, 0.015, 4, 0.5, caps=False) for ends in zip(low, top, strict=True)]
    return Shape(join(*parts), length, beam)


def yacht(rng: Random, length: float) -> Shape:
    beam, z = length * rng.uniform(0.28, 0.33), np.clip(length * 0.1, 0.8, 1.7)
    hull = Hull(length, beam, z, 0.7, rng.choice([0.6, 0.55, 0.03]), full=0.5, flare=0.28, sheer=0.35)
    rest, b = np.linspace(-length * 0.3, length * 0.5, 7), beam * 0.38
    parts = [
        hull.mesh(),
        hull.tub(np.linspace(-length * 0.48, -length * 0.3, 3), z * 0.6, 0.5),
        hull.plank(rest, hull.deck(rest) + 0.03, 0.55),
        crate([-length * 0.3, -b, z], [length * 0.15, b, z + 0.7], 0.6, 0.98),
        crate([-length * 0.28, -b * 0.97, z + 0.7], [length * 0.13, b * 0.97, z + 1.15], GLASS, 0.92, 0.15),
        crate([-length * 0.32, -b * 0.95, z + 1.15], [length * 0.08, b * 0.95, z + 1.27], 0.6),
    ]
    if rng.random() < 0.5:  # flying bridge
        parts.append(crate([-length * 0.22, -b * 0.8, z + 1.27], [length * 0.02, b * 0.8, z + 1.9], 0.6, 0.85))
        posts = [([-length * 0.22, y, z + 1.3], [-length * 0.26, y * 0.8, z + 2.8]) for y in (-b, b)]
        parts += [rod(*ends, 0.08, 5, 0.6) for ends in posts]
        parts.append(crate([-length * 0.27, -b * 0.8, z + 2.75], [-length * 0.23, b * 0.8, z + 2.9], 0.6))
        parts.append(person(rng, [-0.1 * length, 0.2, z + 1.6]))
    else:
        parts.append(rod([-length * 0.15, 0, z + 1.2], [-length * 0.17, 0, z + 2.6], 0.05, 5, 0.5))
    x = np.linspace(-length * 0.5, length / 2, 9)[3:]
    for q in (1, -1):
        parts += chain(hull.rail(x, q * 0.96, 0.65), 0.014, 4, 0.5)
    return Shape(join(*parts), length, beam)


def sailboat(rng: Random, length: float, *, sails: bool) -> Shape:
    beam, free = length * rng.uniform(0.29, 0.33), length * rng.uniform(0.085, 0.11)
    paint = rng.choice([0.03, 0.04, 0.6, 0.5])
    hull = Hull(length, beam, free, 0.5, paint, fine=1.8, full=0.42, flare=0.12, sheer=0.2, stern=0.7)
    rest = np.linspace(-length * 0.18, length * 0.5, 6)
    mast, top = length * 0.1, length * rng.uniform(1.2, 1.4)
    parts = [
        hull.mesh(),
        hull.tub(np.linspace(-length * 0.48, -length * 0.18, 4), free * 0.45, 0.45),
        hull.plank(rest, hull.deck(rest), 0.5),
        crate([-length * 0.18, -beam * 0.26, free], [length * 0.2, beam * 0.26, free + 0.4], 0.55, 0.85),
        split(rod([mast, 0, free], [mast, 0, top], (0.07, 0.05), 6, 0.45), 3.0),
    ]
    side = rng.uniform(0.15, 0.6) * rng.choice([-1, 1]) if sails else 0.05
    boom = length * 0.38
    clew = np.array([mast - boom * np.cos(side), boom * np.sin(side), free + 1.1])
    parts.append(rod([mast, 0, free + 1.0], clew, 0.06, 5, 0.4))
    if sails:
        parts.append(mainsail(mast, boom, side, (free, top)))
        if rng.random() < 0.7:
            foot = [mast - 0.3, 0.3 * np.sign(side) * beam, free + 0.6]
            parts.append(split(tris([[length * 0.48, 0, free + 0.3], foot, [mast + 0.1, 0, top * 0.85]], 0.55), 1.5))
    else:
        end = clew + np.array([0.2, 0, 0.05])
        parts.append(rod([mast - 0.2, 0, free + 1.15], end, 0.12, 5, rng.choice([0.1, 0.4])))
    for q in (1, -1):  # shrouds, life lines
        shroud = [mast - 0.1, q * beam * 0.45, free], [mast, 0, top * 0.9]
        parts.append(split(rod(*shroud, 0.004, 3, 0.3, caps=False), 2.5))
        line = hull.rail(np.linspace(-length * 0.45, length * 0.45, 6), q * 0.95, 0.6)
        parts += chain(line, 0.004, 3, 0.3)
        parts += [rod([x, y, z - 0.6], [x, y, z], 0.012, 4, 0.4, caps=False) for x, y, z in line]
    for _ in range(rng.integers(1, 3) if sails else rng.integers(0, 2)):
        parts.append(person(rng, [-length * rng.uniform(0.22, 0.4), rng.uniform(-0.2, 0.2) * beam, free * 0.8]))
    return Shape(join(*parts), length, beam)


def mainsail(mast: float, boom: float, side: float, heights: tuple[float, float]) -> Mesh:
    """Return a sail with a belly, between the heights of the deck and of the top of the mast."""
    (free, top), rows = heights, []
    along, across = np.array([-np.cos(side), np.sin(side)]), np.array([np.sin(side), np.cos(side)])
    for h in np.linspace(0, 1, 7):
        chord = np.linspace(0, 1 - 0.95 * h, 5)
        belly = 0.09 * boom * np.sin(np.pi * chord / max(1 - 0.95 * h, 0.05)) * np.sign(side) * (1 - h)
        level = np.array([mast, 0]) + chord[:, None] * boom * along + belly[:, None] * across
        rows.append(np.column_stack([level, np.full(5, free + 1.1 + h * (top - free - 1.3))]))
    return skin(rows, 0.6)


def rhib(rng: Random, length: float) -> Shape:
    beam, r = length * 0.4, np.clip(length * 0.045, 0.2, 0.3)
    rho, parts = rng.choice([0.05, 0.12, 0.3, 0.4]), []
    nodes = np.array([
        [-length / 2, beam / 2 - r, 0.28], [0, beam / 2 - r, 0.3], [length * 0.28, beam / 2 - r, 0.38],
        [length * 0.43, beam * 0.22, 0.5], [length / 2 - r, 0, 0.58],
    ])  # fmt: skip
    for q in (1, -1):
        tube = nodes * [1, q, 1]
        parts += [rod(tube[0], tube[1], r, 8, rho), *chain(tube[1:], r, 8, rho)]
    x = np.linspace(-length * 0.48, length * 0.4, 4)
    half = np.interp(x, [-length / 2, length * 0.28, length / 2], [beam / 2 - r, beam / 2 - r, 0.05])
    parts += [
        Hull(length * 0.92, beam * 0.8, 0.3, 0.3, 0.4, stern=1.0).mesh(),
        plank(x, half, 0.3, 0.3),
        outboard(-length / 2, 0.45, rng),
        crate([-0.3, -0.35, 0.3], [0.4, 0.35, 1.15], 0.5, 0.8, 0.1),
        person(rng, [-0.7, 0, 0.3], seated=False),
        quad([[0.3, -0.3, 1.15], [0.3, 0.3, 1.15], [0.15, 0.28, 1.5], [0.15, -0.28, 1.5]], GLASS),
    ]
    for k in range(rng.integers(0, 4)):
        parts.append(person(rng, [-length * 0.25 - 0.6 * (k // 2), (-1) ** k * 0.4, 0.75]))
    if rng.random() < 0.6:  # arch
        foot, top = ([-length * x, beam * y, z] for x, y, z in ((0.42, 0.35, 0.3), (0.44, 0.25, 1.8)))
        parts += [rod(foot * np.array([1, q, 1]), top * np.array([1, q, 1]), 0.035, 5, 0.3) for q in (1, -1)]
        parts.append(rod(top * np.array([1, -1, 1]), top, 0.035, 5, 0.3))
    return Shape(join(*parts), length, beam)


def shell(length: float, beam: float, height: float, rho: float) -> Mesh:
    """Return the closed deck of a kayak or board."""
    x = np.linspace(-length / 2, length / 2, 9)
    half = beam / 2 * np.clip(1 - (2 * abs(x) / length) ** 2.2, 0.02, 1)
    z = height * (0.85 + 0.3 * (2 * x / length) ** 2)
    return skin([np.column_stack([x, half * y, z * up]) for y, up in OUTLINE], rho)


def paddle(phase: float) -> Mesh:
    """Return a double blade across the boat, of which one end dips."""
    dip, swing = 0.5 * np.sin(phase), 0.35 * np.cos(phase)
    v = np.array([np.sin(swing) * np.cos(dip), np.cos(swing) * np.cos(dip), np.sin(dip)]) * 1.08
    c, w = np.array([0.35, 0, 0.62]), np.array([0.09, 0, 0.09])
    parts = [rod(c - v, c + v, 0.016, 4, 0.3)]
    for q in (1, -1):
        tip = c + q * v
        parts.append(quad([tip - w, tip + w, tip + w - q * v * 0.35, tip - w - q * v * 0.35], 0.5))
    return join(*parts)


def kayak(rng: Random) -> Shape:
    length, beam = rng.uniform(3.2, 5.2), rng.uniform(0.55, 0.75)
    parts = [shell(length, beam, 0.27, rng.choice([0.5, 0.4, 0.55, 0.1])), person(rng, [-0.15, 0, 0.12])]
    if rng.random() < 0.25:
        parts.append(person(rng, [0.9, 0, 0.12]))
    rate, start = rng.uniform(4, 7), rng.uniform(0, 6)
    return Shape(join(*parts), length, beam, lambda time: paddle(start + rate * time))


def rowboat(rng: Random) -> Shape:
    length = rng.uniform(3.5, 4.8)
    beam = length * 0.36
    hull = Hull(length, beam, 0.45, 0.15, rng.choice([0.35, 0.5, 0.12]), full=0.45, sheer=0.4, stern=0.7)
    parts = [
        hull.mesh(),
        hull.tub(np.linspace(-length * 0.47, length * 0.45, 6), 0.13, 0.35),
        crate([-0.15, -beam * 0.4, 0.3], [0.1, beam * 0.4, 0.34], 0.35),
        person(rng, [0, 0, 0.34], facing=np.pi),
    ]
    if rng.random() < 0.5:
        parts.append(person(rng, [-length * 0.36, 0, 0.34]))
    start = rng.uniform(0, 6)

    def oars(time: float) -> Mesh:
        swing, dip = 0.6 * np.sin(start + 3.2 * time), 0.14 + 0.1 * np.cos(start + 3.2 * time)
        parts, e = [], np.array([0, 0, 0.07])
        for q in (1, -1):
            v, c = np.array([np.sin(swing), q * np.cos(swing), -dip]) * 1.7, np.array([0, q * beam * 0.5, 0.5])
            parts.append(rod(c - 0.35 * v, c + v, 0.022, 4, 0.4))
            parts.append(quad([c + v - e, c + v + e, c + 0.75 * v + e, c + 0.75 * v - e], 0.4))
        return join(*parts)

    return Shape(join(*parts), length, beam, oars)


def paddler(rng: Random) -> Shape:
    board = moved(shell(3.2, 0.78, 0.1, rng.choice([0.55, 0.45, 0.2])), [0, 0, 0.02])
    standing = person(rng, seated=rng.random() < 0.2, at=[0, 0, 0.12])
    start, side = rng.uniform(0, 6), rng.choice([-1, 1])

    def stick(time: float) -> Mesh:
        a = 0.5 * np.sin(start + 3.5 * time)
        low = [0.2 + 0.7 * np.sin(a), side * 0.5, -0.1]
        return rod(low, [0.2 - 0.2 * np.sin(a), side * 0.15, 1.7], 0.016, 4, 0.3)

    return Shape(join(board, standing), 3.2, 0.8, stick)


def barge(rng: Random, length: float) -> Shape:
    beam, free = rng.uniform(5, 9), rng.uniform(0.7, 1.8)
    paint = rng.choice([0.04, 0.1, 0.2])
    hull = Hull(length, beam, free, 1.0, paint, fine=4, full=0.85, flare=0.02, sheer=0.08, stern=0.95, stations=12)
    x = np.linspace(-length / 2, length / 2, 12)
    parts = [
        hull.mesh(),
        hull.plank(x, hull.deck(x) - 0.02, 0.2),
        crate([-length * 0.25, -beam * 0.4, free], [length * 0.38, beam * 0.4, free + 0.9], 0.25),
        crate([-length * 0.46, -beam * 0.33, free], [-length * 0.33, beam * 0.33, free + 2.2], 0.55),
        crate([-length * 0.43, -beam * 0.25, free + 2.2], [-length * 0.36, beam * 0.25, free + 4], -0.3),
        rod([length * 0.44, 0, free], [length * 0.44, 0, free + 4], 0.06, 5, 0.3),
    ]
    return Shape(split(join(*parts), 3.0), length, beam)


def ship(rng: Random, length: float) -> Shape:
    beam, free = length * rng.uniform(0.14, 0.17), length * rng.uniform(0.03, 0.045) + 0.8
    paint = rng.choice([0.03, 0.1, 0.25, 0.5])
    hull = Hull(length, beam, free, 2.0, paint, fine=2.4, full=0.75, flare=0.1, sheer=0.25, stern=0.85, stations=16)
    x, aft = np.linspace(-length / 2, length / 2, 14), -length * 0.42
    parts = [
        hull.mesh(),
        hull.plank(x, hull.deck(x) - 0.8, 0.2),
        crate([aft, -beam * 0.42, free - 0.5], [aft + length * 0.12, beam * 0.42, free + 5], 0.55),
        crate([aft + 1, -beam * 0.48, free + 5], [aft + length * 0.1, beam * 0.48, free + 7.5], 0.5),
        crate([aft, -1, free + 5], [aft + 2, 1, free + 9.5], 0.3),
        rod([length * 0.42, 0, free], [length * 0.42, 0, free + 6], 0.15, 6, 0.4),
    ]
    for k in range(3):  # holds
        a = -length * 0.27 + k * length * 0.2
        top = [a + length * 0.18, beam * 0.36, free + rng.uniform(0.3, 4)]
        parts.append(crate([a, -beam * 0.36, free - 0.8], top, rng.uniform(0.1, 0.4)))
    return Shape(split(join(*parts), 4.0), length, beam)
