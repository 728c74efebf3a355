"""Codes of the reasons, and shorthands for the results of a filter."""

import math

KEPT, INVALID, NEAR, LOW, OUTLIER, FAR, EXCLUDED, UNCONFIRMED = range(8)


def reasons(method, *frames):
    """Return the reasons of the last frame after filtering all frames."""
    for frame in frames:
        result = method.step(frame)
    return [int(reason) for reason in result.reason]


def below(number):
    return math.nextafter(number, -math.inf)


def above(number):
    return math.nextafter(number, math.inf)
