"""Windows of arrays about a position."""

from __future__ import annotations

import math


def window_around(
    row: float, col: float, reach: float, map_shape: tuple[int, int]
) -> tuple[slice, slice]:
    """Rows and columns of a map within `reach` of a position [cells]."""
    ends = [
        slice(*(min(max(int(v), 0), size) for v in (math.floor(at - reach), at + reach + 1)))
        for at, size in zip((row, col), map_shape, strict=True)
    ]
    return ends[0], ends[1]
