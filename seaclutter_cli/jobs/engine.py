"""Engines, which run tasks and yield their results."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

R = TypeVar("R")
R_co = TypeVar("R_co", covariant=True)

Report = Callable[[float], None]
"""Function to call with the share of a task that is done, from 0 to 1."""


class Task(Protocol[R_co]):
    """Work that can be sent to another process: pickle can copy the object and its result."""

    def __call__(self, report: Report) -> R_co:
        """Do the work; an exception ends the whole run."""
        ...


@dataclass(frozen=True)
class Lost:
    """The end of a task whose process died, again and again.

    Parameters
    ----------
    reason : str
        What is known about it.
    """

    reason: str


Results = Generator[tuple[int, R | Lost], None, None]
"""Numbers and results of tasks."""


class Engine(Protocol):
    """A way to run tasks. Results do not depend on it."""

    def run(self, tasks: Sequence[Task[R]], on_share: Callable[[int, float], None]) -> Results[R]:
        """Run tasks and yield the number and the result of each when it is done, in any order.

        Closing the iterator stops the tasks that run. An exception of a task is raised here and stops the others.

        Parameters
        ----------
        tasks : sequence of Task
            Work; tasks start in this order.
        on_share : callable
            Receives the number of a task and the share of it that is done.
        """
        ...


class InTurn:
    """Engine that runs tasks in this process, one after another."""

    def run(self, tasks: Sequence[Task[R]], on_share: Callable[[int, float], None]) -> Results[R]:
        """Run tasks, as `Engine.run` says."""
        for number, task in enumerate(tasks):
            yield number, task(lambda share, number=number: on_share(number, share))  # type: ignore[misc]
