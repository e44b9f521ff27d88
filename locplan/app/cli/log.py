"""Lines on standard error: the package's log, Python's warnings, and errors."""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from locplan.errors import format_one_line

PACKAGE, OMPL = "locplan", "locplan.ompl"
LOG = logging.getLogger("locplan.app.cli")


def print_line(line: str, *notes: str, name: str = PACKAGE) -> None:
    """Print a line and notes on standard error."""
    if sys.stderr is None:
        return
    try:
        print(f"{name}: {format_one_line(line)}", *notes, sep="\n", file=sys.stderr, flush=True)
    except OSError:  # the disk is full: only the exit code reports an error
        sys.stderr = None


class LineHandler(logging.Handler):
    """Handler that prints each message as a line, next to a progress bar if there is one."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a message."""
        from locplan.app.cli.wording import translate_options

        name = record.name
        text = record.getMessage()
        if name.partition(".")[0] == PACKAGE and record.levelno >= logging.INFO:
            name = PACKAGE
        if record.levelno >= logging.WARNING:
            text = f"warning: {translate_options(text)}"
        print_line(text, name=name)


@contextmanager
def show_log(*, is_verbose: bool) -> Iterator[None]:
    """Print the package's log and warnings; if verbose, its details and other packages' warnings.

    OMPL's log is a detail: it repeats what the result says.
    """
    levels = {
        PACKAGE: logging.DEBUG if is_verbose else logging.INFO,
        OMPL: logging.DEBUG if is_verbose else logging.CRITICAL,
    }
    loggers = {logging.getLogger(name): level for name, level in levels.items()}
    previous_levels = {logger: logger.level for logger in loggers}
    handler, root = LineHandler(), logging.getLogger()
    if not is_verbose:
        handler.addFilter(logging.Filter(PACKAGE))
    root.addHandler(handler)
    try:
        for logger, level in loggers.items():
            logger.setLevel(level)
        with _log_warnings():
            yield
    finally:
        root.removeHandler(handler)
        for logger, level in previous_levels.items():
            logger.setLevel(level)


@contextmanager
def _log_warnings() -> Iterator[None]:
    """Log each warning of this package, and as details those of other packages."""

    def show(message: Any, category: type[Warning], *_: Any, **__: Any) -> None:
        if category.__module__.startswith(f"{PACKAGE}."):
            LOG.warning("%s", message)
        else:  # users can do nothing about warnings of other libraries
            LOG.debug("%s: %s", category.__name__, message)

    with warnings.catch_warnings():
        warnings.simplefilter("default")
        warnings.showwarning = show
        yield
