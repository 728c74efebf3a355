"""Selection of the frames to show, made while frames arrive and in bounded memory."""

from bisect import insort
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, NamedTuple, TypeVar

T = TypeVar("T")

_MIN_SPACING = 5
"""Minimum distance in frames between selected frames of a kind; closer frames look alike."""

Why = Literal["worst", "best", "even", "picked"]
"""Why a frame was selected: among the worst, among the best, evenly spaced, or requested."""


@dataclass(frozen=True)
class Chosen(Generic[T]):
    """A selected frame: its index among all frames, why it was selected, and the data stored for it."""

    row: int
    why: Why
    item: T


@dataclass(frozen=True)
class _Item(Generic[T]):
    """Data of a frame, created on first use."""

    row: int
    make: list[Callable[[], T]]
    made: list[T]

    def get(self) -> T:
        if not self.made:
            self.made.append(self.make.pop()())
        return self.made[0]


class Choice(Generic[T]):
    """Selection of the worst, the best and evenly spaced frames from a stream of unknown length.

    Half of the frames are the worst, a sixth the best. Every n-th frame is stored as evenly spaced; n doubles when
    there are four times too many. The data of a frame is created some frames later: while frames get worse and worse,
    each replaces the previous one and needs no data.

    Examples
    --------
    >>> choice = Choice(6)
    >>> for row in range(100):
    ...     choice.offer(row, badness=float(row == 42), merit=0.0, make=lambda row=row: f"frame {row}")
    >>> [(chosen.row, chosen.why) for chosen in choice.chosen()]
    [(42, 'worst'), (0, 'best'), (16, 'even'), (32, 'even'), (64, 'even'), (80, 'even')]
    """

    def __init__(self, frames: int) -> None:
        self._bad, self._good = frames // 2, frames // 6
        self._even = frames - self._bad - self._good
        self._worst: list[_Ranked[T]] = []
        self._best: list[_Ranked[T]] = []
        self._spread: dict[int, _Item[T]] = {}
        self._stride = 1
        self._pending: list[_Item[T]] = []

    def expect(self, frames: int) -> None:
        """Set the approximate number of frames before the first one, so that less data is created and discarded."""
        while -(-frames // (2 * self._stride)) > 4 * self._even:
            self._stride *= 2

    def offer(self, row: int, *, badness: float | None, merit: float | None, make: Callable[[], T]) -> None:
        """Offer a frame for selection; rows must be in ascending order.

        A frame with a badness of 0 or None is never among the worst, one with a merit of None never among the best.
        ``make`` returns the data to store; it is called if the frame is still selected a few frames later.
        """
        item = _Item[T](row, [make], [])
        self._pending.append(item)
        if badness:
            _insert(self._worst, -badness, self._bad, item)
        if merit is not None:
            _insert(self._best, -merit, self._good, item)
        if row % self._stride == 0:
            self._spread[row] = item
            if len(self._spread) > 4 * self._even:
                self._stride *= 2
                self._spread = {kept: other for kept, other in self._spread.items() if kept % self._stride == 0}
        self._make_pending(row)

    def _make_pending(self, row: int) -> None:
        """Create the data of pending frames that are old enough; drop those that are no longer selected."""
        kept = {id(one.item) for one in (*self._worst, *self._best)} | {id(item) for item in self._spread.values()}
        self._pending = [item for item in self._pending if id(item) in kept]
        for item in self._pending:
            if row - item.row >= _MIN_SPACING:
                item.get()
        self._pending = [item for item in self._pending if not item.made]

    def chosen(self) -> list[Chosen[T]]:
        """Return the selected frames, each once: the worst first, then the best, then the others by row."""
        found = {one.item.row: Chosen(one.item.row, "worst", one.item.get()) for one in self._worst}
        for one in self._best:
            found.setdefault(one.item.row, Chosen(one.item.row, "best", one.item.get()))
        others = [Chosen(row, "even", item) for row, item in self.spread() if row not in found]
        return [*found.values(), *_thinned(others, self._bad + self._good + self._even - len(found))]

    def spread(self) -> list[tuple[int, T]]:
        """Return all evenly spaced frames that are stored, with their rows."""
        return [(row, item.get()) for row, item in sorted(self._spread.items(), key=lambda pair: pair[0])]


class _Ranked(NamedTuple, Generic[T]):
    """A frame among the worst or the best; the smallest key comes first, equal keys in pseudo-random order."""

    rank: tuple[float, int]
    item: _Item[T]


def _insert(ranked: list[_Ranked[T]], key: float, size: int, item: _Item[T]) -> None:
    """Insert a frame into a ranked list; it replaces a frame close to it, if there is one."""
    entry = _Ranked((key, item.row * 2654435761 % 2**32), item)  # spreads equal frames over the whole recording
    close = next((number for number, one in enumerate(ranked) if item.row - one.item.row < _MIN_SPACING), None)
    rival = close if close is not None else len(ranked) - 1 if len(ranked) == size else None
    if not size or (rival is not None and entry.rank >= ranked[rival].rank):
        return
    if rival is not None:
        del ranked[rival]
    insort(ranked, entry, key=lambda one: one.rank)


def _thinned(items: list[Chosen[T]], count: int) -> list[Chosen[T]]:
    if len(items) <= count:
        return items
    return [items[number * len(items) // count] for number in range(count)]
