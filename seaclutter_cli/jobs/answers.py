"""Answers of another process to a task."""

import pickle
import traceback
from typing import Any

from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.jobs.engine import Report, Task

SHARE, DONE, ERROR, DIED = "share", "done", "error", "died"
"""Kinds of answers: the share of a task that is done, its result, its error, and the end of the process."""


def answer(task: Task[Any], report: Report) -> bytes:
    """Do a task and return its pickled answer: kind and content, which is the result or the error."""
    try:
        return pickle.dumps((DONE, task(report)))
    except (BrokenPipeError, ConnectionResetError):
        raise
    except SeaclutterError as error:
        return pickle.dumps((ERROR, error))
    except Exception as error:  # noqa: BLE001 - raised again in the first process
        error.add_note(traceback.format_exc())
        return pickle.dumps((ERROR, error))
