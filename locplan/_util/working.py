"""A sign of life for work that has no steps to count."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from locplan._util.progress import shown_after

if TYPE_CHECKING:
    from rich.progress import Progress


@contextmanager
def working(label: str, *, patience: float = 1.0) -> Iterator[None]:
    """Show on standard error what is done, and for how long, until it is done.

    It appears once the work has taken `patience` seconds, and vanishes when the work ends. It must
    not be shown while a `progress_bar` is. Nothing is shown if standard error is no terminal.
    """
    begun: list[Progress] = []

    def show() -> None:
        from rich import progress
        from rich.console import Console

        console = Console(stderr=True)
        if console.is_terminal:
            columns = progress.SpinnerColumn(), "{task.description}", progress.TimeElapsedColumn()
            begun.append(progress.Progress(*columns, console=console, transient=True))
            begun[0].add_task(label, total=None)
            begun[0].start()

    def close() -> None:
        for each in begun:
            each.stop()

    with shown_after(patience, show, close):
        yield
