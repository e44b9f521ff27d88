"""A short featureless corridor or a longer one with landmarks: which one does the robot take?

Run: python examples/two_corridors.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import locplan
from locplan.planning import figures

MAP = Path(__file__).resolve().parent.parent / "maps" / "two_corridors.yaml"


def main(folder: str = "two_corridors") -> None:
    grid = locplan.load_map(MAP)
    robot = locplan.Robot("turtlebot3")
    field = locplan.load_or_compute(grid, locplan.Fused(robot.lidar))
    costs = locplan.Costmap.from_field(field, robot=robot)
    start, goal = (2.0, 3.0), (38.0, 3.0)
    plans = {"shortest": locplan.plan(costs.with_weight(0.0), start, goal).with_costs(costs)}
    plans["least cost"] = locplan.plan(costs, start, goal)
    for label, plan in plans.items():
        metrics = plan.metrics
        print(
            f"{label:>10}: {metrics.length:5.1f} m long, {metrics.integrated_u:4.1f} m degenerate"
        )

    picture = Path(folder) / "plan.png"
    picture.parent.mkdir(parents=True, exist_ok=True)
    figures.plan_figure(costs, field, plans).savefig(picture, dpi=130)
    print(f"wrote {picture}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
