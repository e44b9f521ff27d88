"""OMPL's log as a log of Python."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager

from locplan._util.leftovers import temporary_folder
from locplan.planners.ompl._bindings import util

LOG = logging.getLogger("locplan.ompl")
LOG.addHandler(logging.NullHandler())  # who wants to read it adds another
_LINE = re.compile(r"(Debug|Info|Warning|Error):\s*(.*)")
_HARMLESS = "Random number generation already started"
"""OMPL warns so at every seed but the first, although what is built afterwards obeys it."""


_LEVELS = (
    (logging.DEBUG, util.LogLevel.LOG_DEBUG),
    (logging.INFO, util.LogLevel.LOG_INFO),
    (logging.WARNING, util.LogLevel.LOG_WARN),
    (math.inf, util.LogLevel.LOG_ERROR),
)
"""The greatest levels of Python's log at which OMPL's levels are wanted."""


@contextmanager
def logged() -> Iterator[None]:
    """Pass OMPL's messages of this block to the logger "locplan.ompl" at its end.

    OMPL takes no Python function for this, and its own messages go to standard output.
    """
    with temporary_folder() as folder:
        file = folder / "ompl.log"
        handler = util.OutputHandlerFile(str(file))
        level = util.getLogLevel()
        util.useOutputHandler(handler)
        util.setLogLevel(next(ours for most, ours in _LEVELS if LOG.getEffectiveLevel() <= most))
        try:
            yield
        finally:
            util.setLogLevel(level)
            util.restorePreviousOutputHandler()
            for line in file.read_text(errors="replace").splitlines():
                found = _LINE.match(line)
                if found and not found[2].startswith(_HARMLESS):
                    LOG.log(logging.getLevelName(found[1].upper()), found[2])
