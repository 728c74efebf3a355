"""Times of frames for tracks."""

from seaclutter_cli.frame import Frame

_MAX_GAP_NS, _LEAST_STEP_NS = 5_000_000_000, 1_000_000


class Clock:
    """Times of frames: their stamps, or times of the log where stamps stand still or step back by up to 5 s."""

    def __init__(self) -> None:
        self._last: tuple[int, int] | None = None

    def next(self, frame: Frame) -> tuple[int, bool]:
        """Return the time of the next frame in nanoseconds, and whether it is more than 5 s from the one before."""
        time_ns, log_ns = frame.stamp_ns, frame.log_time_ns
        last_ns, last_log_ns = self._last or (time_ns - 1, log_ns)
        is_apart = abs(time_ns - last_ns) > _MAX_GAP_NS
        if time_ns <= last_ns and not is_apart:
            time_ns = last_ns + max(log_ns - last_log_ns, _LEAST_STEP_NS)
        self._last = time_ns, log_ns
        return time_ns, is_apart
