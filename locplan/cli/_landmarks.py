"""The command that proposes places for landmarks, and proves by drives whether they help."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from locplan.cli._groups import (
    GENERAL,
    Count,
    DriveSeed,
    MapFile,
    command,
    option_group,
)
from locplan.cli._options import Threads
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._route_options import RouteOptions
from locplan.cli._values import load, numbers, position

if TYPE_CHECKING:
    from locplan.landmarks import Sites
    from locplan.maps import OccupancyGrid

app = command(
    "landmarks",
    "landmarks lab.yaml --object pole:0.2 --count 3 --start 2,3 --goal 38,3 -o marked",
    "landmarks lab.yaml --object box:0.6,0.3 --path mine.csv --robot nav2_params.yaml -o marked",
    "landmarks lab.yaml --object box:0.6,0.3 --count 8 --region all -o marked",
)


@option_group(GENERAL)
class Placing:
    """The objects, the region that they serve if it is no route, and where they may stand."""

    object: Annotated[str, Parameter(metavar="KIND:SIZE")] = "pole:0.2"
    """Poles (pole:DIAMETER) or boxes (box:LENGTH,WIDTH), in metres; pole:0.2 by default."""
    count: Annotated[int, Parameter()] = 6
    """Greatest number of objects; 6 by default."""
    region: Annotated[
        tuple[str, ...], Parameter(metavar="X0,Y0,X1,Y1", allow_leading_hyphen=True)
    ] = ()
    """Rectangle in which the robot may go anywhere, in metres, repeatable; "all" is the map."""
    where: Literal["walls", "free", "both"] = "both"
    """Places that are tried: along walls, in the open, or both, by default both."""
    spacing: float = 0.5
    """Distance between places along walls, in metres; 0.5 by default."""
    clearance: float = 0.2
    """Distance of routes and passages from the objects besides the robot's radius, in metres; 0.2
    by default."""
    keep_out: Annotated[
        tuple[str, ...], Parameter(metavar="X0,Y0,X1,Y1", allow_leading_hyphen=True)
    ] = ()
    """Rectangle in which no object may stand, in metres; repeatable."""
    existing: Annotated[
        tuple[str, ...], Parameter(metavar="X,Y[,DEG]", allow_leading_hyphen=True)
    ] = ()
    """Object of this kind in the map, which may be moved, x,y in metres; repeatable."""
    drives: Annotated[int, Parameter()] = 100
    """Number of drives of the verification; 100 by default, 0 leaves it out."""
    trials: Count | None = None
    """Number of placements that are driven first, of which the best is taken; 4 by default, and 1
    without drives. Along routes the first two are by the two objectives."""

    def sites(self) -> Sites:
        """Where the objects may stand."""
        from locplan.landmarks import Sites

        keep_out = [numbers("keep-out", text, 4) for text in self.keep_out]
        return Sites(
            where=self.where,
            spacing=self.spacing,
            clearance=self.clearance,
            keep_out=keep_out or None,
            existing=[position("existing", text) for text in self.existing],
        )

    def served(self, grid: OccupancyGrid) -> dict[str, Any]:
        """The region that the objects serve, if one is named."""
        import numpy as np

        rectangles = [numbers("region", text, 4) for text in self.region if text != "all"]
        if not self.region:
            return {}
        return {"region": np.ones(grid.shape, bool) if "all" in self.region else rectangles}


@app.default
def landmarks(
    map_file: MapFile,
    /,
    *,
    routes: RouteOptions = RouteOptions(),
    placing: Placing = Placing(),
    robot_options: RobotOptions = RobotOptions(),
    seed: DriveSeed = 1,
    threads: Threads = None,
    out: Output = Output(),
) -> None:
    """Propose places for poles or boxes that keep the robot from getting lost on its ways.

    Drives with your own filter, before, after and with random places, say whether they help.
    """
    from locplan import landmarks as core
    from locplan._util.progress import progress_bar
    from locplan.field import equipped
    from locplan.simulation import check_drives

    drives = placing.drives
    ways = routes.given(region=placing.region)
    kind = core.parsed_object(placing.object)
    check_drives(drives, or_none=True)
    robot = equipped(robot_options.load())
    robot_options.warn(robot)
    sites = placing.sites()
    grid = load(map_file)
    ways |= placing.served(grid)
    out.check(core.Landmarks.files)
    with progress_bar("placing landmarks", "steps") as progress:
        made = core.place_landmarks(
            grid,
            kind,
            placing.count,
            **ways,
            robot=robot,
            sites=sites,
            threads=threads,
            progress=progress,
        )
    trials = placing.trials or (None if drives else 1)
    tried = {} if trials is None else {"trials": trials}
    with progress_bar("driving placements", "drives") as progress:
        made = core.best_of_trials(made, **tried, seed=seed, threads=threads, progress=progress)
    verification = None
    if drives:
        with progress_bar("verifying by drives", "drives") as progress:
            verification = made.verify(drives, seed=seed, threads=threads, progress=progress)
    out.finish(made, verification)
