"""The logs of Dask, which would repeat errors of a run between its lines."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_NEVER = logging.CRITICAL + 1
_LIBRARIES = ("distributed", "dask_jobqueue", "tornado")


@contextmanager
def quiet() -> Iterator[None]:
    """Silence the logs of Dask until the context ends."""
    with suppress(ImportError):
        import distributed  # noqa: F401 - makes its loggers
    for name in _LIBRARIES:
        logging.getLogger(name)
    known = [logger for name, logger in logging.root.manager.loggerDict.items() if name.partition(".")[0] in _LIBRARIES]
    loggers = [logger for logger in known if isinstance(logger, logging.Logger)]
    before = [logger.level for logger in loggers]
    for logger in loggers:  # those that are made later have the level of the first of their name
        logger.setLevel(_NEVER)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
