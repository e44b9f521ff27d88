"""The command that finds the places of a map that a robot can be mistaken for."""

from __future__ import annotations

import locplan
from locplan._util.checks import whole
from locplan._util.progress import progress_bar
from locplan.cli._groups import XY, Count, MapFile, Seed, Threads, command, option_group
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import given_of, refuse

app = command(
    "twins",
    "twins lab.yaml --lidar rplidar-a1 -o alike",
    "twins lab.yaml --lidar rplidar-a1 --at 2,3",
)


@option_group("Options")
class Asked:
    """What is asked for."""

    at: XY = None
    """Place whose twins are looked for, x,y in metres; all places by default."""
    starts: Count | None = None
    """Maximum number of starts that are proposed; 5 by default."""
    spacing: float | None = None
    """Distance between neighbouring places, in metres; 0.8 by default."""
    matches: int = 0
    """Number of noisy scans from random poses that are matched with the map, to check what is
    foreseen; none by default."""
    seed: Seed | None = None
    """Seed of these scans; 1 by default."""

    def check(self) -> None:
        """Raise a ConfigError if an option is out of its range, or is not read."""
        if self.matches:
            whole("--matches", self.matches, 2, 100_000)
        else:
            refuse("without --matches", seed=self.seed)
        if self.at:
            refuse(
                "with --at", starts=self.starts, spacing=self.spacing, matches=self.matches or None
            )


@option_group("Field")
class Compared:
    """How scans are compared."""

    global_effective_beams: float | None = None
    """Number of independent beams that count as much as all together; 36 by default. It is fitted
    to global matches, and not the number of scan."""


@app.default
def twins(
    map_file: MapFile,
    /,
    *,
    asked: Asked = Asked(),
    robot_options: RobotOptions = RobotOptions(),
    compared: Compared = Compared(),
    threads: Threads = None,
    out: Output = Output(),
) -> None:
    """Find places that look alike to the lidar, the map's symmetries, and where to start the robot.

    It is about matching single scans with the whole map. AMCL's own global localization, which
    scatters particles and drives, is not foreseen well.
    """
    asked.check()
    options = given_of(compared)
    if asked.at:
        options["places"] = [asked.at]
    elif asked.spacing is not None:
        options["spacing"] = asked.spacing
    robot = robot_options.load()
    out.check(locplan.twins.Twins.files)
    grid = locplan.load_map(map_file)
    with progress_bar("looking for twins", "poses") as progress:
        found = locplan.find_twins(grid, robot, threads=threads, progress=progress, **options)
    starts = [] if asked.at else found.best_starts(*filter(None, [asked.starts]))
    matches = None
    if asked.matches:
        with progress_bar("matching scans", "scans") as progress:
            seed = given_of(asked).get("seed", 1)
            matches = found.verify(asked.matches, seed=seed, threads=threads, progress=progress)
    out.finish(found, starts, matches)
