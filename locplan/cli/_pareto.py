"""The command that finds all best trade-offs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from locplan.cli._groups import (
    GENERAL,
    Force,
    Json,
    MapFile,
    Text,
    command,
    option_group,
    results,
)
from locplan.cli._options import Computing, CostOptions, FieldOptions, RobotRadius
from locplan.cli._values import load, position, show

app = command("pareto", "pareto lab.yaml --start 2,3 --goal 38,3 -o front")


@option_group(GENERAL)
class Search:
    """The query, and the limits of the search."""

    start: Annotated[Text, Parameter(metavar="X,Y")]
    """The start [m]."""
    goal: Annotated[Text, Parameter(metavar="X,Y")]
    """The goal [m]."""
    objective: Literal["u", "e"] = "u"
    """The second objective is the degenerate metres (u), or the integral of e."""
    time_limit: float = 30.0
    """The search ends after this time [s], exact or not; 30 by default."""
    max_labels: int = 20_000_000
    """The number of partial paths kept, of 48 bytes each, is 20 million by default."""


@app.default
def pareto(
    map_file: MapFile,
    /,
    *,
    search: Search,
    robot_radius: RobotRadius = None,
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    output: Annotated[
        Path | None,
        results("The files front.png, front.csv, front.json and knee.csv go to this folder."),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find all best trade-offs between length and localizability, and where they bend.

    The knee is the path farthest below the chord between the front's ends, or else the shortest.
    """
    from locplan import planners
    from locplan._util.working import working
    from locplan.export._plan_folders import FRONT, write_front
    from locplan.field._summary import about_field
    from locplan.planners._summary import front_summary, front_table
    from locplan.planners._trade_offs import check_caps

    ends = position("start", search.start), position("goal", search.goal)
    costs = CostOptions(robot_radius=robot_radius)
    check_caps(search.objective, search.time_limit, search.max_labels)
    grid = load(map_file)
    config = options.to_config()
    planners.check_ends(costs.blank(grid), *ends)
    folder = FRONT.into(output, force=force) if output else None
    field = computing.field(grid, config)
    with working("searching the front"):
        front = planners.pareto_front(
            costs.costmap(grid, field),
            *ends,
            objective=search.objective,
            time_limit=search.time_limit,
            max_labels=search.max_labels,
        )
    if folder:
        with working("writing the front"):
            write_front(folder, front, field)
    table = f"{front_table(front, field.e_unit)}\n{about_field(field)}"
    show(json, front_summary(front), table, output)
