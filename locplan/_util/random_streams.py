"""Streams of random numbers that follow from one seed."""

from __future__ import annotations

import numpy as np


def random_of(seed: int, *stream: int) -> np.random.Generator:
    """Random numbers that are independent of those of any other stream."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=stream))
