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
    """Write a costmap into a new folder, each of its arrays to a file of its own."""
    # Paths are measured with these: made once for all, and in no planner's time.
    _ = costs.grid.clearance, costs.u_of_heading
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


@lru_cache(maxsize=1)
def get(folder: Path) -> Costmap:
    """Read a costmap, whose read-only arrays all processes share in memory; the last is kept."""
    buffers = []
    for n in range(len(list(folder.glob("*.raw")))):
        with (folder / f"{n}.raw").open("rb") as file:
            buffers.append(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    costs: Costmap = pickle.loads((folder / "about.pickle").read_bytes(), buffers=buffers)
    return costs


@lru_cache(maxsize=1)
def weighted(folder: Path, weight: float) -> Costmap:
    """The costmap with a weight, which is 0 for one without a field; the last one is kept."""
    costs = get(folder)
    if math.isnan(costs.weight) and weight == 0:
        return costs
    return costs if costs.weight == weight else costs.with_weight(weight)
