"""Cases of tests with several parameters that do not depend on each other."""

from collections.abc import Iterable
from itertools import cycle, islice


def covering(*parameters: Iterable) -> list[tuple]:
    """Return as many tuples as the longest parameter has values, in which each value of each parameter occurs."""
    values = [tuple(parameter) for parameter in parameters]
    return list(islice(zip(*map(cycle, values), strict=False), max(map(len, values))))
