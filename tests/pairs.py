"""Cases of tests with several parameters that do not depend on each other, and of sweeps over many inputs."""

from collections.abc import Iterable
from itertools import cycle, islice

import pytest


def covering(*parameters: Iterable) -> list[tuple]:
    """Return as many tuples as the longest parameter has values, in which each value of each parameter occurs."""
    values = [tuple(parameter) for parameter in parameters]
    return list(islice(zip(*map(cycle, values), strict=False), max(map(len, values))))


def turns(number: int) -> pytest.MarkDecorator:
    """Return the parameter ``turn``, which part of a sweep a test does: the first of so many; the others are slow."""
    slow = (pytest.param(turn, marks=pytest.mark.slow) for turn in range(1, number))
    return pytest.mark.parametrize("turn", [0, *slow])
