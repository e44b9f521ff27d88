"""The commands that plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from locplan.cli._options import (
    STYLE,
    AsJson,
    CacheDir,
    ConfigFile,
    Estimator,
    FieldOfView,
    Headings,
    MapFile,
    Preset,
    Range,
    Scheduler,
    SensorName,
    Stride,
    Template,
    Threads,
    computing,
    config_of,
    load,
    outline_of,
    position,
    say_written,
    settings_of,
    to_json,
)

app = typer.Typer(**STYLE)

Start = Annotated[str, typer.Option(metavar="X,Y[,DEG]", help="Start [m], and heading.")]
Goal = Annotated[str, typer.Option(metavar="X,Y[,DEG]", help="Goal [m], and heading.")]
PLANNERS = (
    "any-angle (default) | grid | OMPL's RRTstar | InformedRRTstar | SORRTstar | BITstar | FMT |"
    " BFMT | PRM | PRMstar | RRT | RRTConnect | KPIECE1 | BKPIECE1 | LBKPIECE1"
)


@app.command()
def plan(
    map_file: MapFile,
    start: Start,
    goal: Goal,
    via: Annotated[
        list[str] | None,
        typer.Option(metavar="X,Y[,DEG]", help="Visit this on the way."),
    ] = None,
    weight: Annotated[
        float, typer.Option(help="Metres of detour accepted per degenerate metre.")
    ] = 4.0,
    criterion: Annotated[
        str,
        typer.Option(
            help="Of u: e | position_std | position_rms | heading_std | ambiguity | entropy."
        ),
    ] = "e",
    max_e: Annotated[
        float | None, typer.Option(help="Enter no cell with e above this [m² rad].")
    ] = None,
    budget: Annotated[
        float | None, typer.Option(help="The shortest path with ∫u ds of at most this [m].")
    ] = None,
    robot_radius: Annotated[
        float | None, typer.Option(help="Robot's radius [m]; 0.25, or the footprint's inner one.")
    ] = None,
    footprint: Annotated[
        str | None, typer.Option(metavar="[[X,Y],...]", help="Robot's outline [m], x forward.")
    ] = None,
    planner: Annotated[str | None, typer.Option(help=PLANNERS)] = None,
    accuracy: Annotated[str, typer.Option(help="Of any-angle: normal | high.")] = "normal",
    space: Annotated[str, typer.Option(help="Of OMPL's: R2 | SE2 | Dubins | ReedsShepp.")] = "R2",
    turning_radius: Annotated[
        float | None, typer.Option(help="Of Dubins and ReedsShepp [m].")
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option(help="Of OMPL's, for each path [s]; 5 by default.")
    ] = None,
    iterations: Annotated[
        int | None, typer.Option(help="Of OMPL's: with a seed, the same path again.")
    ] = None,
    convergence: Annotated[
        float | None, typer.Option(help="Of OMPL's: stop once J hardly falls, such as 0.001.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of OMPL's random numbers.")] = 1,
    from_grid: Annotated[
        bool, typer.Option("--from-grid", help="Of OMPL's: begin with the grid planner's path.")
    ] = False,
    improve: Annotated[
        bool, typer.Option("--improve", help="Of OMPL's: straighten the path at last.")
    ] = False,
    setting: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="OMPL's own, such as range=2.0; repeatable."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for the paths (CSV), plan.json and plan.png."),
    ] = None,
    config_file: ConfigFile = None,
    preset: Preset = "default",
    sensor_range: Range = None,
    estimator: Estimator = "sad",
    sensor: SensorName = None,
    field_of_view: FieldOfView = None,
    headings: Headings = 0,
    template: Template = "disc",
    stride: Stride = 0.2,
    threads: Threads = None,
    scheduler: Scheduler = None,
    cache_dir: CacheDir = None,
    as_json: AsJson = False,
) -> None:
    """Plan a path that the robot can localize on, beside the shortest one."""
    from locplan import planners
    from locplan._util.files import check_folder
    from locplan._util.progress import in_turn, progress_bar
    from locplan.costs import Costmap
    from locplan.costs._costmap import check_weight
    from locplan.costs._degeneracy import check_criterion
    from locplan.export import _results as reporting
    from locplan.planners.ompl._kinds import KINDS

    ends = position("start", start), position("goal", goal)
    stops = [position("via", xy) for xy in via or ()]
    outline = outline_of(footprint)
    if robot_radius is None:
        robot_radius = outline.inscribed_radius if outline else 0.25
    planner = planner or ("grid" if budget is not None else "any-angle")
    given: dict[str, tuple[Any, Any]] = {
        "accuracy": (accuracy, "normal"),
        "space": (space, "R2"),
        "turning_radius": (turning_radius, None),
        "time_limit": (time_limit, None),
        "iterations": (iterations, None),
        "convergence": (convergence, None),
        "seed": (seed, 1),
        "from_grid": (from_grid, False),
        "improve": (improve, False),
        "settings": (settings_of(setting or ()), {}),
    }
    options = {name: value for name, (value, usual) in given.items() if value != usual}
    grid = load(map_file)
    config = config_of(
        preset,
        sensor_range,
        template,
        stride,
        estimator,
        sensor,
        field_of_view,
        headings,
        config_file,
    )
    limits: dict[str, Any] = {"via": stops, "footprint": outline, "max_e": max_e, "budget": budget}
    planners.planner_for(planner, options, **limits)
    planners.check_ends(Costmap.blank(grid, robot_radius=robot_radius), *ends, stops, space=space)
    check_weight(weight)
    check_criterion(criterion, config)
    if output:
        check_folder(output)
    with computing(config, threads, scheduler, cache_dir) as compute:
        computed = compute(grid)
    costs = Costmap.from_field(
        grid, computed, weight=weight, robot_radius=robot_radius, criterion=criterion
    )
    with progress_bar(
        planner, "iterations" if iterations and time_limit is None else ""
    ) as progress:
        if planner in KINDS:
            options["progress"] = in_turn(progress, 2 * (len(stops) + 1))
        plans = planners.plan_beside_shortest(costs, *ends, planner=planner, **(limits | options))
    if output:
        reporting.write_plans(output, costs, computed, plans)
    print(
        to_json(reporting.plans_summary(plans))
        if as_json
        else reporting.plans_table(plans, computed.e_unit)
    )
    say_written(output)


@app.command()
def pareto(
    map_file: MapFile,
    start: Annotated[str, typer.Option(metavar="X,Y", help="Start [m].")],
    goal: Annotated[str, typer.Option(metavar="X,Y", help="Goal [m].")],
    objective: Annotated[str, typer.Option(help="u (degenerate metres) | e (its integral).")] = "u",
    time_limit: Annotated[float, typer.Option(help="For the exact search [s].")] = 30.0,
    max_labels: Annotated[
        int, typer.Option(help="Partial paths kept, 40 bytes each.")
    ] = 20_000_000,
    robot_radius: Annotated[float, typer.Option(help="Robot's radius [m].")] = 0.25,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for front.png, front.csv, .json, knee.csv."),
    ] = None,
    config_file: ConfigFile = None,
    preset: Preset = "default",
    sensor_range: Range = None,
    estimator: Estimator = "sad",
    sensor: SensorName = None,
    field_of_view: FieldOfView = None,
    headings: Headings = 0,
    template: Template = "disc",
    stride: Stride = 0.2,
    threads: Threads = None,
    scheduler: Scheduler = None,
    cache_dir: CacheDir = None,
    as_json: AsJson = False,
) -> None:
    """All best trade-offs between length and localizability, and where they bend."""
    from locplan import planners
    from locplan._util.files import check_folder
    from locplan.costs import Costmap
    from locplan.export import _results as reporting
    from locplan.planners import pareto_front
    from locplan.planners._trade_offs import check_caps

    ends = position("start", start), position("goal", goal)
    check_caps(objective, time_limit, max_labels)
    grid = load(map_file)
    config = config_of(
        preset,
        sensor_range,
        template,
        stride,
        estimator,
        sensor,
        field_of_view,
        headings,
        config_file,
    )
    planners.check_ends(Costmap.blank(grid, robot_radius=robot_radius), *ends)
    if output:
        check_folder(output)
    with computing(config, threads, scheduler, cache_dir) as compute:
        computed = compute(grid)
    costs = Costmap.from_field(grid, computed, robot_radius=robot_radius)
    front = pareto_front(
        costs, *ends, objective=objective, time_limit=time_limit, max_labels=max_labels
    )
    if output:
        reporting.write_front(output, front, computed)
    print(
        to_json(reporting.front_summary(front))
        if as_json
        else reporting.front_table(front, computed.e_unit)
    )
    say_written(output)
