"""The formats of exports with their options, which check themselves before long work."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from locplan._util.checks import number, positive, whole
from locplan._util.public import called
from locplan.errors import ConfigError
from locplan.export._registry import (
    ExportJob,
    ExportSummary,
    Format,
    InDistro,
    InFrame,
    NoOptions,
)
from locplan.robots import read_parameters

NavPlannerName = Literal["smac2d", "smac-hybrid", "navfn", "thetastar"]
"""A planner of Nav2."""


@dataclass(frozen=True, kw_only=True)
class MaskOptions(NoOptions):
    """The planner whose costs a mask makes J."""

    planner: NavPlannerName | None = None
    """Planner of Nav2 whose costs become J; by default the first in --robot that follows masks,
    otherwise smac2d up to a million cells and thetastar on larger maps."""
    planner_param: float | None = None
    """The planner's cost_travel_multiplier, cost_penalty or w_traversal_cost; by default such
    that weight · u just fits."""

    def __post_init__(self) -> None:
        from locplan.export._charges import checked_planner

        super().__post_init__()
        if self.planner:
            checked_planner(self.planner, self.planner_param)


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

    tree: Path | None = None
    """Behaviour tree of the robot (XML), a copy of which plans with the mask's planner."""


@dataclass(frozen=True, kw_only=True)
class SpeedOptions(Nav2Options):
    """The options of a speed mask."""

    slowest: float = 0.3
    """Share of the speed that is left where u is 1; 0.3 by default."""
    speed_lead: float | None = None
    """Distance before a place at which its speed holds already, in metres; 1 s of driving by
    default, for Nav2's limits come as late."""

    def __post_init__(self) -> None:
        super().__post_init__()
        number("slowest", self.slowest, 0.01, 1)
        number("speed_lead", self.speed_lead or 0.0, 0)


def by(
    function: str, given: str = "costs", *, paths: bool = False
) -> Callable[[Path, ExportJob, NoOptions], ExportSummary]:
    """The writer of a format by a public function of a target, parts of the job, and options."""

    def write(target: Path, job: ExportJob, options: NoOptions) -> ExportSummary:
        home = f"locplan.export.{function}"
        own = vars(options) | ({"paths": job.paths} if paths else {})
        found = called(home, target, (job.choice if paths else None) or getattr(job, given), **own)
        return ExportSummary() if found is None else ExportSummary(found.summary(), found.rows())

    return write


def write_speed(target: Path, job: ExportJob, options: SpeedOptions) -> ExportSummary:
    """Write a mask for the speed filter."""
    from locplan.export._nav2 import nav2_speed

    own = dict(vars(options))
    lead = own.pop("speed_lead")
    if lead is None:  # of 1 s
        lead = job.robot.kinematics.speed if job.robot else 0.5
    least = nav2_speed(target, job.costs, lead=lead, **own)
    row = "in the most degenerate place", f"{least} % of the robot's speed"
    values = {"slowest": options.slowest, "lead": lead, "min_percent": least}
    return ExportSummary(values, (row,))


@dataclass(frozen=True, kw_only=True)
class LaneOptions(NoOptions):
    """How close the lanes of a graph are."""

    spacing: float = 2.0
    """Distance of nodes of the graph that are joined, in metres; 2 by default. Free space sees one
    within two of these."""

    def __post_init__(self) -> None:
        super().__post_init__()
        number("spacing", self.spacing, 0.1)


@dataclass(frozen=True, kw_only=True)
class GraphOptions(Nav2Options, InFrame, LaneOptions):
    """The options of a route graph."""


def write_graph(target: Path, job: ExportJob, options: GraphOptions) -> ExportSummary:
    """Write lanes, with the scorers that make the server's costs J."""
    from locplan._util.progress import progress_bar
    from locplan.export._graph_files import route_graph

    showing = progress_bar(f"writing {target.name}", "")
    with nullcontext(job.progress) if job.progress else showing as progress:
        graph = route_graph(target, job.costs, **vars(options), progress=progress)
    return ExportSummary(graph.summary(), graph.rows())


@dataclass(frozen=True, kw_only=True)
class LifOptions(LaneOptions):
    """The options of a layout."""

    stations: Path | None = None
    """CSV file of stations (name,x,y), each of which gets a node."""
    vehicle: str = "locplan.robot"
    """Type of vehicle, locplan.robot by default; fleet managers know it as
    MANUFACTURER.SERIES."""
    speed: float | None = None
    """Speed by which J is divided for the travel times of edges, in m/s, which get such a maxSpeed;
    by default they have none."""

    def __post_init__(self) -> None:
        from locplan.planners import read_stations

        super().__post_init__()
        if not self.vehicle:
            raise ConfigError("vehicle must be a name, such as MANUFACTURER.SERIES")
        if self.speed is not None:
            positive("speed", self.speed, "metres a second")
        if self.stations is not None:
            read_stations(self.stations)


def write_lif(target: Path, job: ExportJob, options: LifOptions) -> ExportSummary:
    """Write lanes and stations as a layout."""
    from locplan.export._graph_files import lif
    from locplan.planners import read_stations

    stations = read_stations(options.stations) if options.stations else []
    graph = lif(target, job.costs, **(vars(options) | {"stations": stations}))
    size, unjoined = graph.rows()
    rows = size, ("stations", f"{len(stations):,}"), unjoined
    return ExportSummary({**graph.summary(), "stations": len(stations)}, rows)


@dataclass(frozen=True, kw_only=True)
class RoutesOptions(Nav2Options, InFrame):
    """The options of recommended routes."""

    queries: Path | None = None
    """File of queries whose paths are chosen by driving in simulation: CSV of
    name,start_x,start_y,goal_x,goal_y in metres, or of name,x,y of stations, each two of which are
    one."""
    drives: int = 8
    """Number of drives of each candidate, or fewer where that settles the choice; 8 by default."""

    def __post_init__(self) -> None:
        from locplan.planners import read_queries

        super().__post_init__()
        whole("drives", self.drives, 2)
        if self.queries is not None:
            read_queries(self.queries)


def check_routes(options: RoutesOptions, paths: int) -> None:
    """Raise a ConfigError where there is nothing to export."""
    if options.queries is None and not paths:
        raise ConfigError("--to nav2-routes needs --queries FILE, or paths by --path CSV")


def write_routes(target: Path, job: ExportJob, options: RoutesOptions) -> ExportSummary:
    """Choose the paths of queries by driving, and write them with the paths that are given."""
    from locplan._util.progress import working
    from locplan.export._parameters import Robot
    from locplan.export._recommended import check_ways, chosen_ways, nav2_routes

    robot = Robot.of(options.params, options.distro)
    robot.warn(robot.of_radius(job.costs.robot_radius))
    check_ways(job.costs, job.paths)
    paths, summary = dict(job.paths), ExportSummary()
    if options.queries is not None:
        chosen, summary = chosen_ways(job, options.queries, options.drives)
        paths |= chosen
    own = {name: getattr(options, name) for name in ("frame", "distro", "params")}
    with working(f"writing {target.name}"):
        ways = nav2_routes(target, job.costs, paths, **own)
    rows = *summary.rows, *ways.rows()
    return ExportSummary({**summary.values, **ways.summary()}, rows)


@dataclass(frozen=True, kw_only=True)
class BagOptions(MaskOptions, InFrame):
    """The options of a bag."""

    spacing: float = 2.0
    """Minimum distance between ellipses, in metres; 2 by default."""

    def __post_init__(self) -> None:
        super().__post_init__()
        number("spacing", self.spacing, 0.1)


def write_bag(target: Path, job: ExportJob, options: BagOptions) -> ExportSummary:
    """Write the map, a mask, the field and the paths as messages."""
    from locplan.export._bags import bag
    from locplan.export._charges import keepout_mask

    own = dict(vars(options))
    planner, param = own.pop("planner") or "smac2d", own.pop("planner_param")
    mask, conversion = keepout_mask(job.costs, planner=planner, planner_param=param)
    bag(target, job.costs.grid, mask=mask, field=job.field, paths=job.paths, **own)
    return ExportSummary({"paths": list(job.paths)} | conversion.summary(), conversion.rows())


@dataclass(frozen=True, kw_only=True)
class PathOptions(InFrame):
    """The options of a path."""

    step: float | None = None
    """Maximum distance between poses of the path, in metres; by default they are its corners."""

    def __post_init__(self) -> None:
        if self.step is not None:
            number("step", self.step, 0.001)


def write_path(target: Path, job: ExportJob, options: PathOptions) -> ExportSummary:
    """Write the only path of a job."""
    from locplan.export._plain_files import path

    (route,) = job.paths.values()
    path(target, route, **vars(options))
    return ExportSummary({"length": route.length}, (("length", f"{route.length:.2f} m"),))


def write_layer(target: Path, job: ExportJob, options: InFrame) -> ExportSummary:
    """Write the field's deviations as pictures, rasters and a bag."""
    from locplan.export._plain_files import layer, quantiles

    layer(target, job.field, frame=options.frame)
    return quantiles(job.field)


@dataclass(frozen=True, kw_only=True)
class AreaOptions(InFrame):
    """The options of degenerate areas."""

    threshold: float | None = None
    """Minimum u of an area; by default half of that of a corridor without features: .5 for scan,
    .18 for sad."""
    min_area: float = 1.0
    """Minimum size of an area, in m²; 1 by default."""

    def __post_init__(self) -> None:
        from locplan.export._areas import check_areas

        check_areas(self.threshold, self.min_area)


def write_areas(target: Path, job: ExportJob, options: AreaOptions) -> ExportSummary:
    """Write the degenerate areas as polygons."""
    from locplan.export._areas import save_degenerate_areas, summary_of

    areas = save_degenerate_areas(target, job.costs, job.field, **vars(options))
    return summary_of(areas, job.costs, job.field, options.threshold)


write_keepout = by("_nav2:nav2_keepout", paths=True)
write_static = by("_nav2:nav2_static", paths=True)
write_map, write_field = by("_values:ros_map"), by("_plain_files:field", "field")
FORMATS = (
    Format(
        *("nav2-keepout", "a mask for Nav2's KeepoutFilter", write_keepout, ChargedOptions),
        paths="several",
    ),
    Format(
        *("nav2-static", "a map for a StaticLayer of Nav2", write_static, ChargedOptions),
        paths="several",
    ),
    Format("nav2-speed", "a mask for Nav2's SpeedFilter", write_speed, SpeedOptions),
    Format(
        *("route-graph", "a GeoJSON graph for Nav2's route server", write_graph, GraphOptions),
        shows_progress=True,
    ),
    Format(
        "nav2-routes",
        "the recommended ways of many queries as a graph for Nav2's route server, and in a bag",
        write_routes,
        RoutesOptions,
        library="mcap",
        paths="several",
        shows_progress=True,
        check=check_routes,
    ),
    Format("lif", "a VDMA LIF layout for fleet managers", write_lif, LifOptions, (".json",)),
    Format("ros-map", "u in per cent for the map servers of ROS", write_map),
    Format("bag", "a ROS 2 bag", write_bag, BagOptions, (".mcap",), "mcap", "several"),
    Format(
        *("path", "a path; also .json or .yaml", write_path, PathOptions),
        suffixes=(".csv", ".json", ".yaml"),
        paths="one",
    ),
    Format("csv", "a table of the field", write_field, suffixes=(".csv",)),
    Format("npz", "the field's arrays", write_field, suffixes=(".npz",)),
    Format("png", "a picture of the field", write_field, suffixes=(".png",)),
    Format(
        *("layer", "deviations for QGIS, RViz and Foxglove", write_layer, InFrame), library="mcap"
    ),
    Format(
        "degenerate-areas", "degenerate areas as GeoJSON and for Autoware", write_areas, AreaOptions
    ),
)
