"""The command that exports to navigation stacks and to plain files."""

from __future__ import annotations

import dataclasses
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

import locplan
from locplan._util.progress import working
from locplan.cli._field_options import FieldOptions
from locplan.cli._groups import XY, Csv, MapFile, command, heading, option_group
from locplan.cli._options import Computing, CostOptions
from locplan.cli._output import Output, Target
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import check_has, joint_options, options_of, read_paths
from locplan.errors import ConfigError
from locplan.export import formats

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
if TYPE_CHECKING:
    FormatOptions = Any
else:  # parameters are a file of the robot
    FormatOptions = joint_options(OPTIONS, heading("Format"), but=("params",))


@option_group("Options")
class Exported:
    """What is exported."""

    to: Annotated[
        str, Parameter(choices=tuple(FORMATS), show_choices=False, help=f"Format: {ABOUT}.")
    ]
    path: Annotated[Csv, Parameter(help=f"Path to export (x,y) ({', '.join(PATHS)}).")] = ()
    start: Annotated[
        XY,
        Parameter(
            help="Start of a path that is planned and exported, x,y in metres"
            f" ({', '.join(PATHS)})."
        ),
    ] = None
    goal: XY = None
    """Goal of this path, x,y in metres."""

    def check(self) -> None:
        """Raise a ConfigError if the format has no paths, or half a query was given."""
        for name in ("path", "start", "goal"):
            if getattr(self, name):
                check_has(name, "--to", self.to, PATHS)
        if bool(self.start) != bool(self.goal):
            raise ConfigError("--start and --goal belong together")


@option_group("Output")
class ExportOutput(Output):
    """Where the export goes."""

    output: Annotated[Path | None, Target] = None
    """File or folder; MAP-FORMAT here by default."""


@app.default
def export(
    map_file: MapFile,
    /,
    *,
    exported: Exported,
    own: FormatOptions = FormatOptions(),
    robot_options: RobotOptions = RobotOptions(),
    costs: CostOptions = CostOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
    out: ExportOutput = ExportOutput(),
) -> None:
    """Write cost maps, route graphs, bags and paths for navigation stacks, or plain files."""
    from locplan._util.tables import table

    exported.check()
    to, start, goal = exported.to, exported.start, exported.goal
    format = FORMATS[to]
    robot, config = options.with_robot(robot_options)
    chosen = options_of(OPTIONS, to, "--to", own, params=robot_options.nav2_file())
    costs.check(config)
    grid = locplan.load_map(map_file)
    target = out.output or Path(f"{grid.name}-{to}" + "".join(format.suffixes[:1]))
    format.check_target(target, force=out.force)
    paths = read_paths(exported.path)
    count = len(paths) + bool(start)
    if format.paths == "one" and count != 1:
        raise ConfigError(f"--to {to} needs one --path CSV, or --start and --goal")
    format.check(chosen, count)
    field = computing.field(grid, config)
    costmap = costs.costmap(grid, field, robot)
    if start and goal:
        paths["aware"] = _planned(costmap, start, goal)
    job = locplan.export.ExportJob(costmap, field, paths, robot=robot)
    with nullcontext() if format.shows_progress else working(f"writing {target.name}"):
        summary = format.write(target, job, chosen)
    about = {"map": grid.name, "to": to, "target": str(target), **summary.values}
    rows = [("map", grid.name), ("format", to), ("field", config.estimator.summary), *summary.rows]
    dataclasses.replace(out, output=target).show(about, table([], rows), target)


def _planned(costs: locplan.Costmap, *ends: tuple[float, float]) -> locplan.Path:
    """The path between two ends; a ConfigError if there is none."""
    found = locplan.plan(costs, *ends)
    if found.path is None:
        why = found.note or found.status
        raise ConfigError(f"no path leads from --start to --goal: {why}")
    return found.path
