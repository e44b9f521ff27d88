"""The formats of exports with their options, which check themselves before long work."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from locplan._support.checks import check_number
from locplan.errors import ConfigError
from locplan.export.registry import (
    LEAD,
    SLOWEST,
    ExportJob,
    ExportSummary,
    Format,
    InDistro,
    InFrame,
    NoOptions,
    option,
)
from locplan.robots.parameters import read_parameters

NavPlannerName = Literal["smac2d", "smac-hybrid", "navfn", "thetastar"]
"""A planner of Nav2."""


@dataclass(frozen=True, kw_only=True)
class MaskOptions(NoOptions):
    """The planner whose costs a mask makes J."""

    planner: NavPlannerName | None = option(None, flag="nav2-planner")
    """Planner of Nav2 whose costs become J. By default the first in --robot that follows masks,
    otherwise smac2d up to a million cells and thetastar on larger maps."""
    planner_param: float | None = None
    """The planner's cost_travel_multiplier, cost_penalty or w_traversal_cost; by default such
    that weight · u just fits."""

    def __post_init__(self) -> None:
        from locplan.export.masks import find_planner

        super().__post_init__()
        if self.planner:
            find_planner(self.planner, self.planner_param)


@dataclass(frozen=True, kw_only=True)
class Nav2Options(InDistro):
    """The robot's own Nav2."""

    params: tuple[Path, ...] = ()
    """Parameter files of Nav2, into a copy of which ours are merged."""

    def __post_init__(self) -> None:
        super().__post_init__()
        read_parameters(*self.params)


@dataclass(frozen=True, kw_only=True)
class ChargedOptions(MaskOptions, Nav2Options):
    """The options of masks that a planner's costs are made of."""

    tree: Path | None = option(None, metavar="XML")
    """Behaviour tree to copy with the mask's planner."""


@dataclass(frozen=True, kw_only=True)
class SpeedOptions(Nav2Options):
    """The options of a speed mask."""

    slowest: float = option(SLOWEST)
    """Share of the speed that is left where u is 1."""
    speed_lead: float | None = None
    """Distance before a place at which its speed holds already, in metres; 1 s of driving by
    default, for Nav2's limits come as late."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("slowest", self.slowest, 0.01, 1)
        check_number("speed_lead", self.speed_lead or 0.0, 0)


def write_keepout(target: Path, job: ExportJob, options: ChargedOptions) -> ExportSummary:
    """Write a mask for the keepout filter, of a recommendation or of costs and paths."""
    from locplan.export.nav2 import nav2_keepout

    mask = nav2_keepout(
        target, job.recommendation or job.costs, paths=job.paths, force=job.force, **vars(options)
    )
    return mask.facts()


def write_map(target: Path, job: ExportJob, options: NoOptions) -> ExportSummary:
    """Write u in per cent as a map."""
    from locplan.export.values import ros_map

    ros_map(target, job.costs, force=job.force, **vars(options))
    return ExportSummary()


def write_speed(target: Path, job: ExportJob, options: SpeedOptions) -> ExportSummary:
    """Write a mask for the speed filter."""
    from locplan.export.nav2 import nav2_speed

    mask_options = dict(vars(options))
    lead = mask_options.pop("speed_lead")
    if lead is None:  # of 1 s
        lead = job.robot.kinematics.speed if job.robot else LEAD
    min_percent = nav2_speed(target, job.costs, lead=lead, force=job.force, **mask_options)
    row = "in the most degenerate place", f"{min_percent} % of the robot's speed"
    values = {"slowest": options.slowest, "lead": lead, "min_percent": min_percent}
    return ExportSummary(values, (row,))


@dataclass(frozen=True, kw_only=True)
class RoutesOptions(Nav2Options, InFrame):
    """The options of route graphs."""

    graph: Path | None = option(None, metavar="FILE")
    """Route graph (GeoJSON) whose edges get our cost, instead of paths."""
    set_cost: bool = option(False)
    """Write our cost as Nav2's cost of the edges, too."""

    def __post_init__(self) -> None:
        from locplan.export.user_graph import UserGraph

        super().__post_init__()
        if self.graph:
            UserGraph.read(self.graph, self.frame)


def check_routes(options: RoutesOptions, paths: int) -> None:
    """Raise a ConfigError unless there are either paths or a graph to export."""
    if options.set_cost and not options.graph:
        raise ConfigError("--set-cost sets the cost of edges of --graph FILE; give the graph")
    if options.graph and paths:
        raise ConfigError("--graph is exported without paths; leave --path, --start, --choice out")
    if not options.graph and not paths:
        raise ConfigError(
            "--to nav2-routes needs paths: --path CSV or --choice FOLDER; or --graph FILE"
        )


def write_routes(target: Path, job: ExportJob, options: RoutesOptions) -> ExportSummary:
    """Write the paths as a route graph, or our costs into one."""
    from locplan.export.parameters import Nav2Robot
    from locplan.export.recommended_ways import nav2_routes
    from locplan.export.user_graph import nav2_graph

    robot = Nav2Robot.from_files(options.params, options.distro)
    robot.warn(robot.note_larger_radius(job.costs.robot_radius))
    export_options = dict(vars(options)) | {"force": job.force}
    graph, set_cost = export_options.pop("graph"), export_options.pop("set_cost")
    if graph:
        return nav2_graph(target, job.costs, graph, set_cost=set_cost, **export_options)
    return nav2_routes(target, job.costs, job.paths, **export_options).facts()


@dataclass(frozen=True, kw_only=True)
class PathOptions(InFrame):
    """The options of a path."""

    step: float | None = None
    """Maximum distance between poses of the path, in metres. By default they are its corners."""

    def __post_init__(self) -> None:
        if self.step is not None:
            check_number("step", self.step, 0.001)


def write_path(target: Path, job: ExportJob, options: PathOptions) -> ExportSummary:
    """Write the only path of a job."""
    from locplan.export.plain_files import write_path_file

    (route,) = job.paths.values()
    write_path_file(target, route, **vars(options))
    return ExportSummary({"length": route.length}, (("length", f"{route.length:.2f} m"),))


FORMATS = (
    Format(
        *("nav2-keepout", "a mask for Nav2's KeepoutFilter", write_keepout, ChargedOptions),
        paths="several",
    ),
    Format("nav2-speed", "a mask for Nav2's SpeedFilter", write_speed, SpeedOptions),
    Format(
        *(
            "nav2-routes",
            "a graph for Nav2's route server",
            write_routes,
            RoutesOptions,
        ),
        paths="several",
        check=check_routes,
    ),
    Format("ros-map", "u in per cent for the map servers of ROS, or a StaticLayer", write_map),
    Format(
        *("path", "a path; also .json, .geojson or .yaml", write_path, PathOptions),
        suffixes=(".csv", ".json", ".geojson", ".yaml"),
        purpose="the path",
        paths="one",
    ),
)
