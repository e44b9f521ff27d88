"""Costmaps that several processes share: one file each, mapped into memory."""

from __future__ import annotations

import math
import mmap
import pickle
from functools import lru_cache
from pathlib import Path

from locplan.costs import Costmap
from locplan.errors import LocplanError


def put(costs: Costmap, folder: Path) -> None:
    """Write a costmap into a new folder, its arrays to files of their own.

    Raises
    ------
    LocplanError
        If the folder cannot be written.
    """
    _ = costs.grid.clearance  # paths are measured with it: computed once for all
    buffers: list[pickle.PickleBuffer] = []
    about = pickle.dumps(costs, protocol=5, buffer_callback=buffers.append)
    try:
        folder.mkdir()
        for n, buffer in enumerate(buffers):
            (folder / f"{n}.raw").write_bytes(buffer.raw())
        (folder / "about.pickle").write_bytes(about)
    except OSError as error:
        why = error.strerror or error
        raise LocplanError(f"{folder}: cannot be written ({why}); TMPDIR names another") from None


def get(folder: Path) -> Costmap:
    """The costmap; its pages are shared with all who have it, and read-only."""
    buffers = []
    for n in range(len(list(folder.glob("*.raw")))):
        with (folder / f"{n}.raw").open("rb") as file:
            buffers.append(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    costs: Costmap = pickle.loads((folder / "about.pickle").read_bytes(), buffers=buffers)
    return costs


@lru_cache(maxsize=1)
def weighted(folder: Path, weight: float) -> Costmap:
    """The costmap with a weight; the last one is kept."""
    return with_weight(_latest(folder), weight)


def with_weight(costs: Costmap, weight: float) -> Costmap:
    """The costmap with another weight; of one without a field, itself, whose only weight is 0."""
    if math.isnan(costs.weight) and weight == 0:
        return costs
    return costs if costs.weight == weight else costs.with_weight(weight)


@lru_cache(maxsize=1)
def _latest(folder: Path) -> Costmap:
    return get(folder)
