"""The command that drives paths in simulated worlds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from locplan.cli._groups import GENERAL, command, option_group
from locplan.cli._options import (
    Computing,
    CostOptions,
    FieldOptions,
    Json,
    MapFiles,
    Text,
    config_of,
)
from locplan.cli._simulation_options import Folder, SimulationOptions
from locplan.cli._values import read_paths, say_written, show, two_numbers
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.simulation._routes import Routes

app = command(
    "simulate",
    "simulate lab.yaml --start 2,3 --goal 38,3 -o driven",
    "simulate lab.yaml --path planned/shortest.csv --path mine.csv -o driven",
    "simulate lab.yaml --random 20 -o queries",
)


@option_group(GENERAL)
class Driven:
    """What is driven."""

    path: Annotated[tuple[Path, ...], Parameter(metavar="CSV")] = ()
    """This path (x_m,y_m) is driven, as plan wrote it; repeatable."""
    start: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """The shortest and the aware path from here are driven [m]."""
    goal: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """They end here [m]."""
    random: Annotated[int | None, Parameter(validator=Number(gte=2))] = None
    """Both paths of so many random queries on each map are driven; 5 or more give intervals."""
    least_distance: float = 10.0
    """Random queries are this far from start to goal at least [m]; 10 by default."""
    drives: Annotated[int, Parameter(validator=Number(gte=2))] = 100
    """The number of drives along each path is 100 by default."""


@app.default
def simulate(
    maps: MapFiles,
    /,
    *,
    driven: Driven = Driven(),
    simulation: SimulationOptions = SimulationOptions(),
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    output: Folder = None,
    json: Json = False,
) -> None:
    """Drive paths with AMCL in simulated worlds: its error, and how often it is lost (> 1 m)."""
    from locplan import planners
    from locplan._util.files import check_folder
    from locplan._util.progress import progress_bar
    from locplan.costs import Costmap
    from locplan.maps import find_maps, load_map
    from locplan.simulation import (
        _reports as reports,
        _routes as routes,
        simulate as simulate_paths,
    )

    random, start, goal = driven.random, driven.start, driven.goal
    ends = start is not None, goal is not None
    if [bool(driven.path), any(ends), random is not None].count(True) != 1 or any(ends) != all(
        ends
    ):
        raise ConfigError("give one of --path, --start with --goal, and --random")
    config = config_of(options)
    costs.check(config)
    lidar, amcl, disturbances = simulation.simulated(config)
    files = find_maps(*maps)
    if random is None and len(files) > 1:
        raise ConfigError(
            f"one path is of one map: name one of these {len(files)}, or give --random"
        )
    grids = [load_map(file) for file in files]
    if output:
        check_folder(output)

    def drive_at_random(costmap: Costmap, count: int) -> Routes:
        queries = planners.random_queries(
            costmap, count, simulation.seed, least_distance=driven.least_distance
        )
        with progress_bar(f"simulating in {costmap.grid.name}", "drives") as progress:
            return routes.simulate_queries(
                costmap,
                queries,
                lidar=lidar,
                amcl=amcl,
                disturbances=disturbances,
                drives=driven.drives,
                seed=simulation.seed,
                threads=computing.threads,
                progress=progress,
            )

    with computing.of(config) as compute:
        if random is not None:
            every = [drive_at_random(costs.costmap(g, compute(g)), random) for g in grids]
            written = reports.write_routes(output, every) if output else []
            show(json, reports.routes_summary(every), reports.routes_table(every))
            say_written(*written)
            return
        if driven.path:
            paths, costmap = read_paths(driven.path), None
        else:
            assert start is not None
            assert goal is not None
            query = planners.Query("asked", two_numbers("start", start), two_numbers("goal", goal))
            planners.check_ends(costs.blank(grids[0]), query.start, query.goal)
            costmap = costs.costmap(grids[0], compute(grids[0]))
            paths = routes.planned(costmap, query)
    if not paths:
        show(json, {"status": "unreachable"}, "unreachable: no path leads to the goal")
        return
    with progress_bar("simulating", "drives") as progress:
        result = simulate_paths(
            grids[0],
            paths,
            lidar=lidar,
            amcl=amcl,
            disturbances=disturbances,
            drives=driven.drives,
            seed=simulation.seed,
            threads=computing.threads,
            costs=costmap,
            progress=progress,
        )
    written = reports.write_simulation(output, result) if output else []
    show(json, result.summary(), reports.simulation_table(result))
    say_written(*written)
