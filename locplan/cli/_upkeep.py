"""The commands about maps, fields, the cache, runs and the shell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.files import PICTURES, check_target
from locplan._util.output import Output
from locplan._util.progress import progress_bar, working
from locplan.cli import _options as shared, _types as typed
from locplan.cli._robot_options import FieldOptions, RobotOptions
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan import CovarianceField, OccupancyGrid, Robot


@typed.command(
    "info lab.yaml -o lab_map.png",
    "info lab.yaml --lidar turtlebot4 --lidars",
    "info hall -o maps",
)
class info(typed.OneMap, RobotOptions):
    """Describe a map: size, what misleads, rooms, and places for start and goal.

    With a lidar, the share of places that one scan cannot tell from another, and safe starts.
    """

    lidars: Annotated[bool, typed.under("Field")] = False
    """Compare how much of the floor is degenerate with the robot's lidar and with those of
    turtlebot3, turtlebot4 and tim571, of short, middle and long range."""
    output: Annotated[Path | None, typed.Target, typed.under("Output")] = None
    """File for a picture with grid lines and places (.png, .pdf, .svg), or for a built-in map a
    folder that gets the map's files."""
    force: shared.Force = False
    json: shared.Json = False

    def __call__(self) -> None:
        files = self._files()
        robot = self.load_robot()
        about = locplan.planners.describe_map(self.map_file, robot=robot)
        names = ("turtlebot3", "turtlebot4", "tim571") if self.lidars else ()
        every = dict.fromkeys([robot.lidar, *map(locplan.Lidar.preset, names)])
        lines, found = [about.report()], about.summary()
        if robot.lidar:
            line, found["ambiguous"] = self._ambiguous(about.grid, robot)
            lines.append(line)
        if known := [lidar for lidar in every if lidar]:
            with progress_bar("lidars", "cells") as progress:
                compare = locplan.costs.compare_lidars
                shares = compare(about.grid, known, robot=robot, progress=progress)
            table = locplan.costs.lidars_table(shares)
            lines, found = [*lines, str(table)], found | {"lidars": table.records()}
        if files and files.is_file:
            with working("drawing"), files.writing() as new:
                locplan.plotting.save_figure(locplan.plotting.info_figure(about), new)
        elif files:
            with files.writing(adds=True) as new:
                locplan.save_map(about.grid, new / f"{about.grid.name}.yaml")
        shared.show(self.json, found, "\n".join(lines), self.output)

    def _files(self) -> Output | None:
        """The file of a picture, or the folder for the files of a built-in map; None for none."""
        if self.output is None:
            return None
        built_in, name = locplan.maps.is_built_in(self.map_file), self.map_file.name
        if not built_in or self.output.suffix.lower() in PICTURES:
            output = Output(self.output, "info", self.force, is_file=True)
            check_target(self.output, *PICTURES)
            output.check()
            return output
        folder = Output(self.output, "maps", self.force)
        folder.check(f"{name}.yaml", f"{name}.pgm")
        return folder

    def _ambiguous(self, grid: OccupancyGrid, robot: Robot) -> tuple[str, object]:
        """The line about ambiguous places and starts, and the same fit for JSON."""
        try:
            with progress_bar("ambiguous places", "poses") as progress:
                found = locplan.recordings.find_ambiguous_places(grid, robot, progress=progress)
        except ConfigError as error:  # the robot fits nowhere, or there is no wall
            return f"ambiguous places: not known, since {error}", None
        return found.sentence, {"share": found.share, "starts": found.starts.tolist()}


@typed.command(
    "field lab.yaml -o lab.npz",
    "field lab.yaml --lidar turtlebot4 --picture heading_std -o heading.png",
)
class field(typed.ManyMaps, FieldOptions, shared.Computing, shared.Output):
    """Compute how uncertain a pose match is all over a map, or over many."""

    output: Annotated[Path | None, typed.Target, typed.under("Output")] = None
    """File for the field (.npz) or a picture of it (.png, .pdf, .svg); of many maps a folder."""
    picture: Annotated[str | None, typed.under("Output", metavar="SCALAR")] = None
    """Scalar that is drawn: e, position_std, position_rms, heading_std, ambiguity or entropy; by
    default what degeneracy is made of."""

    def __call__(self) -> int:
        from locplan._util.saved import plain

        _, config = self.robot_and_field()
        output = self.output
        jobs = locplan.export.field_jobs(self.maps, output, self.picture, config, force=self.force)

        def compute(grid: OccupancyGrid) -> CovarianceField:
            return self.field_of(grid, config)

        if len(jobs) == 1:
            summary = locplan.field.FieldSummary.of(jobs[0].run(compute))
            self.show(plain(summary), summary.table(), output)
            return 0
        runs = list(locplan.export.run_field_jobs(jobs, compute))
        failed = [run for run in runs if run.error]
        table = locplan.export.field_runs_table(runs)
        written = [output] if len(failed) < len(runs) else []
        self.show([run.to_json() for run in runs], table, *written)
        return 2 if failed else 0


cache = typed.named("cache", "cache list", "cache clear --older-than 30")
cache.help = "List, clear or find the fields and trajectories computed before."

Days = Annotated[float, Parameter(metavar="DAYS", validator=Number(gte=0))]


@cache.command(name="list")
def list_(*, cache_dir: shared.CacheDir = None, json: shared.Json = False) -> None:
    """List the cached fields and trajectories, the last used first."""
    folder = locplan.field.cache_folder(cache_dir)
    entries = locplan.field.cache_entries(folder)
    table = locplan.field.cache_table(entries, folder)
    shared.show(json, [entry.to_json() for entry in entries], table)


@cache.command
def clear(*, older_than: Days = 0.0, cache_dir: shared.CacheDir = None) -> None:
    """Remove cached fields and trajectories, except those that are being computed.

    Parameters
    ----------
    older_than
        Time for which those were not used that are removed, in days.
    """
    from locplan._util.tables import in_bytes

    removed, busy = locplan.field.clear_cache(locplan.field.cache_folder(cache_dir), older_than)
    kept = f"; being computed, and kept: {len(busy)}" if busy else ""
    print(f"removed {len(removed)}, {in_bytes(sum(entry.size for entry in removed))}{kept}")


@cache.command
def path(*, cache_dir: shared.CacheDir = None) -> None:
    """Print the folder of the cached fields."""
    print(locplan.field.cache_folder(cache_dir))
