"""Labels known by a time: which frame each belongs to."""

from collections import deque
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from seaclutter_cli.errors import LabelError

_REMEMBERED = 16
_FIRST_REACH_NS = 25_000_000


class StampMatcher:
    """Gives each frame the label nearest to its stamp, if that is within half a frame period.

    Frames come in order, one at a time. The period is the shortest time between two of the last 16 frames, so that it
    is right behind a gap too, and that what is stamped exactly like a frame is never nearer to another one. For the
    first frame it is not known, and the reach is 25 ms: half a period at 20 frames a second, faster than which few
    lidars turn. A label belongs to one frame, and a frame has labels of one stamp.

    Parameters
    ----------
    stamps_ns : iterable of int
        Stamps of the labels.

    **State**: the last 16 stamps of frames, and the number of the frame that took it for each label stamp.
    """

    def __init__(self, stamps_ns: Iterable[int]) -> None:
        self._stamps = np.array(sorted(set(stamps_ns)), np.int64)
        self._owners: dict[int, int] = {}
        self._recent: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)

    def match(self, number: int, stamp_ns: int) -> int | None:
        """Return the label stamp that belongs to a frame, None if none does.

        A frame can be asked for again. One with a lower number than the last starts anew.

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
        if nearest is None or abs(nearest - stamp_ns) > self._reach_ns:
            return None
        owner = self._owners.setdefault(nearest, number)
        if owner != number:
            raise LabelError(f"the labels at stamp {nearest} fit frame {owner} as well as frame {number}")
        return nearest

    @property
    def left(self) -> list[int]:
        """Label stamps that no frame has had so far, in order."""
        return [stamp for stamp in self._stamps.tolist() if stamp not in self._owners]

    def _nearest(self, stamp_ns: int) -> int | None:
        place = int(np.searchsorted(self._stamps, stamp_ns))
        around: list[int] = self._stamps[max(place - 1, 0) : place + 1].tolist()
        return min(around, key=lambda stamp: abs(stamp - stamp_ns), default=None)

    @property
    def _reach_ns(self) -> int:
        gaps = [later - earlier for (_, earlier), (_, later) in pairwise(self._recent) if later > earlier]
        return min(gaps) // 2 if gaps else _FIRST_REACH_NS
