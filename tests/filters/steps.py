"""Numbers of the reasons, and what a filter says of frames, in short."""

import math

KEPT, INVALID, NEAR, LOW, OUTLIER, FAR, EXCLUDED = range(7)


def reasons(method, *frames):
    """Return the reasons in the last of the frames."""
    for frame in frames:
        result = method.step(frame)
    return [int(reason) for reason in result.reason]


def below(number):
    return math.nextafter(number, -math.inf)


def above(number):
    return math.nextafter(number, math.inf)
