"""Export masks, a path and a route graph for a navigation stack.

Run: python examples/navigation.py [FOLDER [MAP.yaml]]
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import locplan
from locplan.export import nav2_keepout, nav2_routes, nav2_speed
from locplan.maps import environments


def main(folder: str = "navigation", map_file: str | None = None) -> None:
    grid = locplan.load_map(map_file) if map_file else environments.make("two_corridors")
    field = locplan.load_or_compute(grid, locplan.Sad())
    costs = locplan.Costmap.from_field(field)
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)

    mask = nav2_keepout(target / "keepout", costs, planner="smac2d")
    print(f"SmacPlanner2D: {mask.planner.parameter} {mask.parameter_value:g} charges J to within")
    print(f"{mask.quantisation:.3f} per metre, up to weight · u = {mask.max_excess:.2f}")
    nav2_speed(target / "speed", costs, slowest=0.3)
    if map_file is None:
        plan = locplan.plan(costs, (2.0, 3.0), (38.0, 3.0))
        if plan.path is not None:
            message = json.dumps(plan.path.to_nav_msgs())  # a nav_msgs/Path; JSON is YAML, too
            (target / "aware.yaml").write_text(message, encoding="utf-8")
            ways = nav2_routes(target / "routes", costs, {"aware": plan.path})
            print(f"route graph: {len(ways.graph.nodes)} nodes, {len(ways.graph.edges)} edges")
    print(f"wrote {', '.join(sorted(entry.name for entry in target.iterdir()))}")


if __name__ == "__main__":
    main(*sys.argv[1:])
