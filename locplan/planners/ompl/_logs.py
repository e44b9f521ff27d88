"""OMPL's log, as Python's."""

from __future__ import annotations

import logging
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

from locplan.planners.ompl._bindings import util

LOG = logging.getLogger("locplan.ompl")
LOG.addHandler(logging.NullHandler())  # who wants to read it adds another
_LINE = re.compile(r"(Debug|Info|Warning|Error):\s*(.*)")
_HARMLESS = "Random number generation already started"
"""Said at every seed but the first, although what is built afterwards obeys it."""


@contextmanager
def logged() -> Iterator[None]:
    """Pass what OMPL says meanwhile to the logger "locplan.ompl", once it is done.

    OMPL takes no Python function for this, and its own messages go to standard output.
    """
    with tempfile.NamedTemporaryFile("r", suffix=".log") as file:
        handler = util.OutputHandlerFile(file.name)
        level = util.getLogLevel()
        util.useOutputHandler(handler)
        util.setLogLevel(_level())
        try:
            yield
        finally:
            util.setLogLevel(level)
            util.restorePreviousOutputHandler()
            for line in file:
                found = _LINE.match(line)
                if found and not found[2].startswith(_HARMLESS):
                    LOG.log(logging.getLevelName(found[1].upper()), found[2])


def _level() -> util.LogLevel:
    levels = (
        (logging.DEBUG, util.LogLevel.LOG_DEBUG),
        (logging.INFO, util.LogLevel.LOG_INFO),
        (logging.WARNING, util.LogLevel.LOG_WARN),
    )
    wanted = LOG.getEffectiveLevel()
    return next((ours for theirs, ours in levels if wanted <= theirs), util.LogLevel.LOG_ERROR)
