"""The commands that plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from locplan.cli.options import (
    STYLE,
    AsJson,
    CacheDir,
    MapFile,
    Preset,
    Range,
    Scheduler,
    Stride,
    Template,
    Threads,
    computing,
    config_of,
    load,
    position,
    say_written,
    to_json,
)

app = typer.Typer(**STYLE)


@app.command()
def plan(
    map_file: MapFile,
    start: Annotated[str, typer.Option(metavar="X,Y", help="Start [m].")],
    goal: Annotated[str, typer.Option(metavar="X,Y", help="Goal [m].")],
    weight: Annotated[
        float, typer.Option(help="Metres of detour accepted per metre of blind travel.")
    ] = 4.0,
    robot_radius: Annotated[float, typer.Option(help="Robot's radius [m].")] = 0.25,
    planner: Annotated[str, typer.Option(help="Which planner.")] = "grid",
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for the paths (CSV), plan.json and plan.png."),
    ] = None,
    preset: Preset = "default",
    sensor_range: Range = 6.0,
    template: Template = "disc",
    stride: Stride = 0.2,
    threads: Threads = None,
    scheduler: Scheduler = None,
    cache_dir: CacheDir = None,
    as_json: AsJson = False,
) -> None:
    """Plan a path that the robot can localize on, beside the shortest one."""
    from locplan import planners, reporting
    from locplan.costmap import Costmap, check_weight
    from locplan.files import make_folder

    ends = position("start", start), position("goal", goal)
    grid = load(map_file)
    config = config_of(preset, sensor_range, template, stride)
    planners.check_planner(planner)
    planners.check_ends(Costmap.blank(grid, robot_radius=robot_radius), *ends)
    check_weight(weight)
    if output:
        make_folder(output)
    with computing(config, threads, scheduler, cache_dir) as compute:
        computed = compute(grid)
    costs = Costmap.from_field(grid, computed, weight=weight, robot_radius=robot_radius)
    # Of the many shortest paths on a grid, the one that sees most: the comparison is fair.
    shortest = planners.plan(costs.with_weight(1e-6), *ends, planner=planner)
    plans = {
        "shortest": shortest.measured_on(costs),
        "localizability-aware": planners.plan(costs, *ends, planner=planner),
    }
    if output:
        reporting.write_plans(output, costs, computed, plans)
    print(
        to_json(reporting.plans_summary(plans))
        if as_json
        else reporting.plans_table(plans, computed.e_unit)
    )
    say_written(output)
