"""The command that finds all best trade-offs."""

from __future__ import annotations

from typing import Annotated, Literal

from cyclopts import Parameter

from locplan.cli._groups import (
    GENERAL,
    MapFile,
    Text,
    command,
    option_group,
)
from locplan.cli._options import Computing, FieldOptions
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load, position

app = command("pareto", "pareto lab.yaml --start 2,3 --goal 38,3 -o front")


@option_group(GENERAL)
class Search:
    """The query, and the limits of the search."""

    start: Annotated[Text, Parameter(metavar="X,Y")]
    """Start, x,y in metres."""
    goal: Annotated[Text, Parameter(metavar="X,Y")]
    """Goal, x,y in metres."""
    objective: Literal["u", "e"] = "u"
    """Second objective: the degenerate metres (u, by default), or the integral of e."""
    time_limit: float = 30.0
    """Time of the search, in seconds, exact or not; 30 by default."""


@app.default
def pareto(
    map_file: MapFile,
    /,
    *,
    search: Search,
    robot_options: RobotOptions = RobotOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    out: Output = Output(),
) -> None:
    """Find all best trade-offs between length and localizability, and where they bend.

    The knee is the path farthest below the chord between the front's ends, or else the shortest.
    """
    from locplan import planners
    from locplan._util.progress import working
    from locplan.costs import Costmap
    from locplan.field import about_field

    ends = position("start", search.start), position("goal", search.goal)
    planners.check_front_limits(search.objective, search.time_limit)
    grid = load(map_file)
    robot, config = options.with_robot(robot_options)
    planners.check_ends(Costmap.blank(grid, robot_radius=robot.radius), *ends)
    out.check(planners.ParetoFront.files)
    field = computing.field(grid, config)
    with working("searching the front"):
        front = planners.pareto_front(
            Costmap.from_field(grid, field, robot_radius=robot.radius),
            *ends,
            objective=search.objective,
            time_limit=search.time_limit,
        )
    out.finish(front)
    if not out.json:
        print(about_field(field))
