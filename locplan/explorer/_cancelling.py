"""Ending long work early: a token that the library's own progress calls look at."""

from __future__ import annotations

import threading

from locplan._util.progress import ProgressCallback


class Cancelled(Exception):
    """Long work was cancelled; it is no error of the user's, and never reaches one."""


class Cancel:
    """A token that one thread sets and the thread of the long work looks at.

    The library knows one honest way to end early: its progress callback raises. So work ends at its
    next progress call, and no sooner: what goes before the first one, such as a search, runs out.

    Examples
    --------
    >>> token = Cancel()
    >>> told = token.watching(lambda done, total: print(done, "of", total))
    >>> told(1, 8)
    1 of 8
    >>> token.cancel()
    >>> told(2, 8)
    Traceback (most recent call last):
    locplan.explorer._cancelling.Cancelled
    """

    def __init__(self) -> None:
        self._set = threading.Event()

    def cancel(self) -> None:
        """Ask the work to end; may be called from any thread, and more than once."""
        self._set.set()

    @property
    def cancelled(self) -> bool:
        """Whether the work was asked to end."""
        return self._set.is_set()

    def check(self) -> None:
        """Raise `Cancelled` if the work was asked to end."""
        if self.cancelled:
            raise Cancelled

    def watching(self, progress: ProgressCallback | None = None) -> ProgressCallback:
        """A progress callback that raises `Cancelled`, and else hands on to `progress`."""

        def update(done: int, total: int) -> None:
            self.check()
            if progress:
                progress(done, total)

        return update
