"""Assignment of labels with stamps to frames."""

from collections import deque
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from seaclutter_cli.errors import LabelError

_RECENT = 16
_FIRST_TOLERANCE_NS = 25_000_000


class StampMatcher:
    """Assignment of the label stamp nearest to each frame, within half a frame period.

    Frames arrive in order, one at a time. The period is the shortest time between two of the last 16 frames. It is
    therefore correct after a gap, too, and a label with the exact stamp of a frame never matches another frame. For the
    first frame the period is unknown and the tolerance is 25 ms: half a period at 20 frames per second, a rate that few
    lidars exceed. A label stamp belongs to one frame, and a frame has one label stamp.

    Parameters
    ----------
    stamps_ns : iterable of int
        Stamps of the labels.

    **State**: the stamps of the last 16 frames, and the frame number assigned to each label stamp.
    """

    def __init__(self, stamps_ns: Iterable[int]) -> None:
        self._stamps = np.array(sorted(set(stamps_ns)), np.int64)
        self._owners: dict[int, int] = {}
        self._recent: deque[tuple[int, int]] = deque(maxlen=_RECENT)

    def match(self, number: int, stamp_ns: int) -> int | None:
        """Return the label stamp of a frame; None if there is none within the tolerance.

        The same frame can be requested again. A number lower than the last one restarts the sequence.

        Raises
        ------
        LabelError
            If the label already belongs to another frame.
        """
        if self._recent and number < self._recent[-1][0]:
            self._recent.clear()
        if not self._recent or number != self._recent[-1][0]:
            self._recent.append((number, stamp_ns))
        nearest = self._nearest(stamp_ns)
        if nearest is None or abs(nearest - stamp_ns) > self._tolerance_ns:
            return None
        owner = self._owners.setdefault(nearest, number)
        if owner != number:
            raise LabelError(f"labels with stamp {nearest} match both frame {owner} and frame {number}")
        return nearest

    @property
    def left(self) -> list[int]:
        """Label stamps not assigned to a frame so far, in order."""
        return [stamp for stamp in self._stamps.tolist() if stamp not in self._owners]

    def _nearest(self, stamp_ns: int) -> int | None:
        index = int(np.searchsorted(self._stamps, stamp_ns))
        around: list[int] = self._stamps[max(index - 1, 0) : index + 1].tolist()
        return min(around, key=lambda stamp: abs(stamp - stamp_ns), default=None)

    @property
    def _tolerance_ns(self) -> int:
        gaps = [later - earlier for (_, earlier), (_, later) in pairwise(self._recent) if later > earlier]
        return min(gaps) // 2 if gaps else _FIRST_TOLERANCE_NS
