"""Compiling kernels that are needed later in a process of their own, while a field is computed."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

from locplan._util.progress import COMPILING, progress_bar
from locplan._util.supervision import end_with_parent


class Prepared(Protocol):
    """A planner, or anything else whose kernels `prepare` compiles."""

    @property
    def name(self) -> str:
        """What is shown while one waits for it."""

    def prepare(self) -> None:
        """Compile the kernels."""


@contextmanager
def prepared_beside(
    user: Prepared, *, compiled: Callable[[], bool] | None = None
) -> Iterator[Callable[[], None]]:
    """Let another process compile what a planner needs while this one does something long.

    Threads would not do: within a process numba compiles one kernel after the other. What the
    other process has compiled is read from numba's cache. If that holds the kernels already,
    there is no other process; if it fails, this one compiles them when it plans.

    Parameters
    ----------
    user : Prepared
        The planner.
    compiled : callable, optional
        Function that returns whether the kernels are in numba's cache; by default it looks for
        those of the grid's planners.

    Yields
    ------
    callable
        Function that waits for the other process, to be called before one plans.
    """
    process = _process(user) if not (compiled or _compiled)() else None

    def wait() -> None:
        if process and process.poll() is None:
            with progress_bar(user.name, "", first=COMPILING):
                process.wait()

    try:
        yield wait
    finally:
        if process and process.poll() is None:
            process.kill()
            process.wait()


def _compiled() -> bool:
    """Whether the kernels of the planners that need no OMPL have been compiled before."""
    from locplan._kernels import are_cached
    from locplan._kernels.any_angle import shift, shortcut
    from locplan._kernels.rays import cells_along
    from locplan._kernels.ways import trace

    return are_cached(cells_along, trace, shortcut, shift)


def _process(user: Prepared) -> subprocess.Popen[bytes] | None:
    """A process that prepares a planner; None where it cannot be started or have the planner."""
    try:
        content = pickle.dumps(user)
    except (AttributeError, TypeError, pickle.PicklingError):
        return None
    command = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import main"
    try:
        process = subprocess.Popen(
            [sys.executable or "python", "-c", f"{command}; main({os.getpid()})"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    except OSError:  # the system has no room for one more process
        return None
    assert process.stdin is not None
    with suppress(BrokenPipeError), process.stdin as pipe:
        pipe.write(content)
    return process


def main(parent: int) -> None:
    """Prepare the planner that comes through standard input, and end with the parent."""
    end_with_parent(parent)
    pickle.load(sys.stdin.buffer).prepare()
