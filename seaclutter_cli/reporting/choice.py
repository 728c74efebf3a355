"""Which frames of a recording are worth looking at: chosen while they pass, in bounded memory."""

from bisect import insort
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

T = TypeVar("T")

_APART = 5
"""Frames that are closer look alike; one of them is enough."""

Why = Literal["worst", "best", "even", "picked"]
"""Why a frame was chosen: among the worst, among the best, one of those evenly spread, or asked for."""


@dataclass(frozen=True)
class Chosen(Generic[T]):
    """A frame that was chosen.

    Parameters
    ----------
    row : int
        Its place among all frames.
    why : {"worst", "best", "even", "picked"}
        Why it was chosen.
    item : object
        What was kept of it.
    """

    row: int
    why: Why
    item: T


@dataclass(frozen=True)
class _Item(Generic[T]):
    """What is kept of a frame, made when it is first asked for."""

    row: int
    make: list[Callable[[], T]]
    made: list[T]

    def get(self) -> T:
        if not self.made:
            self.made.append(self.make.pop()())
        return self.made[0]


class Choice(Generic[T]):
    """Keeps the worst, the best and evenly spread frames of a stream whose length is not known.

    Of those evenly spread every n-th is kept; n doubles whenever there are four times too many. What is kept of a frame
    is made some frames later: while things get worse and worse, each frame takes the place of the one before.

    Parameters
    ----------
    frames : int
        How many to choose, at least 1: half of them worst, a sixth best, the rest evenly spread.

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
        self._fresh: list[_Item[T]] = []

    def expect(self, frames: int) -> None:
        """Say before the first frame how many there will be, about: fewer are made for nothing."""
        while -(-frames // (2 * self._stride)) > 4 * self._even:
            self._stride *= 2

    def offer(self, row: int, *, badness: float | None, merit: float | None, make: Callable[[], T]) -> None:
        """Offer a frame, in order of rows.

        Parameters
        ----------
        row : int
            Its place among all frames.
        badness : float or None
            How bad it is; 0 and None are not bad.
        merit : float or None
            How good it is; None cannot be among the best.
        make : callable
            Returns what to keep; called if the frame is still kept a few frames later.
        """
        item = _Item[T](row, [make], [])
        self._fresh.append(item)
        if badness:
            _enter(self._worst, -badness, row, self._bad, item)
        if merit is not None:
            _enter(self._best, -merit, row, self._good, item)
        if row % self._stride == 0:
            self._spread[row] = item
            if len(self._spread) > 4 * self._even:
                self._stride *= 2
                self._spread = {kept: other for kept, other in self._spread.items() if kept % self._stride == 0}
        self._take(row)

    def _take(self, row: int) -> None:
        """Make what is to be kept of the frames that are no longer close; forget those that have lost their place."""
        kept = {id(one.item) for one in (*self._worst, *self._best)} | {id(item) for item in self._spread.values()}
        self._fresh = [item for item in self._fresh if id(item) in kept]
        for item in self._fresh:
            if row - item.row >= _APART:
                item.get()
        self._fresh = [item for item in self._fresh if not item.made]

    def chosen(self) -> list[Chosen[T]]:
        """Return the chosen frames, each once: the worst first, then the best, then others by their rows."""
        found = {one.row: Chosen(one.row, "worst", one.item.get()) for one in self._worst}
        for one in self._best:
            found.setdefault(one.row, Chosen(one.row, "best", one.item.get()))
        others = [Chosen(row, "even", item) for row, item in self.spread() if row not in found]
        return [*found.values(), *_thinned(others, self._bad + self._good + self._even - len(found))]

    def spread(self) -> list[tuple[int, T]]:
        """Return all evenly spread frames that are still kept, with their rows."""
        return [(row, item.get()) for row, item in sorted(self._spread.items(), key=lambda pair: pair[0])]


@dataclass(frozen=True)
class _Ranked(Generic[T]):
    """A frame among the worst or the best; the least key comes first, equal ones in no order that means anything."""

    key: float
    row: int
    item: _Item[T]

    @property
    def rank(self) -> tuple[float, int]:
        return self.key, _scattered(self.row)


def _scattered(row: int) -> int:
    """Return a number by which frames that are as bad as each other are spread over the whole recording."""
    return row * 2654435761 % 2**32


def _enter(ranked: list[_Ranked[T]], key: float, row: int, size: int, item: _Item[T]) -> None:
    """Enter a frame into a list of the best, in place of one close to it if there is any."""
    close = next((number for number, one in enumerate(ranked) if row - one.row < _APART), None)
    rival = close if close is not None else len(ranked) - 1 if len(ranked) == size else None
    if not size or (rival is not None and (key, _scattered(row)) >= ranked[rival].rank):
        return
    if rival is not None:
        del ranked[rival]
    insort(ranked, _Ranked(key, row, item), key=lambda one: one.rank)


def _thinned(items: list[Chosen[T]], count: int) -> list[Chosen[T]]:
    if len(items) <= count:
        return items
    return [items[number * len(items) // count] for number in range(count)]
