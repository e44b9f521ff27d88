"""Plan with a custom cost: keep away from walls, in addition to localizability.

Run: python examples/own_cost.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import locplan
from locplan.maps import environments


def main(folder: str = "own_cost") -> None:
    grid = environments.make("office", resolution=0.1)
    ends = environments.place_positions("office")
    field = locplan.load_or_compute(grid, locplan.FieldConfig(stride=0.4))
    aware = locplan.Costmap.from_field(field)
    near_walls = np.clip(1.0 - grid.clearance / 0.8, 0.0, 1.0)
    both = locplan.Costmap.from_density(grid, aware.density + 3.0 * near_walls, robot=0.25)
    for label, costs in (("localizability", aware), ("and clearance", both)):
        plan = locplan.plan(costs, ends["start"], ends["goal"])
        metrics = plan.with_costs(aware).metrics
        print(f"{label:>15}: {metrics.length:.1f} m, at least {metrics.clearance:.2f} m from walls")
        target = Path(folder) / f"{label.replace(' ', '_')}.csv"
        target.parent.mkdir(parents=True, exist_ok=True)
        plan.path.save(target)


if __name__ == "__main__":
    main(*sys.argv[1:2])
