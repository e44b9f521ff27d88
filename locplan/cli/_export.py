"""The command that exports to navigation stacks and to plain files."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from locplan.cli._groups import INPUT, Force, Json, MapFile, Text, command, results
from locplan.cli._kinds import check_has, joint_options, options_of
from locplan.cli._options import Computing, CostOptions, FieldOptions
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load, read_paths, show, two_numbers
from locplan.errors import ConfigError
from locplan.export import ExportJob, formats

app = command(
    "export",
    "export lab.yaml --to nav2-keepout -o mask --planner smac-hybrid",
    "export lab.yaml --to path --start 2,3 --goal 38,3 -o path.csv --step 0.05",
)

FORMATS = formats()
OPTIONS = {name: each.options for name, each in FORMATS.items()}
ABOUT = ", ".join(
    f"{name} ({', '.join((*each.suffixes[:1], each.about))})" for name, each in FORMATS.items()
)
PATHS = [name for name, each in FORMATS.items() if each.paths != "none"]
WITH_PATHS = f"({', '.join(PATHS)})"
FORMAT = Group("Format", sort_key=2)
if TYPE_CHECKING:
    from locplan.costs import Costmap, Path as Route

    FormatOptions = Any
    Ends = tuple[tuple[float, float], tuple[float, float]]
else:
    FormatOptions = joint_options(OPTIONS, FORMAT, but=("params",))  # a file of the robot


@app.default
def export(
    map_file: MapFile,
    /,
    *,
    to: Annotated[
        str,
        Parameter(choices=tuple(FORMATS), show_choices=False, help=f"Format: {ABOUT}."),
    ],
    path: Annotated[
        tuple[Path, ...],
        INPUT,
        Parameter(metavar="CSV", help=f"Path to export (x,y) {WITH_PATHS}."),
    ] = (),
    start: Annotated[
        Text | None,
        Parameter(
            metavar="X,Y",
            help=f"Start of a path that is planned and exported, x,y in metres {WITH_PATHS}.",
        ),
    ] = None,
    goal: Annotated[
        Text | None, Parameter(metavar="X,Y", help="Goal of this path, x,y in metres.")
    ] = None,
    own: FormatOptions = FormatOptions(),
    robot_options: RobotOptions = RobotOptions(),
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    output: Annotated[Path | None, results("File or folder; MAP-FORMAT here by default.")] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write cost maps, route graphs, bags and paths for navigation stacks, or plain files."""
    from locplan._util.progress import working
    from locplan._util.tables import table

    format = FORMATS[to]
    for option, value in (("--path", path), ("--start", start), ("--goal", goal)):
        if value:
            check_has(option, "--to", to, PATHS)
    ends = _ends(start, goal)
    robot, config = options.with_robot(robot_options)
    chosen = options_of(OPTIONS, to, "--to", own, params=robot_options.nav2_file())
    costs.check(config)
    grid = load(map_file)
    target = output or Path(f"{grid.name}-{to}" + "".join(format.suffixes[:1]))
    format.check_target(target, force=force)
    paths = read_paths(path)
    count = len(paths) + bool(ends)
    if format.paths == "one" and count != 1:
        raise ConfigError(f"--to {to} needs one --path CSV, or --start and --goal")
    format.check(chosen, count)
    field = computing.field(grid, config)
    costmap = costs.costmap(grid, field, robot)
    if ends:
        paths["aware"] = _planned(costmap, ends)
    with nullcontext() if format.shows_progress else working(f"writing {target.name}"):
        summary = format.write(target, ExportJob(costmap, field, paths, robot=robot), chosen)
    about = {"map": grid.name, "to": to, "target": str(target), **summary.values}
    rows = [("map", grid.name), ("format", to), ("field", config.estimator.summary), *summary.rows]
    show(json, about, table([], rows), target)


def _ends(start: str | None, goal: str | None) -> Ends | None:
    """The ends of a path that is planned, if they are given."""
    if start is None or goal is None:
        if start != goal:
            raise ConfigError("--start and --goal belong together")
        return None
    return two_numbers("start", start), two_numbers("goal", goal)


def _planned(costs: Costmap, ends: Ends) -> Route:
    """The path between two ends; a ConfigError if there is none."""
    from locplan.planners import plan

    found = plan(costs, *ends)
    if found.path is None:
        raise ConfigError(f"no path leads from --start to --goal: {found.note or found.status}")
    return found.path
