"""The three estimators side by side: what the paper's disc sees, and what a lidar sees.

Run: python examples/estimators.py [FOLDER [MAP.yaml ...]]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import locplan


def main(folder: str = "estimators", *maps: str) -> None:
    grids = [locplan.load_map(path) for path in maps] or [
        locplan.maps.environments.make(name, resolution=0.1) for name in ("places", "warehouse")
    ]
    lidar = locplan.Lidar(range=30.0)
    estimators = {
        "sad, 6 m": locplan.Sad(),
        "fisher, 30 m": locplan.Fisher(lidar),
        "scan, 30 m": locplan.Scan(lidar),
    }
    rows = []
    for grid in grids:
        rows.append({})
        for label, estimator in estimators.items():
            began = time.perf_counter()
            field = locplan.covariance_field(grid, estimator)
            took = f"{time.perf_counter() - began:.1f} s, {field.saturated_share:.0%} saturated"
            print(f"{grid.name}, {label}: {took}")
            rows[-1][f"{grid.name}: {label}\n{took}"] = field
    target = Path(folder) / "estimators.png"
    target.parent.mkdir(parents=True, exist_ok=True)
    locplan.plotting.save_figure(locplan.plotting.fields_figure(rows, "position_std"), target)
    print(f"wrote {target}")


if __name__ == "__main__":
    main(*sys.argv[1:])
