"""The command that drives candidate paths in simulation, and chooses among them."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from locplan.cli._groups import (
    GENERAL,
    INPUT,
    DriveSeed,
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
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load, read_paths, show, two_numbers
from locplan.errors import ConfigError
from locplan.planners import names

app = command(
    "choose",
    "choose lab.yaml --start 2,3 --goal 38,3 --lidar turtlebot4 -o chosen",
    "choose lab.yaml --start 2,3 --goal 38,3 --robot nav2_params.yaml --path mine.csv",
)


@option_group(GENERAL)
class Choosing:
    """The candidates, and what counts among them."""

    start: Annotated[Text, Parameter(metavar="X,Y")]
    """Start of the paths, x,y in metres."""
    goal: Annotated[Text, Parameter(metavar="X,Y")]
    """Goal of the paths, x,y in metres."""
    path: Annotated[tuple[Path, ...], INPUT, Parameter(metavar="CSV")] = ()
    """Further candidate (x_m,y_m); repeatable."""
    planner: Annotated[tuple[str, ...], Parameter(choices=names())] = ()
    """Planner whose path is a candidate, too; repeatable."""
    front: Annotated[bool, Parameter(name="--front")] = False
    """Drive up to 5 paths of the Pareto front of length against degeneracy, too."""
    longest: float = 1.5
    """Greatest length of alternatives, in lengths of the shortest path; 1.5 by default."""
    drives: Pair = 8
    """Number of drives of each candidate, or fewer where that settles the choice; 8 by default."""
    minimise: Literal["rmse", "lost", "goal-error", "heading"] = "rmse"
    """What the best has least of: RMSE of the position (by default), lost drives, or the error at
    the goal or of the heading."""
    price: Annotated[float | None, Parameter(metavar="METRES")] = None
    """Detour accepted for half the error, in metres; by default length is free."""
    time_limit: float | None = None
    """Time after which no further round of drives begins, in seconds; two are driven anyway."""


@app.default
def choose(
    map_file: MapFile,
    /,
    *,
    choosing: Choosing,
    robot_options: RobotOptions = RobotOptions(),
    seed: DriveSeed = 1,
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    output: Annotated[
        Path | None,
        results("Folder for the paths (CSV), choice.json, choice.png and tables."),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Drive a handful of paths with your own filter in simulation, and take the best.

    The shortest path stays unless another is clearly better. Where no lidar is known, one of 6 m
    is assumed, and the estimator is fused.
    """
    from locplan import planners
    from locplan._util.progress import progress_bar
    from locplan._util.working import working
    from locplan.costs import Costmap
    from locplan.simulation import (
        Choice,
        check_candidates,
        check_choice,
        choose as drive,
        costmap_near_candidates,
    )

    start, goal = two_numbers("start", choosing.start), two_numbers("goal", choosing.goal)
    asked = choosing.minimise, choosing.price, choosing.drives
    check_choice(choosing.longest, *asked, choosing.time_limit)
    if options.estimator is None and options.config is None:
        options = dataclasses.replace(options, estimator="fused")  # as in Python
    robot, config = options.simulated(robot_options)
    costs.check(config)
    grid = load(map_file)
    blank = Costmap.blank(grid, robot_radius=robot.radius)
    paths = read_paths(choosing.path)
    check_candidates(blank, start, goal, paths)
    chosen_planners = dict.fromkeys(choosing.planner)
    for name in chosen_planners:
        planners.planner_for(name, {})
        if name in paths:
            raise ConfigError(f"a --path file has the name of a --planner, {name}; rename it")
    if output:
        Choice.files.into(output, force=force)
    with working("looking for a way"):
        costmap, reachable = blank, planners.plan(blank, start, goal).path is not None
    del blank  # saves memory on a large map
    if reachable:
        with computing.of(config) as compute:
            if options.is_fine_near_paths(config):
                costmap = costmap_near_candidates(
                    grid,
                    config,
                    (start, goal),
                    choosing.longest,
                    lambda points: compute(grid, points),
                    lambda field: costs.costmap(grid, field, robot),
                    lambda: working("planning the candidates"),
                )
            else:
                costmap = costs.costmap(grid, compute(grid), robot)
    candidates: dict[str, Any] = {**paths}
    candidates.update((name, name) for name in chosen_planners)
    if choosing.front and reachable:
        candidates["front"] = planners.pareto_front(costmap, start, goal)
    with progress_bar("driving the candidates", "drives") as progress:
        choice = drive(
            grid,
            start,
            goal,
            robot,
            seed=seed,
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
    if output:
        with working("writing the choice"):
            choice.save(output, force=force)
    show(json, choice.summary(), choice.report(), output)
