"""The logs of Dask, which would repeat errors of a run between its lines."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_LIBRARIES = ("distributed", "dask_jobqueue", "tornado")


@contextmanager
def quiet() -> Iterator[None]:
    """Silence the logs of Dask until the context ends."""
    with suppress(ImportError):
        import distributed  # noqa: F401 - makes its loggers
    loggers = [
        logger
        for name, logger in logging.root.manager.loggerDict.items()
        if isinstance(logger, logging.Logger) and name.partition(".")[0] in _LIBRARIES
    ]
    before = [logger.disabled for logger in loggers]
    for logger in loggers:
        logger.disabled = True
    try:
        yield
    finally:
        for logger, was_disabled in zip(loggers, before, strict=True):
            logger.disabled = was_disabled
