"""Export formats, with options that are checked before any long computation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from locplan._support.checks import check_number
from locplan.errors import ConfigError
from locplan.export.registry import (
    DEFAULT_LEAD,
    DEFAULT_SLOWEST,
    DistroOptions,
    ExportFormat,
    ExportJob,
    ExportOptions,
    ExportSummary,
    FrameOptions,
    make_option_field,
)
from locplan.robots.parameters import read_parameters

NavPlannerName = Literal["smac2d", "smac-hybrid", "navfn", "thetastar"]
"""A planner of Nav2."""


@dataclass(frozen=True, kw_only=True)
class MaskOptions(ExportOptions):
    """Options of the Nav2 planner that follows a mask."""

    planner: NavPlannerName | None = make_option_field(None, flag="nav2-planner")
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
class Nav2Options(DistroOptions):
    """Options of the robot's Nav2: its distribution and its parameter files."""

    params: tuple[Path, ...] = ()
    """Nav2 parameter files. The export merges its parameters into a copy."""

    def __post_init__(self) -> None:
        super().__post_init__()
        read_parameters(*self.params)


@dataclass(frozen=True, kw_only=True)
class KeepoutOptions(MaskOptions, Nav2Options):
    """Options of a keepout mask."""

    tree: Path | None = make_option_field(None, metavar="XML")
    """Behaviour tree to copy with the mask's planner."""


@dataclass(frozen=True, kw_only=True)
class SpeedOptions(Nav2Options):
    """Options of a speed mask."""

    slowest: float = make_option_field(DEFAULT_SLOWEST)
    """Share of the speed that is left where u is 1."""
    speed_lead: float | None = None
    """Distance before a place at which its speed holds already, in metres; 1 s of driving by
    default, for Nav2's limits come as late."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("slowest", self.slowest, 0.01, 1)
        check_number("speed_lead", self.speed_lead or 0.0, 0)


def write_keepout(target: Path, job: ExportJob, options: KeepoutOptions) -> ExportSummary:
    """Write a mask for the keepout filter, from a recommendation or from costs and paths."""
    from locplan.export.nav2 import nav2_keepout

    mask = nav2_keepout(
        target,
        job.recommendation or job.costs,
        planner=options.planner,
        planner_param=options.planner_param,
        distro=options.distro,
        params=options.params,
        tree=options.tree,
        paths=job.paths,
        force=job.force,
    )
    return mask.summarize()


def write_map(target: Path, job: ExportJob, options: ExportOptions) -> ExportSummary:
    """Write the degeneracy u in per cent as a map."""
    from locplan.export.values import ros_map

    ros_map(target, job.costs, force=job.force)
    return ExportSummary()


def write_speed(target: Path, job: ExportJob, options: SpeedOptions) -> ExportSummary:
    """Write a mask for the speed filter."""
    from locplan.export.nav2 import nav2_speed

    lead = options.speed_lead
    if lead is None:  # the distance that the robot drives in 1 s
        lead = job.robot.kinematics.speed if job.robot else DEFAULT_LEAD
    min_percent = nav2_speed(
        target,
        job.costs,
        slowest=options.slowest,
        lead=lead,
        distro=options.distro,
        params=options.params,
        force=job.force,
    )
    row = "in the most degenerate place", f"{min_percent} % of the robot's speed"
    values = {"slowest": options.slowest, "lead": lead, "min_percent": min_percent}
    return ExportSummary(values, (row,))


@dataclass(frozen=True, kw_only=True)
class RoutesOptions(Nav2Options, FrameOptions):
    """Options of a route graph."""

    graph: Path | None = make_option_field(None, metavar="FILE")
    """Route graph (GeoJSON) whose edges get our cost, instead of paths."""
    set_cost: bool = make_option_field(False)
    """Also write our cost as Nav2's edge cost."""

    def __post_init__(self) -> None:
        from locplan.export.user_graph import UserGraph

        super().__post_init__()
        if self.graph:
            UserGraph.read(self.graph, self.frame)


def check_routes(options: RoutesOptions, n_paths: int) -> None:
    """Raise a ConfigError unless there are either paths or a graph to export."""
    if options.set_cost and not options.graph:
        raise ConfigError("--set-cost needs a route graph; add --graph FILE")
    if options.graph and n_paths:
        raise ConfigError("--graph takes no paths; remove --path, --start and --choice")
    if not options.graph and not n_paths:
        raise ConfigError(
            "--to nav2-routes needs paths; add --path CSV, --choice FOLDER or --graph FILE"
        )


def write_routes(target: Path, job: ExportJob, options: RoutesOptions) -> ExportSummary:
    """Write the paths as a route graph, or J into the user's route graph."""
    from locplan.export.parameters import Nav2Robot
    from locplan.export.recommended_routes import nav2_routes
    from locplan.export.user_graph import nav2_graph

    robot = Nav2Robot.from_files(options.params, options.distro)
    robot.warn(robot.note_larger_radius(job.costs.robot_radius))
    if options.graph:
        return nav2_graph(
            target,
            job.costs,
            options.graph,
            frame=options.frame,
            distro=options.distro,
            params=options.params,
            set_cost=options.set_cost,
            force=job.force,
        )
    routes = nav2_routes(
        target,
        job.costs,
        job.paths,
        frame=options.frame,
        distro=options.distro,
        params=options.params,
        force=job.force,
    )
    return routes.summarize()


@dataclass(frozen=True, kw_only=True)
class PathOptions(FrameOptions):
    """Options of a path file."""

    step: float | None = None
    """Maximum distance between poses of the path, in metres. By default they are its corners."""

    def __post_init__(self) -> None:
        if self.step is not None:
            check_number("step", self.step, 0.001)


def write_path(target: Path, job: ExportJob, options: PathOptions) -> ExportSummary:
    """Write the job's path, of which there is exactly one."""
    from locplan.export.plain_files import write_path_file
    from locplan.export.planned_paths import check_paths
    from locplan.export.values import drop_path_yaw, drop_yaw

    check_paths(job.costs, job.paths)
    (route,) = job.paths.values()
    grid = job.costs.grid
    if target.suffix.lower() == ".yaml" and drop_yaw(grid) is not grid:  # Nav2's message
        route = drop_path_yaw(grid, route)
    write_path_file(target, route, frame=options.frame, step=options.step)
    return ExportSummary({"length": route.length}, (("length", f"{route.length:.2f} m"),))


FORMATS = (
    ExportFormat(
        "nav2-keepout",
        "a mask for Nav2's KeepoutFilter",
        write_keepout,
        KeepoutOptions,
        paths="several",
    ),
    ExportFormat("nav2-speed", "a mask for Nav2's SpeedFilter", write_speed, SpeedOptions),
    ExportFormat(
        "nav2-routes",
        "a graph for Nav2's route server",
        write_routes,
        RoutesOptions,
        paths="several",
        check=check_routes,
    ),
    ExportFormat(
        "ros-map", "u in per cent for the map servers of ROS, or a StaticLayer", write_map
    ),
    ExportFormat(
        "path",
        "a path; also .json, .geojson or .yaml",
        write_path,
        PathOptions,
        suffixes=(".csv", ".json", ".geojson", ".yaml"),
        purpose="the path",
        paths="one",
    ),
)
