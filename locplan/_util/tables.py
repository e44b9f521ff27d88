"""Numbers as people read them: tables, sizes, ages; and as files do."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.files import replacing


def write_csv(target: Path, values: NDArray[np.float64], header: str, number: str = "%.6f") -> None:
    """Columns of numbers with a header, whole or not at all."""
    with replacing(target) as temporary:
        np.savetxt(temporary, values, number, delimiter=",", header=header, comments="")


def finite(values: Any) -> Any:
    """JSON knows neither NaN nor infinity: null stands for both, at any depth."""
    if isinstance(values, Mapping):
        return {key: finite(value) for key, value in values.items()}
    if isinstance(values, (list, tuple)):
        return [finite(value) for value in values]
    return None if isinstance(values, float) and not math.isfinite(values) else values


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows under their columns, as wide as the terminal."""
    from rich import box
    from rich.console import Console
    from rich.table import Column, Table
    from rich.text import Text

    heads = [Column(column, overflow="fold") for column in columns]
    grid = Table(*heads, box=box.SIMPLE if columns else None, show_header=bool(columns))
    for row in rows:
        grid.add_row(*(Text(text) for text in row))  # a map's name may hold brackets
    console = Console()
    with console.capture() as capture:
        console.print(grid)
    return "\n".join(line.rstrip() for line in capture.get().splitlines() if line.strip())


def in_bytes(size: float) -> str:
    """A size as people write it."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 999.5:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:,.4g} TB"


def age(moment: float) -> str:
    """How long ago a moment was, in seconds since the epoch."""
    seconds = max(0.0, time.time() - moment)
    for size, unit in ((86400, "d"), (3600, "h"), (60, "min")):
        if seconds >= size:
            return f"{seconds / size:.0f} {unit} ago"
    return "just now"
