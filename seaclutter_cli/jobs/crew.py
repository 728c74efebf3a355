"""The loop of all engines with several processes, which retries the tasks of processes that died."""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from seaclutter_cli.jobs.answers import DIED, DONE, ERROR, SHARE
from seaclutter_cli.jobs.engine import Lost, R, Results, Task

_ATTEMPTS = 2


class Crew(Protocol):
    """Processes that each do one task at a time."""

    @property
    def is_busy(self) -> bool:
        """Whether any process works."""
        ...

    def give(self, waiting: deque[int], tasks: Sequence[Task[Any]]) -> list[int]:
        """Give waiting tasks to idle processes and return their numbers."""
        ...

    def answers(self, *, waiting: bool) -> Iterator[tuple[int, str, Any]]:
        """Yield number of the task, kind and content of what processes have sent.

        Parameters
        ----------
        waiting : bool
            Whether tasks wait, so that the crew should rather come back to start a process than wait for an answer.
        """
        ...


def run_tasks(crew: Crew, tasks: Sequence[Task[R]], on_share: Callable[[int, float], None]) -> Results[R]:
    """Run tasks, as `Engine.run` says; a process that dies costs its task one retry, and no other task anything."""
    waiting, attempts = deque(range(len(tasks))), Counter[int]()
    while waiting or crew.is_busy:
        attempts.update(crew.give(waiting, tasks))
        for number, kind, content in crew.answers(waiting=bool(waiting)):
            if kind == SHARE:
                on_share(number, content)
            elif kind == DONE:
                yield number, content
            elif kind == ERROR:
                raise content
            elif kind == DIED and attempts[number] < _ATTEMPTS:
                waiting.appendleft(number)
            else:
                yield number, Lost(f"{content}, {_ATTEMPTS} times")
