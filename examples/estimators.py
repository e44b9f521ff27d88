"""Compare the estimators on the part of a map where they differ most.

Run: python examples/estimators.py [FOLDER [MAP.yaml ...]]
"""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter

import locplan
from locplan.field import figures
from locplan.maps import environments

WINDOW = 18.0
"""Side of the drawn part of each map [m]."""


def main(folder: str = "estimators", *maps: str) -> None:
    grids = [locplan.load_map(path) for path in maps] or [
        environments.make(name, resolution=0.1) for name in ("places", "warehouse")
    ]
    lidar = locplan.Lidar(range=30.0)
    estimators = {
        "sad, 6 m": locplan.Sad(),
        "fisher, 30 m": locplan.Fisher(lidar),
        "scan, 30 m": locplan.Scan(lidar),
        "fused, 30 m": locplan.Fused(lidar),
    }
    rows, parts = [], []
    for grid in grids:
        rows.append({})
        for label, estimator in estimators.items():
            began = time.perf_counter()
            field = locplan.covariance_field(grid, estimator)
            print(f"{grid.name}, {label}: {time.perf_counter() - began:.1f} s")
            rows[-1][label] = field
        parts.append(crop_largest_difference(list(rows[-1].values())))
    target = Path(folder) / "estimators.png"
    target.parent.mkdir(parents=True, exist_ok=True)
    figures.fields_figure(rows, "position_std", parts).savefig(target, dpi=130)
    print(f"wrote {target}")


def crop_largest_difference(fields: Sequence[locplan.CovarianceField]) -> locplan.OccupancyGrid:
    """Return the part of the map in which the relative deviations of the estimators differ most."""
    grid, stride = fields[0].grid, fields[0].stride
    logs = np.log([field.scalar("position_std") for field in fields])
    known = np.isfinite(logs).all(axis=0)
    logs -= np.median(logs[:, known], axis=1)[:, None, None]  # their levels differ everywhere
    apart = np.where(known, np.ptp(logs, axis=0), 0.0)
    size = round(WINDOW / grid.resolution)
    middle = uniform_filter(apart, max(1, size // stride), mode="constant").argmax()
    firsts = [
        min(max(0, stride * int(at) - size // 2), max(0, cells - size))
        for at, cells in zip(np.unravel_index(middle, apart.shape), grid.shape, strict=True)
    ]
    cells = grid.cells[firsts[0] : firsts[0] + size, firsts[1] : firsts[1] + size]
    x, y = (float(value) for value in grid.grid_to_world(*firsts))
    return dataclasses.replace(grid, cells=cells, origin=(x, y, grid.origin[2]))


if __name__ == "__main__":
    main(*sys.argv[1:])
