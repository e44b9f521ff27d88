"""Cases of parametrized tests: some by default, all with `-m long`."""

from __future__ import annotations

import pytest


def sample_cases(values, usual: int = 1, *, are_rows: bool = False) -> list:
    """Parameters of a test: the first ones by default, the others with `-m long`.

    Rows have a value for each of several arguments.
    """
    rows = values[usual:] if are_rows else [(value,) for value in values[usual:]]
    long = [pytest.param(*row, marks=pytest.mark.long) for row in rows]
    return [*values[:usual], *long]
