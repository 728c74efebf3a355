"""What the tests of a folder share, from the first of them to the last."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any

import pytest

_HELD = pytest.StashKey[dict[Callable[..., Any], Any]]()


def in_folder(
    request: pytest.FixtureRequest, file: str, make: Callable[..., AbstractContextManager[Any]], *arguments: Any
) -> Any:
    """Return what a context manager gives, which the first test below the folder of a file enters and the last leaves.

    A fixture with ``scope="package"`` would last until the end of the run where the folder is no package.
    """
    folder = next(node for node in request.node.iter_parents() if node.path == Path(file).parent)
    held = folder.stash.setdefault(_HELD, {})
    if make not in held:
        stack = ExitStack()
        folder.addfinalizer(stack.close)
        held[make] = stack.enter_context(make(*arguments))
        stack.callback(held.pop, make)
    return held[make]
