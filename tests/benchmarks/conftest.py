"""A yardstick in the same run, to compare benchmarks without a peer between runs."""

import time

import numpy as np
import pytest

SORTED = 1_000_000
"""How many numbers NumPy sorts: some 10 to 80 ms of plain work."""


def sorting_seconds() -> float:
    """The least seconds of three sorts."""
    numbers = np.random.default_rng(0).random(SORTED)
    seconds = []
    for _ in range(3):
        began = time.perf_counter()
        np.sort(numbers)
        seconds.append(time.perf_counter() - began)
    return min(seconds)


@pytest.fixture(autouse=True)
def _yardstick(benchmark):
    before = sorting_seconds()
    yield
    benchmark.extra_info["yardstick"] = min(before, sorting_seconds())
