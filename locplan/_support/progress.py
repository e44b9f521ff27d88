"""Progress of work that takes more than a second: a bar on a terminal, otherwise a line."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn


LOG = logging.getLogger(__name__)
COMPILING = "compiling (only once)"
"""Text while kernels are compiled for numba's cache."""
DISPLAY_DELAY = 1.0
"""Time after which work is displayed [s]."""
ProgressCallback = Callable[[int, int], None]
"""Function that is called with (done, total) as work proceeds."""


def is_compiling() -> bool:
    """True if a kernel is being compiled."""
    module = sys.modules.get("locplan._support.compilation")  # its import loads numba
    return bool(getattr(module, "is_compiling", bool)())


@contextmanager
def show_progress_bar(
    label: str, unit: str, *, first: str = "starting"
) -> Iterator[ProgressCallback]:
    """Show a bar on standard error with the time left and, if it has a unit, the rate.

    It appears after one second and vanishes when the work ends. Before the first step it shows
    `first`, or that kernels are being compiled. If standard error is not a terminal, the label is
    logged instead.
    """
    bar = _ProgressBar(label, unit, first)
    with _show_after_delay(label, bar.show):
        yield bar.update


@contextmanager
def show_progress_bar_from_first_step(label: str, unit: str) -> Iterator[ProgressCallback]:
    """Show a progress bar from the first step on, so that an earlier display can end."""
    with ExitStack() as bar_stack:
        bars: list[ProgressCallback] = []

        def step(n_done: int, total: int) -> None:
            if not bars:
                bars.append(bar_stack.enter_context(show_progress_bar(label, unit)))
            bars[0](n_done, total)

        yield step


@contextmanager
def show_spinner(label: str) -> Iterator[None]:
    """Show a label and the elapsed time on standard error during the work.

    It appears after one second and vanishes when the work ends. It must not be
    shown while a `show_progress_bar` is. If standard error is not a terminal, the label is logged
    instead.
    """

    def show() -> Progress:
        from rich.progress import SpinnerColumn, TimeElapsedColumn

        columns = SpinnerColumn(), "{task.description}", TimeElapsedColumn()
        return _start_display(label, *columns, total=None)

    with _show_after_delay(label, show):
        yield


@contextmanager
def _show_after_delay(label: str, show: Callable[[], Progress]) -> Iterator[None]:
    """Show a display once the work has taken a second, until it ends; log it without a terminal."""
    displays: list[Progress] = []

    def begin() -> None:
        if is_terminal():
            displays.append(show())
        else:
            LOG.info(label)

    began = time.monotonic()
    timer = threading.Timer(DISPLAY_DELAY, begin)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        for display in displays:
            display.stop()
        LOG.debug("%s: %.1f s", label, time.monotonic() - began)


def is_terminal() -> bool:
    """True if standard error is a terminal that can move its cursor.

    FORCE_COLOR does not count: continuous integration sets it, and keeps the output in a file.
    """
    if os.environ.get("TERM") in ("dumb", "unknown"):
        return False
    return sys.stderr is not None and sys.stderr.isatty()


def _start_display(label: str, *columns: ProgressColumn | str, **task: Any) -> Progress:
    """Start a display of rich on standard error."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True, force_terminal=True)
    display = Progress(*columns, console=console, transient=True)
    display.add_task(label, **task)
    display.start()
    return display


class _ProgressBar:
    """A progress bar of rich, imported only when there is something to show.

    Its text, next to the bar, is the rate, or the current activity before the first step.
    """

    def __init__(self, label: str, unit: str, first: str) -> None:
        self._label, self._unit, self._first = label, unit, first
        self._lock = threading.Lock()
        self._began: tuple[float, int] | None = None  # compilation says nothing about the rate
        self._n_done, self._total, self._rate = 0, 0, ""
        self._bar: Progress | None = None

    def show(self) -> Progress:
        """Show the bar from now on."""
        from rich import progress

        bar, share, left = (
            progress.BarColumn(),
            progress.TaskProgressColumn(),
            progress.TimeRemainingColumn(),
        )
        columns = "{task.description}", bar, share, "{task.fields[says]}", left, "left"
        with self._lock:
            task = {"total": self._total or None, "completed": self._n_done, "says": self}
            self._bar = _start_display(self._label, *columns, **task)
        return self._bar

    def update(self, n_done: int, total: int) -> None:
        """Update the number of finished steps."""
        with self._lock:
            now, fresh = time.monotonic(), self._began is None and n_done > 0
            self._n_done, self._total = n_done, total
            if fresh:
                self._began = now, n_done
            elif self._began and now > self._began[0]:
                rate = (n_done - self._began[1]) / (now - self._began[0])
                self._rate = f"{rate:,.0f} {self._unit}/s" if self._unit else ""
            if self._bar and self._began:
                (task,) = self._bar.task_ids
                act = self._bar.reset if fresh else self._bar.update
                act(task, total=total, completed=n_done)

    def __str__(self) -> str:
        if self._began:
            return self._rate
        return COMPILING if is_compiling() else self._first


def split_progress(
    progress: ProgressCallback | None, sizes: Sequence[int]
) -> list[ProgressCallback]:
    """Return callbacks for consecutive parts of one task, with `sizes` steps."""

    def make_part_callback(before: int) -> ProgressCallback:
        def update(n_done: int, _: int) -> None:
            if progress:
                progress(before + n_done, sum(sizes))

        return update

    return [make_part_callback(sum(sizes[:n])) for n in range(len(sizes))]


def scale_progress(progress: ProgressCallback | None, steps: int) -> ProgressCallback:
    """Return a callback that scales any count of a part of the work to a number of steps."""

    def update(n_done: int, total: int) -> None:
        if progress:
            progress(steps * n_done // max(1, total), steps)

    return update


def chain_progress(progress: ProgressCallback, runs: int) -> ProgressCallback:
    """Return a callback that reports several consecutive runs as one."""
    before = last = 0

    def update(n_done: int, total: int) -> None:
        nonlocal before, last
        before += total if n_done < last else 0
        last = n_done
        progress(min(before + n_done, runs * total), runs * total)

    return update
