"""A sign of life for work that has no steps to count."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def working(label: str, *, patience: float = 1.0) -> Iterator[None]:
    """Show on standard error what is done, and for how long, until it is done.

    It appears once the work has taken `patience` seconds, and vanishes when the work ends. It must
    not be shown while a `progress_bar` is. Nothing is shown if standard error is no terminal.
    """
    from rich import progress
    from rich.console import Console

    console = Console(stderr=True)
    bar = progress.Progress(
        progress.SpinnerColumn(),
        "{task.description}",
        progress.TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    bar.add_task(label, total=None)
    timer = threading.Timer(patience, bar.start)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        if bar.live.is_started:
            bar.stop()
