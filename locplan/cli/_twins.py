"""The command that finds the places of a map that a robot can be mistaken for."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import Parameter

from locplan.cli._groups import (
    FIELD,
    GENERAL,
    Count,
    MapFile,
    Seed,
    Text,
    command,
    option_group,
)
from locplan.cli._kinds import given_of
from locplan.cli._options import Threads
from locplan.cli._output import Output
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load, refuse, two_numbers

app = command(
    "twins",
    "twins lab.yaml --lidar rplidar-a1 -o alike",
    "twins lab.yaml --lidar rplidar-a1 --at 2,3",
)


@option_group(GENERAL)
class Asked:
    """What is asked for."""

    at: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """Place whose twins are looked for, x,y in metres; all places by default."""
    starts: Count | None = None
    """Greatest number of starts that are proposed; 5 by default."""
    spacing: float | None = None
    """Distance between neighbouring places, in metres; 0.8 by default."""
    matches: Annotated[int, Parameter()] = 0
    """Number of noisy scans from random poses that are matched with the map, to check what is
    foreseen; none by default."""
    seed: Seed | None = None
    """Seed of these scans; 1 by default."""

    def places(self) -> dict[str, Any]:
        """The places that are compared; a ConfigError if an option is not read."""
        from locplan._util.checks import whole

        if self.matches:
            whole("--matches", self.matches, 2, 100_000)
        else:
            refuse("without --matches", seed=self.seed)
        if self.at is None:
            return {} if self.spacing is None else {"spacing": self.spacing}
        refuse("with --at", starts=self.starts, spacing=self.spacing, matches=self.matches or None)
        return {"places": [two_numbers("at", self.at)]}


@option_group(FIELD)
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
    from locplan import twins as core
    from locplan._util.progress import progress_bar

    options = {**given_of(compared), **asked.places()}
    robot = robot_options.load()
    out.check(core.Twins.files)
    grid = load(map_file)
    with progress_bar("looking for twins", "poses") as progress:
        found = core.find_twins(
            grid,
            robot,
            threads=threads,
            progress=progress,
            **options,
        )
    starts = [] if asked.at else found.best_starts(*filter(None, [asked.starts]))
    matches = None
    if asked.matches:
        with progress_bar("matching scans", "scans") as progress:
            seed = 1 if asked.seed is None else asked.seed
            matches = found.verify(asked.matches, seed=seed, threads=threads, progress=progress)
    out.finish(found, starts, matches)
