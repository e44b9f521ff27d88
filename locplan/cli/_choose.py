"""The command that drives candidate paths in simulation, and chooses among them."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from locplan.cli._groups import (
    GENERAL,
    INPUT,
    Force,
    Json,
    MapFile,
    Pair,
    Text,
    command,
    option_group,
    results,
)
from locplan.cli._options import Computing, CostOptions, FieldOptions
from locplan.cli._simulation_options import SimulationOptions
from locplan.cli._values import load, read_paths, show, two_numbers
from locplan.errors import ConfigError
from locplan.planners import names

app = command(
    "choose",
    "choose lab.yaml --start 2,3 --goal 38,3 --lidar turtlebot4 -o chosen",
    "choose lab.yaml --start 2,3 --goal 38,3 --params nav2_params.yaml --path mine.csv",
)


@option_group(GENERAL)
class Choosing:
    """The candidates, and what the best of them has least of."""

    start: Annotated[Text, Parameter(metavar="X,Y")]
    """The paths start here [m]."""
    goal: Annotated[Text, Parameter(metavar="X,Y")]
    """The paths end here [m]."""
    path: Annotated[tuple[Path, ...], INPUT, Parameter(metavar="CSV")] = ()
    """This path (x_m,y_m) is a candidate, too; repeatable."""
    planner: Annotated[tuple[str, ...], Parameter(choices=names())] = ()
    """The path of this planner is a candidate, too; repeatable."""
    front: Annotated[bool, Parameter(name="--front")] = False
    """Up to 5 paths of the Pareto front of length against degeneracy are candidates, too."""
    longest: float = 1.5
    """Alternatives are at most this many times as long as the shortest path; 1.5 by default."""
    drives: Pair = 8
    """Each candidate is driven 8 times by default, or fewer where that settles the choice."""
    minimise: Literal["rmse", "lost", "goal-error", "heading"] = "rmse"
    """The best has the least RMSE of the position by default, the fewest lost drives, or the least
    error at the goal or of the heading."""
    price: Annotated[float | None, Parameter(metavar="METRES")] = None
    """So many metres of detour are accepted for half the error; by default length is free."""
    time_limit: float | None = None
    """No further round of drives begins after this time [s]; two are driven anyway."""


@app.default
def choose(
    map_file: MapFile,
    /,
    *,
    choosing: Choosing,
    simulation: SimulationOptions = SimulationOptions(),
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    output: Annotated[
        Path | None,
        results("The paths (CSV), choice.json, choice.png and tables are written to this folder."),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Drive a handful of paths with your own filter in simulation, and take the best.

    The shortest path stays unless another is clearly better. Where no lidar is named, one of 6 m
    is assumed, and the estimator is fused.
    """
    from locplan import planners
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.field import lidar_of
    from locplan.simulation.choice import _choose as core, _reports as reports
    from locplan.simulation.choice._candidates import AnyCandidate, own_paths

    start, goal = two_numbers("start", choosing.start), two_numbers("goal", choosing.goal)
    asked = choosing.minimise, choosing.price, choosing.drives
    core.check_request(choosing.longest, *asked, choosing.time_limit)
    if options.estimator is None and options.config is None:
        options = dataclasses.replace(options, estimator="fused")  # as in Python
    config = options.to_config()
    costs.check(config)
    lidar = options.named_lidar() or lidar_of(config)
    robot, not_simulated = simulation.robot(lidar, config=options.config)
    costs = costs.sized(simulation.params)
    grid = load(map_file)
    blank = costs.blank(grid)
    core.check_way(blank, start, goal)
    paths = read_paths(choosing.path)
    core.lines_along(own_paths(blank, start, goal, paths), grid)
    chosen_planners = dict.fromkeys(choosing.planner)
    for name in chosen_planners:
        planners.planner_for(name, {})
        if name in paths:
            raise ConfigError(f"a --path file has the name of a --planner, {name}; rename it")
    folder = reports.CHOICE.into(output, force=force) if output else None
    with working("looking for a way"):
        costmap, reachable = blank, planners.plan(blank, start, goal).path is not None
    del blank  # saves memory on a large map
    if reachable:
        with computing.of(config) as compute:
            if options.is_fine_near_paths(config):
                costmap = core.costmap_near_candidates(
                    grid,
                    config,
                    (start, goal),
                    choosing.longest,
                    lambda points: compute(grid, points),
                    lambda field: costs.costmap(grid, field),
                    lambda: working("planning the candidates"),
                )
            else:
                costmap = costs.costmap(grid, compute(grid))
    candidates: dict[str, AnyCandidate] = {**paths}
    candidates.update((name, name) for name in chosen_planners)
    if choosing.front and reachable:
        candidates["front"] = planners.pareto_front(costmap, start, goal)
    with progress_bar("driving the candidates", "drives") as progress:
        choice = core.choose(
            grid,
            start,
            goal,
            **robot,
            lidar=lidar,
            seed=simulation.seed,
            costs=costmap,
            candidates=candidates,
            longest=choosing.longest,
            minimise=choosing.minimise,
            price=choosing.price,
            drives=choosing.drives,
            time_limit=choosing.time_limit,
            threads=computing.threads,
            progress=progress,
        )
    if folder:
        with working("writing the choice"):
            reports.write_choice(folder, choice, not_simulated)
    about, table = reports.choice_summary(choice, not_simulated), reports.choice_table
    show(json, about, table(choice, not_simulated), output)
