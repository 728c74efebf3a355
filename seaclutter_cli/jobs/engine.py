"""Engines, which run tasks and yield their results; the loop of those with several processes."""

import pickle
import traceback
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar

from seaclutter_cli.errors import SeaclutterError

_ATTEMPTS = 2

R = TypeVar("R")

Report = Callable[[float], None]
"""Function to call with the share of a task that is done, from 0 to 1."""

Task = Callable[[Report], R]
"""Work that can be sent to another process: pickle can copy it and its result. An exception ends the whole run."""


@dataclass(frozen=True)
class Lost:
    """The end of a task whose process died, again and again, and what is known about the reason."""

    reason: str


Results = Generator[tuple[int, R | Lost], None, None]
"""Numbers and results of tasks."""

OnShare = Callable[[int, float], None]
"""Function that receives the number of a task and the share of it that is done."""

Engine = Callable[[Sequence[Task[R]], OnShare], Results[R]]
"""Function that runs tasks in their order and yields the number and the result of each when it is done, in any order.

Results do not depend on the engine. Closing the iterator stops the tasks that run. An exception of a task is raised in
it and stops the others.
"""


def run_in_turn(tasks: Sequence[Task[R]], on_share: OnShare) -> Results[R]:
    """Run tasks in this process, one after another; see `Engine`."""
    for number, task in enumerate(tasks):
        yield number, task(partial(on_share, number))


SHARE, DONE, ERROR, DIED = "share", "done", "error", "died"
"""Kinds of answers: the share of a task that is done, its result, its error, and the end of the process."""


def answer(task: Task[Any], report: Report) -> bytes:
    """Do a task and return its pickled answer: kind and content, which is the result or the error."""
    try:
        return pickle.dumps((DONE, task(report)))
    except (BrokenPipeError, ConnectionResetError):
        raise
    except Exception as error:  # noqa: BLE001 - raised again in the first process
        if not isinstance(error, SeaclutterError):
            error.add_note(traceback.format_exc())
        return pickle.dumps((ERROR, error))


class Pool(Protocol):
    """Processes that each do one task at a time."""

    def give(self, waiting: deque[int], tasks: Sequence[Task[Any]]) -> list[int]:
        """Give waiting tasks to idle processes and return their numbers."""

    def answers(self) -> Iterator[tuple[int, str, Any]]:
        """Yield number of the task, kind and content of what processes have sent."""


def run_with_retries(pool: Pool, tasks: Sequence[Task[R]], on_share: OnShare) -> Results[R]:
    """Run tasks, as `Engine` says; a process that dies costs its task one retry, and no other task anything."""
    waiting, running, attempts = deque(range(len(tasks))), set[int](), Counter[int]()
    while waiting or running:
        given = pool.give(waiting, tasks)
        attempts.update(given)
        running.update(given)
        for number, kind, content in pool.answers():
            if kind == SHARE:
                on_share(number, content)
                continue
            running.discard(number)
            if kind == DONE:
                yield number, content
            elif kind == ERROR:
                raise content
            elif kind == DIED and attempts[number] < _ATTEMPTS:
                waiting.appendleft(number)
            else:
                yield number, Lost(f"{content}, {_ATTEMPTS} times")
