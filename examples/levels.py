"""Measure what settings change for a robot with a fault, in simulation and on recordings.

Run: python examples/levels.py [FOLDER [RECORDINGS]]

The baseline (Nav2's defaults), the safe and the precise preset drive at each level of disturbance:
16 simulated drives on two routes of each of three maps, and 12 replays of each recording. Three
seeds put the faults into the odometry of the recordings. The kinked map is a recording's own.
RECORDINGS is a folder with the logs and maps of `SOUND` and `KINKED`. Without it, only simulated
drives count. Takes minutes.

Writes FOLDER/levels.csv, one row for each case, and FOLDER/levels.png. Interrupted runs resume.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from evidence import BASELINE, find_version, read_rows, summarize_levels, write_rows

import locplan
from locplan._support import drawing as style
from locplan._support.drawing import NotebookFigure, save_figure
from locplan._support.intervals import estimate_mean
from locplan.planning import describe_map
from locplan.recordings import Recording, read_recording, replay
from locplan.robots import PRECISE, SAFE, Amcl, Robot, with_preset
from locplan.simulation import (
    LEVELS,
    NO_FAULT,
    Drives,
    Level,
    Simulator,
    drive_open,
)
from locplan.simulation.levels import KINKED_MAP, REVERSAL, SLIP, STANDSTILL

MAPS_FOLDER = Path(__file__).resolve().parent.parent / "maps"
SETTINGS = {BASELINE: Amcl()} | {name: with_preset(Amcl(), name) for name in (SAFE, PRECISE)}
"""The settings that drive at the levels of disturbance."""
MAPS = ("two_corridors", "office", "warehouse")
SOUND = ("intel", "aces", "csail", "wean2", "mines2")
"""Recordings whose odometry and map are sound."""
KINKED = "killian_3"
"""Recording whose map has kinks."""
SOUND_LEVELS = (NO_FAULT, SLIP, STANDSTILL, REVERSAL)
"""Levels of recordings whose odometry and map are sound."""
FAULT_SEEDS = (1, 2, 3)
"""Seeds of the places where odometry of a recording misses motion; each has a third of the runs."""
REVERSE = 2.0
"""Distance that a route leads back at the level of reversals, and the least that a recording must
lead back to count there [m]."""
Row = dict[str, Any]


def main(
    folder: str = "levels",
    recordings: str = "",
    maps: Sequence[str] = MAPS,
    drives: int = 16,
    runs: int = 12,
) -> None:
    """Drive with each setting at each level, and draw errors and lost drives."""
    target = Path(folder)
    rows: list[Row] = read_rows("levels", target)
    known = {(row["source"], row["place"], row["level"], row["settings"]) for row in rows}
    for source, place, level, drive in list_cases(recordings, maps, drives, runs):
        for settings, amcl in SETTINGS.items():
            if (source, place, level.name, settings) in known:
                continue
            rows.append(make_row(source, place, level, settings, drive(amcl)))
            print(f"{place}, {level.name}, {settings}: {rows[-1]['error']:.2f} m", flush=True)
            write_rows(target / "levels.csv", rows)
    save_figure(levels_figure(read_rows("levels", target)), target / "levels.png")
    print(f"wrote {target / 'levels.csv'}, {target / 'levels.png'}")


def make_row(source: str, place: str, level: Level, settings: str, drives: Sequence[Drives]) -> Row:
    """Return the row of a case: the error of a typical drive, and counts of lost drives."""
    log_error = np.concatenate([np.log(each.mean_squares) / 2 for each in drives])
    error = np.exp(estimate_mean(log_error))
    lost = np.concatenate([each.lost for each in drives])
    off_at_end = np.concatenate([each.off_at_end for each in drives])
    return {
        "source": source,
        "place": place,
        "level": level.name,
        "settings": settings,
        "drives": len(lost),
        "error": float(error[0]),
        "error_low": float(error[1]),
        "error_high": float(error[2]),
        "lost": int(lost.sum()),
        "off_at_end": int(off_at_end.sum()),
        "version": find_version(),
    }


def list_cases(
    recordings: str, maps: Sequence[str], drives: int, runs: int
) -> Iterator[tuple[str, str, Level, Callable[[Amcl], list[Drives]]]]:
    """List source, place and level of each case, and a function that drives with settings."""
    for name in maps:
        grid = locplan.load_map(MAPS_FOLDER / f"{name}.yaml")
        paths = find_routes(grid)
        for level in LEVELS:
            routes = paths
            if level is REVERSAL:
                routes = {name: back_up(path) for name, path in paths.items()}
            if all(not level.can_affect(path, grid) for path in routes.values()):
                print(f"{name}: no route can have the fault of the level {level.name}")
                continue

            def simulate_level(
                amcl: Amcl,
                grid: locplan.OccupancyGrid = grid,
                routes: Mapping[str, locplan.Path] = routes,
                level: Level = level,
            ) -> list[Drives]:
                simulator = Simulator(grid, Robot("turtlebot4", filter=amcl), threads=1)
                return [*drive_open(simulator, routes, range(drives), level=level).values()]

            yield "simulation", name, level, simulate_level
    for name in (*SOUND, KINKED) if recordings else ():
        file = Path(recordings) / f"{name}.log.gz"
        if not file.exists():
            print(f"{file}: skipped, there is no such recording")
            continue
        recording, grid = read_recording(file), locplan.load_map(file.with_name(f"{name}.yaml"))
        for level in (KINKED_MAP,) if name == KINKED else SOUND_LEVELS:
            seeds = FAULT_SEEDS if level.missing else FAULT_SEEDS[:1]
            disturbed = {seed: disturb(recording, level, seed) for seed in seeds}
            if not all(disturbed.values()):
                continue

            def replay_level(
                amcl: Amcl,
                grid: locplan.OccupancyGrid = grid,
                disturbed: Mapping[int, Recording] = disturbed,
            ) -> list[Drives]:
                count = runs // len(disturbed)
                return [
                    replay(
                        drive,
                        grid,
                        Robot(drive.lidar, filter=amcl),
                        runs=count,
                        seed=seed,
                        threads=1,
                    ).drives
                    for seed, drive in disturbed.items()
                ]

            yield "recordings", name, level, replay_level


def find_routes(grid: locplan.OccupancyGrid, count: int = 2) -> dict[str, locplan.Path]:
    """Return shortest paths between places far apart, the first routes of `locplan check`."""
    robot = Robot("turtlebot4")
    costs = locplan.Costmap.blank(grid, robot=robot)
    paths = {}
    for pair in describe_map(grid, robot=robot).pairs[:count]:
        path = locplan.plan(costs, (pair.start.x, pair.start.y), (pair.goal.x, pair.goal.y)).path
        if path is not None:
            paths[f"{pair.start.name} to {pair.goal.name}"] = path
    return paths


def back_up(path: locplan.Path) -> locplan.Path:
    """Return a path that leads back over `REVERSE` after a third, and on again."""
    fine = path.resample(0.05, even=True)
    end, begin = np.searchsorted(fine.distance, [path.length / 3, path.length / 3 - REVERSE])
    order = [*range(end), *range(end, begin, -1), *range(begin, len(fine.xy))]
    return locplan.Path(fine.xy[order], np.unwrap(fine.facing)[order])


def disturb(recording: Recording, level: Level, seed: int = 1) -> Recording | None:
    """Return a recording with a level's fault in its odometry; None if it cannot have the fault."""
    before = recording.odometry
    after = level.disturb_odometry(before, recording.poses, np.random.default_rng(seed))
    changed = np.hypot(*(np.diff(after, axis=0) - np.diff(before, axis=0))[:, :2].T).sum()
    # Lost signs change the motion by twice the distance in reverse.
    if level is REVERSAL and changed < 2 * REVERSE:
        return None
    return replace(recording, odometry=after)


def levels_figure(rows: Sequence[Row]) -> NotebookFigure:
    """Draw errors above shares of lost drives, simulation next to recordings."""
    sources = list(dict.fromkeys(row["source"] for row in rows))
    summaries = [summarize_levels(rows, source) for source in sources]
    figure = NotebookFigure(figsize=(1.5 + 5.2 * len(sources), 5.8), layout="constrained")
    panels = figure.subplots(
        2,
        len(sources),
        sharex="col",
        sharey="row",
        squeeze=False,
        gridspec_kw={"width_ratios": [max(3, len(each)) for each in summaries]},
    )
    colours = dict(zip(SETTINGS, ("0.35", style.BLUE, style.VERMILION), strict=True))
    for (above, below), source, levels in zip(panels.T, sources, summaries, strict=True):
        for at, (_, results) in enumerate(levels.values()):
            for shift, (name, result) in zip((-0.27, 0.0, 0.27), results.items(), strict=True):
                x, colour = at + shift, colours[name]
                above.plot(
                    [x] * len(result.errors), result.errors, "o", color=colour, ms=3, alpha=0.4
                )
                above.plot([x - 0.11, x + 0.11], [result.error.value] * 2, color=colour, lw=3)
                below.bar(x, result.lost.value, 0.23, color=colour, alpha=0.25)
                below.bar(x, result.off_at_end.value, 0.23, color=colour)
                if source == "simulation":
                    above.vlines(x, *result.error[1:], color=colour, lw=1.2)
                    below.vlines(x, *result.off_at_end[1:], color="black", lw=1)
                if not at:
                    below.text(
                        x,
                        max(result.lost.value, result.off_at_end.high) + 0.03,
                        name,
                        rotation=90,
                        ha="center",
                        va="bottom",
                        color=colour,
                        fontweight="bold",
                    )
        places = "maps" if source == "simulation" else "drives"
        ticks = [f"{name.replace(' ', chr(10))}\n({count})" for name, (count, _) in levels.items()]
        above.set_title(f"{source} (number of {places})")
        below.set_xticks(range(len(ticks)), ticks)
        above.set_yscale("log")
        above.yaxis.set_major_formatter("{x:g}")
        below.set_ylim(0, 1)
        below.yaxis.set_major_formatter("{x:.0%}")
        for axes in (above, below):
            axes.grid(axis="y", alpha=0.3)
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
            axes.tick_params(axis="x", length=0)
    panels[0, 0].set_ylabel("error of a typical drive [m]")
    panels[1, 0].set_ylabel("drives lost at some time (light)\nand off at the end (dark)")
    return figure


if __name__ == "__main__":
    main(*sys.argv[1:3])
