"""A progress bar for work that takes more than a second."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

ProgressCallback = Callable[[int, int], None]
"""Called with (done, total) as work proceeds."""


@contextmanager
def progress_bar(label: str, unit: str, *, patience: float = 1.0) -> Iterator[ProgressCallback]:
    """A bar on standard error with the rate and the time left.

    It appears only if the work still has some way to go after `patience` seconds, and vanishes
    when the work ends.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as TimeLeft

    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeLeft(),
        TextColumn("left"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    started = time.monotonic()
    task = bar.add_task(label, total=None, rate="")

    def update(done: int, total: int) -> None:
        elapsed = time.monotonic() - started
        if elapsed > patience and done < total and not bar.live.is_started:
            bar.start()
        rate = f"{done / max(elapsed, 1e-9):,.0f} {unit}/s"
        bar.update(task, completed=done, total=total, rate=rate)

    try:
        yield update
    finally:
        if bar.live.is_started:
            bar.stop()
