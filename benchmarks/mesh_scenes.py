"""What there is in a world of each family of `mesh_sea`."""

from collections.abc import Callable, Sequence

import numpy as np
from mesh_parts import quad, split
from mesh_shores import bank, beach, bridge, jetty, wall
from mesh_world import Placer, Span

CRAFT = ("motorboat", "yacht", "sailing", "rhib")
MARKS = ("lateral", "spar", "mooring", "channel mark", "float")


def craft(
    p: Placer, number: int, kinds: Sequence[str] = CRAFT, distance: Span = (12, 50), speed: Span = (1.5, 8)
) -> None:
    for _ in range(number):
        p.add(str(p.rng.choice(kinds)), distance, speed=speed, rate=(0, 0.12))


def marks(p: Placer, number: int, distance: Span = (9, 40)) -> None:
    for _ in range(number):
        p.add(str(p.rng.choice(MARKS)), distance, clear=1.5)


def gulls(p: Placer, most: int = 2) -> None:
    """Add birds, afloat and aloft, which no filter has to keep."""
    p.add("gull", (6, 30), p.rng.integers(0, most + 1), target=False, clear=0.5)
    number, z = p.rng.integers(0, most + 1), p.uniform(1, 6)
    p.add("gull aloft", (5, 30), number, speed=(5, 12), rate=(0, 0.3), z=z, target=False, clear=-2)


def calm_harbour(p: Placer) -> None:
    y, height = p.uniform(10, 16), p.uniform(1.3, 3)
    p.land(wall(p.rng, (-60, y), (70, y), height))
    low = -p.uniform(14, 20)
    p.land(jetty(p.rng, (-35, low), (30, low), p.uniform(0.5, 1.0)))
    p.free = lambda _, q: low + 1.5 < q < y - 0.5
    for x in np.arange(-32, 28, 7.5):
        if p.rng.random() < 0.75:
            kind = str(p.rng.choice(["motorboat", "moored sail", "motorboat", "rowboat", "rhib"]))
            at = x + p.uniform(-0.5, 0.5), low + 4.9 + (1.5 if kind == "moored sail" else 0)
            p.add(kind, at=at, heading=p.pick(np.pi / 2, -np.pi / 2) + p.rng.normal(0, 0.05), clear=1.5)
    for x in np.arange(-45, 55, 14):
        if p.rng.random() < 0.6:
            kind = str(p.rng.choice(["motorboat", "yacht", "moored sail"]))
            p.add(kind, at=lambda x=x: (x + p.uniform(-2, 2), y - 2.4), heading=p.pick(0, np.pi), clear=1.2)
    p.add("motorboat", at=(25, p.uniform(-3, 3)), speed=1.5, heading=np.pi + 0.1, clear=1.2)
    p.add("rowboat", at=(-18, 4), speed=0.7, heading=0.2, clear=1.2)
    p.add("mooring", (7, 20), 2, clear=1)
    gulls(p)


def open_swell(p: Placer) -> None:
    craft(p, 3, distance=(14, 45))
    p.add("ship", (55, 75), speed=(3, 6))
    marks(p, 3)
    p.add("kayak", (9, 20), speed=1.2)
    gulls(p)


def wind_chop(p: Placer) -> None:
    craft(p, 3, distance=(10, 40))
    marks(p, 3)
    p.add("log", (9, 18), clear=1.5)
    gulls(p)


def breakers(p: Placer) -> None:
    origin, inland = p.world["shore"]
    p.land(beach(origin, inland, p.world["shore_slope"]))
    p.free = lambda x, y: x * inland[0] + y * inland[1] < origin @ inland - 8
    to_shore = np.arctan2(-inland[1], -inland[0]) + np.pi
    p.add("swimmer", (24, 30), 2, speed=(0.2, 0.7), bearing=(to_shore - 0.5, to_shore + 0.5))
    p.add("paddler", (10, 20), 2, speed=(0.5, 1.2))
    p.add("kayak", (10, 26), 2, speed=(0.5, 1.5))
    craft(p, 2, ("motorboat", "rhib"), (12, 30), (2, 6))
    marks(p, 2)


def wake_crossing(p: Placer) -> None:
    for _ in range(3):
        p.uniform(-np.pi, np.pi)  # not used: keeps the logs
        p.add(
            p.pick("motorboat", "rhib", "yacht"),
            at=lambda: (p.uniform(-22, 22) + 6, p.uniform(-22, 22)),
            speed=(6, 11),
            heading=lambda: p.pick(-1, 1) * p.uniform(1.0, 2.1),
            clear=2,
        )
    p.add("ship", (30, 45), speed=(4, 6), length=p.uniform(30, 50))
    p.add("kayak", (9, 22), 2, speed=(0.8, 1.5))
    marks(p, 2)


def follow_ship(p: Placer) -> None:
    speed, length = p.world["speed"], p.uniform(30, 60)
    kind = p.pick("ship", "barge")
    p.add(kind, at=(p.uniform(14, 24) + length / 2, p.uniform(-3, 3)), speed=speed, heading=0.0, length=length)
    p.add("motorboat", at=(-18, p.uniform(-4, 4)), speed=speed, heading=0.0)
    p.add("motorboat", at=(p.uniform(0, 20), p.pick(-1, 1) * p.uniform(16, 22)), speed=speed * 1.4, heading=0.05)
    p.add("yacht", at=(10, p.pick(-1, 1) * p.uniform(24, 32)), speed=3.5, heading=np.pi)
    marks(p, 4, (12, 40))


def head_spray(p: Placer) -> None:
    craft(p, 3, ("motorboat", "rhib", "yacht"), (12, 40), (3, 9))
    marks(p, 3, (9, 40))
    p.add("sailing", (15, 40), speed=(2, 4))


def rain(p: Placer) -> None:
    craft(p, 4, distance=(9, 40))
    marks(p, 3)
    p.add("kayak", (8, 18), speed=1.2)
    p.add("log", (8, 16), clear=1.5)


def fog(p: Placer) -> None:
    craft(p, 3, distance=(8, 25), speed=(0.5, 3))
    marks(p, 4, (7, 22))
    p.add("barge", (16, 24), speed=(0, 1))
    p.add("rowboat", (8, 16), speed=0.8)


def night_mirrors(p: Placer) -> None:
    y = p.uniform(14, 18)
    p.land(wall(p.rng, (-50, y), (50, y), p.uniform(1.5, 3)))
    p.free = lambda _, q: q < y - 0.6
    p.add("yacht", number=2, at=lambda: (p.uniform(-25, 25), y - 3.0), heading=0.0, clear=1.5)
    p.add("motorboat", (9, 25), 2, clear=1.5)
    p.add("moored sail", (12, 28), 2, clear=1.5)
    p.add("barge", at=(p.uniform(-10, 10), -p.uniform(22, 28)), heading=0.1, length=30)
    p.add("pile", (8, 20), 3, clear=1)
    p.add("lateral", (8, 20), 2, clear=1)
    p.add("gull", (6, 18), 2, target=False, clear=0.5)


def turning(p: Placer) -> None:
    craft(p, 3, distance=(22, 45))
    marks(p, 4, (14, 35))
    p.add("kayak", (22, 30), speed=1)
    p.add("barge", (45, 60))


def kayaks(p: Placer) -> None:
    p.add("kayak", (7, 30), 5, speed=(0, 2.2), rate=(0, 0.1), clear=1.5)
    p.add("paddler", (7, 25), 2, speed=(0.3, 1.5), clear=1.5)
    p.add("rowboat", (9, 28), 2, speed=(0.5, 2), clear=1.5)
    gulls(p)


def swimmers(p: Placer) -> None:
    p.add("swimmer", (4, 18), 6, speed=(0.2, 1.2), clear=0.6)
    p.add("kayak", (9, 20), speed=1, clear=1.5)
    p.add("paddler", (8, 18), speed=0.8, clear=1.5)
    p.add("rhib", (16, 28))
    p.add("mooring", (6, 18), 3, clear=1)
    gulls(p, 3)


def buoys_chop(p: Placer) -> None:
    for kind, number in (("lateral", 2), ("spar", 2), ("mooring", 3), ("channel mark", 1), ("float", 2), ("withy", 1)):
        p.add(kind, (7, 32), number, clear=1.2)
    p.add("log", (9, 20), clear=1.5)
    p.add("container", (14, 28), clear=2)
    craft(p, 1)


def beams16(p: Placer) -> None:
    craft(p, 4, distance=(9, 35))
    marks(p, 3, (7, 25))
    p.add("kayak", (7, 18), speed=1.2)
    gulls(p)


def beams128(p: Placer) -> None:
    craft(p, 4, distance=(10, 45))
    marks(p, 3)
    p.add("swimmer", (6, 14), 2, speed=0.5, clear=0.8)
    p.add("ship", (45, 65), speed=(2, 5))
    gulls(p)


def low(p: Placer) -> None:
    craft(p, 3, distance=(9, 35), speed=(0.5, 5))
    marks(p, 4, (6, 22))
    p.add("rowboat", (8, 20), speed=1)
    p.add("log", (7, 14), clear=1.2)
    gulls(p)


def high(p: Placer) -> None:
    craft(p, 3, distance=(15, 50))
    marks(p, 3, (13, 35))
    p.add("kayak", (13, 28), 2, speed=1.2)
    p.add("log", (13, 22))
    p.add("ship", (55, 75), speed=(2, 5))
    gulls(p)


def river_reeds(p: Placer) -> None:
    y, low = p.uniform(11, 16), -p.uniform(12, 20)
    p.land(bank(p.rng, (-60, y), (66, y), p.uniform(0.2, 0.5)))
    p.land(bank(p.rng, (66, low), (-60, low), p.uniform(0.2, 0.5)))
    p.free = lambda _, q: low + 4 < q < y - 4
    p.add("barge", at=(38, p.uniform(low + 8, low + 9)), speed=1.5, heading=np.pi, length=28)
    p.add("rowboat", at=(20, 4), speed=1.0, heading=np.pi, clear=1.2)
    p.add("kayak", at=(-14, 4), speed=2.0, heading=0.0, clear=1.2)
    p.add("motorboat", at=(-24, -3), speed=2.0, heading=0.0, clear=1.2)
    p.add("withy", number=4, at=lambda: (p.uniform(-30, 40), p.pick(y - 5, low + 5)), clear=1)
    p.add(
        "log",
        number=2,
        at=lambda: (p.uniform(-20, 30), p.uniform(low + 5, y - 5)),
        heading=lambda: p.rng.normal(0, 0.4),
        clear=0.8,
    )
    p.add("pile", number=2, at=lambda: (p.uniform(-30, 40), y - 4.5), clear=1)
    gulls(p)


def lock(p: Placer) -> None:
    half, height, front, back = p.uniform(9.0, 11.0), p.uniform(2, 5), p.uniform(35, 45), -p.uniform(18, 30)
    p.land(wall(p.rng, (back, half), (front, half), height))
    p.land(wall(p.rng, (front, -half), (back, -half), height))
    for x in (front, back):  # mitre gates
        for y in (half, -half):
            gate = [x, y, -2], [x + 2, 0, -2], [x + 2, 0, height * 0.9], [x, y, height * 0.9]
            p.land([split(quad(gate, 0.15), 2.0)])
    p.free = lambda x, y: abs(y) < half - 1.5 and back + 3 < x < front - 3
    p.add("barge", at=(front - 16, half - 6.2), heading=0.0, length=22)
    p.add("motorboat", at=(11, -half + 3), heading=0.0, length=5.5, clear=0.4)
    p.add("rowboat", at=(-8, half - 2.8), heading=0.0, clear=0.3)
    p.add("yacht", at=(-13, -half + 3.8), heading=0.05, length=9, clear=0.3)
    p.add("kayak", at=(6, half - 2.4), heading=0.0, clear=0.3)
    p.add("gull", (4, 7), target=False, clear=0.3)


def under_bridge(p: Placer) -> None:
    span, x = p.uniform(16, 24), p.uniform(-4, 8)
    p.land(bridge((x, 0), p.rng.normal(0, 0.1), span, p.uniform(4.5, 7.5), p.uniform(6, 11)))
    p.free = lambda x, y: (abs(x) >= 16 or abs(abs(y) - span / 2) >= 4) and abs(y) < 1.4 * span
    p.add("motorboat", at=(20, p.uniform(-span / 2 + 4, -4)), speed=(3, 6), heading=np.pi, clear=1.5)
    p.add("sailing", at=(25, span), clear=2)
    p.add("barge", at=(25, -span), speed=1.5, heading=0.0, length=30)
    p.add("kayak", at=(-12, p.uniform(4, span / 2 - 4)), speed=1.3, heading=0.0, clear=1)
    marks(p, 3, (10, 35))
    p.add("pile", (12, 30), 2, clear=1)
    gulls(p)


def rhib_crossing(p: Placer) -> None:
    p.add(
        "rhib",
        number=3,
        at=lambda: (p.uniform(-25, 25) + 8, p.uniform(-25, 25)),
        speed=(8, 12),
        heading=lambda: p.pick(-1, 1) * p.uniform(1.0, 2.1),
        rate=(0, 0.15),
        clear=2,
    )
    p.add("motorboat", (15, 40), 2, speed=(6, 10), rate=(0, 0.3))
    marks(p, 3)
    p.add("sailing", (20, 40), speed=(1, 3))


def anchorage(p: Placer) -> None:
    upwind = p.world["wind_to"] + np.pi
    heading = lambda: upwind + p.rng.normal(0, 0.15)
    p.add("moored sail", (10, 55), 6, heading=heading, clear=2)
    p.add("yacht", (12, 55), 4, heading=heading, clear=2)
    p.add("motorboat", (9, 45), 5, heading=heading, clear=1.5)
    p.add("rowboat", (8, 30), 2, heading=heading, clear=1.2)
    p.add("mooring", (6, 35), 7, clear=0.8)
    p.add("rhib", (12, 40), speed=(2, 4))
    p.add("swimmer", (7, 16), speed=0.5, clear=0.8)
    gulls(p, 3)


SCENES: dict[str, Callable[[Placer], None]] = {
    "calm_harbour": calm_harbour, "open_swell": open_swell, "wind_chop": wind_chop, "breakers": breakers,
    "wake_crossing": wake_crossing, "follow_ship": follow_ship, "head_spray": head_spray, "rain": rain, "fog": fog,
    "night_mirrors": night_mirrors, "turning": turning, "kayaks": kayaks, "swimmers": swimmers,
    "buoys_chop": buoys_chop, "beams16": beams16, "beams128": beams128, "low": low, "high": high,
    "river_reeds": river_reeds, "lock": lock, "bridge": under_bridge, "rhib_crossing": rhib_crossing,
    "anchorage": anchorage, "empty_sea": lambda p: gulls(p, 3),
}  # fmt: skip
