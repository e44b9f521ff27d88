"""The commands about maps, fields, the cache, runs and the shell."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.files import PICTURES, check_target
from locplan._util.progress import progress_bar, working
from locplan._util.results import ResultFolder
from locplan._util.runs import Run
from locplan.cli import _options as shared, _types as typed
from locplan.cli._application import application, launched
from locplan.cli._robot_options import FieldOptions, RobotOptions
from locplan.errors import LocplanError


@typed.command("info lab.yaml -o lab_map.png", "info lab.yaml --lidars")
class info(typed.OneMap, RobotOptions):
    """Describe a map: size, what misleads, rooms, and places for start and goal."""

    lidars: Annotated[bool, typed.under("Field")] = False
    """Compare how much of the floor is degenerate with the robot's lidar and with those of
    turtlebot3, turtlebot4 and tim571, of short, middle and long range."""
    output: Annotated[Path | None, typed.Target, typed.under("Output")] = None
    """File for a picture with grid lines and places (.png, .pdf, .svg)."""
    json: shared.Json = False

    def __call__(self) -> None:
        if self.output:
            check_target(self.output, *PICTURES)
        robot = self.load_robot()
        about = locplan.planners.describe_map(self.map_file, robot=robot)
        names = ("turtlebot3", "turtlebot4", "tim571") if self.lidars else ()
        every = dict.fromkeys([robot.lidar, *map(locplan.Lidar.preset, names)])
        lines, found = [about.report()], about.summary()
        if known := [lidar for lidar in every if lidar]:
            with progress_bar("lidars", "cells") as progress:
                compare = locplan.costs.compare_lidars
                shares = compare(about.grid, known, robot=robot, progress=progress)
            table = locplan.costs.lidars_table(shares)
            lines, found = [*lines, str(table)], found | {"lidars": table.records()}
        if self.output:
            with working("drawing"):
                locplan.plotting.save_figure(locplan.plotting.info_figure(about), self.output)
        shared.show(self.json, found, "\n".join(lines), self.output)


@typed.command("field lab.yaml -o lab.zarr --picture lab.png")
class field(typed.ManyMaps, FieldOptions, shared.Computing, shared.Output):
    """Compute how uncertain a pose match is all over a map, or over many."""

    output: Annotated[Path | None, typed.Target, typed.under("Output")] = None
    """File for the field (.zarr; of many maps a folder)."""
    picture: Annotated[Path | None, typed.under("Output")] = None
    """File for a picture of e (.png, .pdf, .svg; of many maps a folder)."""

    def __call__(self) -> int:
        _, config = self.robot_and_field()
        written = [self.output, self.picture]
        jobs = locplan.export.field_jobs(self.maps, *written, force=self.force)
        with self.fields_of(config) as compute:
            if len(jobs) == 1:
                summary = locplan.field.FieldSummary.of(jobs[0].run(compute))
                self.show(summary.summary(), summary.table(), *written)
                return 0
            runs = list(locplan.export.run_field_jobs(jobs, compute))
        failed = [run for run in runs if run.error]
        table = locplan.export.field_runs_table(runs)
        kept = written if len(failed) < len(runs) else ()
        self.show([run.to_json() for run in runs], table, *kept)
        return 2 if failed else 0


cache = typed.named("cache", "cache list", "cache clear --older-than 30")
cache.help = "List, clear or find the fields, trajectories and checks of walls computed before."

Days = Annotated[float, Parameter(metavar="DAYS", validator=Number(gte=0))]


@cache.command(name="list")
def list_(*, cache_dir: shared.CacheDir = None, json: shared.Json = False) -> None:
    """List the cached fields, trajectories and checks of walls, the last used first."""
    found = locplan.field.FieldCache.of(cache_dir)
    shared.show(json, found.summary(), found.table())


@cache.command
def clear(*, older_than: Days = 0.0, cache_dir: shared.CacheDir = None) -> None:
    """Remove cached fields, trajectories and checks of walls, but for those being computed.

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


@typed.command("maps maps --name two_corridors --resolution 0.1")
class maps(typed.Options):
    """Write the generated maps as PGM and YAML."""

    output: Annotated[Path, typed.Target, typed.under("Output")] = dataclasses.field(
        default=Path("maps"), kw_only=False
    )
    """Folder of the maps; maps by default."""
    name: tuple[str, ...] = ()
    """Map to write, by default all; repeatable."""
    resolution: float = 0.05
    """Edge of a cell, in metres; 0.05 by default."""
    boundary_noise: float = 0.0
    """Share of boundary cells that flip, as in a SLAM map; 0..1."""
    seed: int = 0
    """Seed of the noise; 0 by default."""
    force: shared.Force = False

    def __call__(self) -> None:
        environments = locplan.maps.environments
        names = self.name or environments.names()
        drawn = self.given("resolution", "boundary_noise", "seed")
        noise = self.boundary_noise
        ending = f"_noise{noise:g}_seed{self.seed}" if noise else ""
        with ResultFolder(self.output, "maps", self.force).writing(others_stay=True) as new:
            for name in names:
                locplan.save_map(environments.make(name, **drawn), new / f"{name}{ending}.yaml")
        shared.say_written(*(self.output / f"{name}{ending}.yaml" for name in names))


@typed.command("run planned/run.yaml -o again", "run planned")
class run(shared.Output):
    """Repeat the command that wrote results, to the same numbers.

    Results replace those of the run, unless --output names another folder or file.
    """

    file: Path = dataclasses.field(kw_only=False)
    """Run of some results: their folder, its run.yaml, or FILE.run.yaml."""

    def __call__(self) -> int | None:
        before = Run.read(self.file)
        if before.command in ("run", "explore", "completion"):  # they write no results of their own
            raise LocplanError(f"{self.file}: {before.command} is not one that is repeated")
        words = [*before.words(), f"--output={self.output or Run.home(self.file)}"]
        words += ["--force"] * self.force + ["--json"] * self.json
        code, now = launched(words)
        for line in before.changes(now) if now else ():
            print(f"locplan: warning: {line}", file=sys.stderr)
        return code


@typed.command(
    "completion bash > ~/.local/share/bash-completion/completions/locplan",
    "completion zsh > ~/.zfunc/_locplan   (a folder in $fpath)",
    "completion fish > ~/.config/fish/completions/locplan.fish",
)
def completion(
    shell: Literal["bash", "zsh", "fish"],
) -> None:
    """Print a script by which a shell completes commands and options.

    Parameters
    ----------
    shell
        The shell.
    """
    print(application().generate_completion(shell=shell))
