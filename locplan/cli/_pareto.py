"""The command that finds all best trade-offs."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import locplan
from locplan._util.progress import working
from locplan.cli._field_options import FieldOptions
from locplan.cli._groups import MapFile, command, option_group
from locplan.cli._options import Computing
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import parsed, position

app = command("pareto", "pareto lab.yaml --start 2,3 --goal 38,3 -o front")


@option_group("Options")
class Search:
    """The query, and the limits of the search."""

    start: Annotated[Any, parsed(position, "X,Y")]
    """Start, x,y in metres."""
    goal: Annotated[Any, parsed(position, "X,Y")]
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
    ends, objective, time_limit = (search.start, search.goal), search.objective, search.time_limit
    locplan.planners.check_front_limits(objective, time_limit)
    grid = locplan.load_map(map_file)
    robot, config = options.with_robot(robot_options)
    locplan.planners.check_ends(locplan.Costmap.blank(grid, robot=robot), *ends)
    out.check(locplan.ParetoFront.files)
    field = computing.field(grid, config)
    costs = locplan.Costmap.from_field(grid, field, robot=robot)
    with working("searching the front"):
        front = locplan.pareto_front(costs, *ends, objective=objective, time_limit=time_limit)
    out.finish(front)
    if not out.json:
        print(locplan.field.about_field(field))
