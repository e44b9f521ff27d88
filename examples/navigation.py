"""Everything that a navigation stack takes: masks, a route graph, and a bag with the paths.

Run: python examples/navigation.py [FOLDER [MAP.yaml]]
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

import locplan
from locplan import export


def main(folder: str = "navigation", map_file: str | None = None) -> None:
    if find_spec("mcap") is None:  # said before the work: the bag comes last
        sys.exit("the bag needs mcap: pip install 'locplan[ros]'")
    grid = (
        locplan.load_map(map_file) if map_file else locplan.maps.environments.make("two_corridors")
    )
    field = locplan.load_or_compute(grid, locplan.Sad())
    costs = locplan.Costmap.from_field(grid, field)
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)

    mask = export.nav2_keepout(target / "keepout", costs, planner="smac2d")
    print(f"SmacPlanner2D: {mask.planner.parameter} {mask.param:g} charges J to within")
    print(f"{mask.quantisation:.3f} per metre, up to weight · u = {mask.greatest:.2f}")
    export.nav2_speed(target / "speed", costs, slowest=0.3)
    graph = export.route_graph(target / "routes", costs)
    print(f"route graph: {len(graph.nodes)} nodes, {len(graph.edges)} edges")

    paths = {}
    if map_file is None:
        plan = locplan.plan(costs, (2.0, 3.0), (38.0, 3.0))
        if plan.path is not None:
            paths["aware"] = plan.path
            export.path(target / "aware.yaml", plan.path)  # a nav_msgs/Path
    export.bag(target / "field.mcap", grid, mask=export.percent(costs), field=field, paths=paths)
    print(f"wrote {', '.join(sorted(entry.name for entry in target.iterdir()))}")


if __name__ == "__main__":
    main(*sys.argv[1:])
