"""People, marks, birds and flotsam of `mesh_sea`, and all kinds of floating bodies."""

from collections.abc import Callable
from functools import partial

import numpy as np
from mesh_craft import barge, kayak, motorboat, paddler, rhib, rowboat, sailboat, ship, yacht
from mesh_parts import (
    HAIR,
    SKIN,
    STEEL,
    WETSUIT,
    WOOD,
    Mesh,
    Random,
    Shape,
    ball,
    crate,
    join,
    moved,
    quad,
    rod,
    split,
    tris,
)


def swimmer(rng: Random) -> Shape:
    crawl, cap = rng.random() < 0.7, rng.choice([HAIR, 0.5, 0.6, SKIN])
    arm = rng.choice([SKIN, WETSUIT])
    parts = [ball([0, 0, 0.1], [0.11, 0.09, 0.13], cap, 8, 6), ball([-0.18, 0, -0.02], [0.16, 0.22, 0.07], arm, 8, 4)]
    if rng.random() < 0.3:  # buoy in tow
        parts.append(ball([-1.2, 0.1, 0.06], [0.3, 0.16, 0.13], 0.5))
    rate, start = rng.uniform(2.5, 5), rng.uniform(0, 6)

    def arms(time: float) -> Mesh:
        parts = []
        for q in (1, -1):
            a = start + rate * time + (0 if q > 0 else np.pi)
            v = np.array([np.cos(a), q * 0.15, np.sin(a)] if crawl else [0.5, q * 0.8, 0.35 * np.sin(a)])
            root = np.array([-0.1, q * 0.2, 0.0])
            parts.append(rod(root, root + 0.6 * v / np.linalg.norm(v), (0.05, 0.035), 5, arm))
        return join(*parts)

    return Shape(join(*parts), 0.9, 0.6, arms)


def lateral(rng: Random) -> Shape:
    """Return a can or a cone, perhaps with a reflecting band."""
    r, h, rho = rng.uniform(0.3, 0.5), rng.uniform(0.8, 1.4), rng.choice([0.45, 0.3, 0.2])
    if rng.random() < 0.5:
        parts = [rod([0, 0, -0.3], [0, 0, h], (r, r * 0.95), 10, rho)]
    else:
        parts = [rod([0, 0, -0.3], [0, 0, h * 0.3], r, 10, rho), rod([0, 0, h * 0.3], [0, 0, h], (r, 0.05), 10, rho)]
    parts.append(rod([0, 0, h], [0, 0, h + 0.35], 0.03, 4, 0.3))
    if rng.random() < 0.6:
        parts.append(rod([0, 0, h * 0.25], [0, 0, h * 0.25 + 0.08], r * 1.02, 10, 8.0, caps=False))
    return Shape(join(*parts), 2 * r, 2 * r)


def spar(rng: Random) -> Shape:
    r, h = rng.uniform(0.08, 0.16), rng.uniform(1.2, 2.4)
    parts = [rod([0, 0, -0.6], [0, 0, h], r, 8, rng.choice([0.4, 0.25, 0.1]))]
    if rng.random() < 0.5:
        parts.append(rod([0, 0, h - 0.3], [0, 0, h - 0.2], r * 1.05, 8, 6.0, caps=False))
    if rng.random() < 0.4:
        parts.append(rod([0, 0, h], [0, 0, h + 0.35], (0.22, 0.02), 6, 0.2))
    return Shape(join(*parts), 2 * r, 2 * r)


def withy(rng: Random) -> Shape:
    h, lean = rng.uniform(1.5, 2.8), rng.normal(0, 0.08, 2)
    tip = np.array([*(lean * h), h])
    parts = [rod([0, 0, -0.4], tip, (0.035, 0.02), 5, WOOD)]
    for _ in range(14):  # twigs at the top
        s, a = rng.uniform(0.7, 1), rng.uniform(0, 6.3)
        twig = [0.25 * np.cos(a), 0.25 * np.sin(a), 0.22]
        parts.append(rod(tip * s, tip * s + twig, 0.008, 3, 0.25, caps=False))
    return Shape(join(*parts), 0.3, 0.3)


def mooring(rng: Random) -> Shape:
    r = rng.uniform(0.2, 0.25)
    eye = rod([0, 0, r * 1.3], [0, 0, r * 1.3 + 0.12], 0.03, 4, STEEL)
    return Shape(join(ball([0, 0, r * 0.4], r, rng.choice([0.5, 0.4, 0.55]), 9, 7), eye), 2 * r, 2 * r)


def channel_mark(rng: Random) -> Shape:
    """Return a float with a lattice tower and a top mark."""
    r, low, top = rng.uniform(0.8, 1.2), 0.6, rng.uniform(2.8, 4.0)
    rho = rng.choice([0.4, 0.3, 0.2])
    parts = [rod([0, 0, -0.5], [0, 0, low], r, 12, rho)]
    turns = np.pi / 4 + np.arange(5) % 4 * np.pi / 2
    feet = np.column_stack([np.cos(turns), np.sin(turns)])

    def leg(k: int, share: float) -> list[float]:
        return [*(feet[k] * (r * 0.75 * (1 - share) + 0.25 * share)), low + share * (top - low)]

    for k in range(4):
        parts.append(rod(leg(k, 0), leg(k, 1), 0.035, 4, rho, caps=False))
        for share in (0.0, 0.33, 0.66):
            end = leg(k + 1, share + 0.33)
            parts.append(rod(leg(k, share), end, 0.02, 4, rho, caps=False))
            parts.append(rod(leg(k, share + 0.33), end, 0.02, 4, rho, caps=False))
    tip = 0.25 if rng.random() < 0.5 else 0.02
    parts += [
        rod([0, 0, top], [0, 0, top + 0.35], 0.12, 6, 0.3),
        rod([0, 0, top + 0.35], [0, 0, top + 0.9], 0.02, 4, 0.2),
        rod([0, 0, top + 0.9], [0, 0, top + 1.3], (0.25, tip), 8, rho),
        rod([0, 0, low + 0.5], [0, 0, low + 0.7], r * 0.6, 8, 5.0, caps=False),
    ]
    return Shape(join(*parts), 2 * r, 2 * r)


def fishing_float(rng: Random) -> Shape:
    h, a = rng.uniform(1.2, 2.0), rng.uniform(0, 6.3)
    wide, tip, tall = np.array([np.cos(a), np.sin(a), 0]) * 0.35, np.array([0, 0, h]), np.array([0, 0, 0.28])
    parts = [
        ball([0, 0, 0.05], 0.14, rng.choice([0.5, 0.3]), 8, 6),
        rod([0, 0, 0], tip, 0.012, 4, 0.3),
        quad([tip, tip + wide, tip + wide - tall, tip - tall], rng.choice([0.5, 0.06])),
    ]
    return Shape(join(*parts), 0.3, 0.3)


def log(rng: Random) -> Shape:
    length, r = rng.uniform(3, 6), rng.uniform(0.15, 0.28)
    trunk = rod([-length / 2, 0, 0.03], [length / 2, 0.1, 0.05], (r, r * 0.8), 8, 0.18)
    parts = [moved(trunk, [0, 0, 0], pitch=rng.normal(0, 0.03))]
    for _ in range(rng.integers(0, 3)):
        x = rng.uniform(-0.4, 0.4) * length
        end = [x + 0.3, rng.normal(0, 0.3), r + rng.uniform(0.1, 0.5)]
        parts.append(rod([x, 0, 0.1], end, (0.04, 0.015), 5, 0.2))
    return Shape(join(*parts), length, 2 * r)


def container(rng: Random) -> Shape:
    """Return a container adrift, nearly awash."""
    box = split(crate([-3.03, -1.22, -1.3], [3.03, 1.22, 1.3], rng.choice([0.2, 0.35, 0.1])), 1.5)
    low = [0, 0, -1.3 + rng.uniform(0.25, 0.5)]
    return Shape(moved(box, low, pitch=rng.normal(0, 0.06), roll=rng.normal(0, 0.08)), 6, 2.4)


def pile(rng: Random) -> Shape:
    h, r = rng.uniform(1.5, 4), rng.uniform(0.12, 0.25)
    parts = [rod([0, 0, -1], [0, 0, h], r, 8, rng.choice([0.15, 0.25]))]
    if rng.random() < 0.3:  # dolphin of three
        for a in (0.5, 2.6, 4.7):
            cos, sin = np.cos(a), np.sin(a)
            parts.append(rod([cos * 0.8, sin * 0.8, -1], [0.1 * cos, 0.1 * sin, h], r, 7, 0.15))
    return Shape(join(*parts), 2 * r, 2 * r)


def gull() -> Mesh:
    neck = rod([0.18, 0, 0.1], [0.22, 0, 0.2], 0.035, 5, 0.5)
    return join(
        ball([0, 0, 0.07], [0.24, 0.09, 0.09], 0.5, 7, 5), ball([0.22, 0, 0.2], [0.07, 0.05, 0.05], 0.5, 6, 4), neck
    )


def gull_aloft(rng: Random) -> Shape:
    start = rng.uniform(0, 6)

    def wings(time: float) -> Mesh:
        a = 0.5 * np.sin(start + 18 * time)
        tips = [[-0.15, q * 0.6 * np.cos(a), 0.1 + 0.6 * np.sin(a)] for q in (1, -1)]
        return tris([[[0.1, 0, 0.1], [-0.1, 0, 0.1], tip] for tip in tips], 0.4)

    return Shape(gull(), 0.5, 1.2, wings)


KINDS: dict[str, tuple[Callable[..., Shape], tuple[float, float] | None]] = {  # range of lengths in metres, if any
    "motorboat": (motorboat, (4.5, 7.5)),
    "yacht": (yacht, (9, 14)),
    "sailing": (partial(sailboat, sails=True), (6.5, 12)),
    "moored sail": (partial(sailboat, sails=False), (6, 11)),
    "rhib": (rhib, (4.5, 8.5)),
    "barge": (barge, (25, 45)),
    "ship": (ship, (45, 90)),
    "kayak": (kayak, None),
    "rowboat": (rowboat, None),
    "paddler": (paddler, None),
    "swimmer": (swimmer, None),
    "lateral": (lateral, None),
    "spar": (spar, None),
    "withy": (withy, None),
    "mooring": (mooring, None),
    "channel mark": (channel_mark, None),
    "float": (fishing_float, None),
    "log": (log, None),
    "container": (container, None),
    "pile": (pile, None),
    "gull": (lambda _: Shape(gull(), 0.5, 0.2), None),
    "gull aloft": (gull_aloft, None),
}
NAMES = {"sailing": "sailboat", "moored sail": "sailboat", "gull": "bird", "gull aloft": "bird aloft"}
