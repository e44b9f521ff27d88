"""A progress bar for work that takes more than a second."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

ProgressCallback = Callable[[int, int], None]
"""Function that is called with (done, total) as work proceeds."""


@contextmanager
def progress_bar(label: str, unit: str, *, patience: float = 1.0) -> Iterator[ProgressCallback]:
    """Show a bar on standard error with the time left and, if it has a unit, the rate.

    It appears once the work has taken `patience` seconds, also before anything is done (the
    first run of all compiles the kernels), and vanishes when the work ends. There is no bar if
    standard error is no terminal.
    """
    from rich import progress
    from rich.console import Console

    console = Console(stderr=True)
    bar = progress.Progress(
        "{task.description}",
        progress.BarColumn(),
        progress.TaskProgressColumn(),
        "{task.fields[rate]}",
        progress.TimeRemainingColumn(),
        "left",
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    task = bar.add_task(label, total=None, rate="starting (the first run compiles)")
    first: tuple[float, int] | None = None  # compilation says nothing about the rate

    def update(done: int, total: int) -> None:
        nonlocal first
        now = time.monotonic()
        if first is None and done:
            first = now, done
            bar.reset(task, total=total, completed=done, rate="")
        elif first is not None and now > first[0]:
            rate = (done - first[1]) / (now - first[0])
            text = f"{rate:,.0f} {unit}/s" if unit else ""
            bar.update(task, completed=done, total=total, rate=text)

    timer = threading.Timer(patience, bar.start)
    timer.daemon = True
    timer.start()
    try:
        yield update
    finally:
        timer.cancel()
        timer.join()
        if bar.live.is_started:
            bar.stop()


def parts(progress: ProgressCallback | None, sizes: Sequence[int]) -> list[ProgressCallback]:
    """Callbacks for the parts of one task, which follow each other and have `sizes` steps."""

    def part(before: int) -> ProgressCallback:
        def update(done: int, _: int) -> None:
            if progress:
                progress(before + done, sum(sizes))

        return update

    return [part(sum(sizes[:n])) for n in range(len(sizes))]


def in_turn(progress: ProgressCallback, runs: int) -> ProgressCallback:
    """Callback for several runs, one after the other, that reports them as one."""
    before = last = 0

    def update(done: int, total: int) -> None:
        nonlocal before, last
        before += total if done < last else 0
        last = done
        progress(min(before + done, runs * total), runs * total)

    return update
