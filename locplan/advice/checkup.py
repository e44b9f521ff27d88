"""From a map and a robot to the failures and the fixes that help: `check`."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace

from locplan._support.checks import check_choice, check_integer, check_threads
from locplan._support.progress import ProgressCallback, scale_progress, split_progress
from locplan.advice import text as in_short
from locplan.advice.check_drives import EFFORTS, FixTrials
from locplan.advice.check_result import Check, explain_spots
from locplan.advice.driving import Site
from locplan.advice.fixes import apply_fixes
from locplan.advice.map_reading import MapReading
from locplan.advice.rates import is_better, rank_fixes
from locplan.advice.recorded import analyze_recordings
from locplan.advice.routes import Stations, plan_routes
from locplan.advice.weak_spots import WeakSpot, find_weak_spots
from locplan.errors import LocplanError
from locplan.field.config import COARSE_STRIDE, FieldConfig, equip_robot
from locplan.field.field import CovarianceField
from locplan.field.fisher import Fused
from locplan.field.store import load_or_compute
from locplan.maps.files import MapSource, read_map
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.map_faults import faults
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.recordings.recording import Recording
from locplan.robots.amcl import Amcl
from locplan.robots.robot import Robot
from locplan.simulation.worlds import check_filter_map

SHARES = {"field": 200, "baseline": 150, "fixes": 450, "together": 200}
"""Share of the work of each stage, in thousandths."""


def check(
    grid: OccupancyGrid | str | os.PathLike[str],
    robot: Robot | None = None,
    stations: Stations | None = None,
    recordings: Sequence[Recording] = (),
    *,
    filter_map: OccupancyGrid | None = None,
    effort: str = "usual",
    seed: int = 1,
    threads: int | None = None,
    found: Callable[[str], None] | None = None,
    progress: ProgressCallback | None = None,
) -> Check:
    """Find where a robot fails on a map, and the fixes that help, by simulated drives.

    `check` finds the map's faults and weak spots, and simulates the robot with its own filter
    along routes, in open loop and in closed loop. It then simulates each applicable fix on the
    same routes, in the same worlds: the corrected map file, the repaired map, other AMCL settings,
    the lidar's full range, other paths or a mask, and landmarks if the robot is still lost. Fixes
    are combined until neither lost drives nor the error fall further, and fresh drives alone
    decide about the combination. If robots fail with perfect localization, too, the result names
    the passage instead.

    AMCL settings are the presets of `locplan.robots.presets`. Without a recording, a preset is
    recommended only if it does no significant harm at any level of disturbance, see
    `locplan.simulation.levels`. With one, settings are recommended that hold on the recording.

    Parameters
    ----------
    grid : OccupancyGrid, str or path
        The map, or its file, whose thresholds and greys are then looked at, too.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.load` reads.
    stations : path, mapping or sequence, optional
        Places between which the robot drives: a CSV file of name, x, y [m], or of queries;
        positions by name; or (start, goal) pairs. By default places far apart in each room.
    recordings : sequence of Recording, default ()
        Recorded drives of the robot on this map, whose poses count as true, see
        `locplan.recordings.smoothing.with_ground_truth`. If the map fits, lidar and odometry err in
        simulation as they did in the longest one, the resolution is compared, and places where
        scans do not fit the map are faults. AMCL settings are replayed over all of them, and must
        hold on each.
    filter_map : OccupancyGrid, optional
        Map of the robot's filter, such as a repaired one; by default the map itself. A corrected
        map file is then no fix.
    effort : {"quick", "usual", "thorough"}, default "usual"
        Amount of drives: 32, and neither other paths nor landmarks; 96, which know the share of
        lost drives to 10 points; or 288.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal results, on any number of threads.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    found : callable, optional
        Called with a sentence for each finding, as soon as it is known.
    progress : callable, optional
        Called with (done, total) in thousandths of the work.

    Returns
    -------
    Check
        Failures, fixes and the next action; `save` writes a report and the files of the fixes.

    Raises
    ------
    LocplanError
        If the map is a mask, the robot fits nowhere, a station cannot be reached, or a value is
        out of its range.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> robot = locplan.Robot(locplan.Lidar(range=6.0, beams=60))
    >>> robot = robot.changed({"min_particles": 100, "max_particles": 100})
    >>> stations = {"west": (2.0, 3.0), "middle": (14.0, 3.0)}
    >>> report = check(grid, robot, stations, effort="quick")
    >>> [route.name for route in report.routes]
    ['west to middle']
    """
    check_choice("effort", effort, EFFORTS)
    check_integer("seed", seed, 0)
    check_threads(threads)
    source = None
    if isinstance(grid, str | os.PathLike):
        grid, source = read_map(grid)
    check_grid(grid)
    site_filter_map = check_filter_map(filter_map, grid)
    assumed = robot is None or robot.lidar is None
    robot, report_finding = equip_robot(robot), found or (lambda _: None)
    stages = split_progress(progress, [*SHARES.values()])
    steps = {
        name: scale_progress(part, size)
        for part, (name, size) in zip(stages, SHARES.items(), strict=True)
    }
    map_faults = faults(grid, source)
    map_faults.check_is_no_mask()
    report_finding(in_short.format_faults(map_faults))
    reading, paths = _read_map_and_plan_routes(
        grid, source, robot, stations, EFFORTS[effort].routes, seed
    )
    drives = analyze_recordings(recordings, reading, map_faults, robot, filter_map, seed, threads)
    for sentence in drives.sentences:
        report_finding(sentence)
    for fault in drives.faults:
        if fault not in map_faults:
            report_finding(f"map: {fault.sentence}")
    if filter_map is not None:  # the filter does not read the map's file
        reading = replace(reading, reasons=(), is_sure=False)
    if drives.stretch != 1:
        reading = reading.with_scale(drives.stretch)
    site = Site(reading.grid, site_filter_map, drives.robot, paths, drives.stretch)
    field, costs, spots = _compute_field_and_spots(site, threads, steps["field"])
    report_finding(in_short.format_spots(spots))
    trials = FixTrials(site, EFFORTS[effort], drives, seed, threads)
    baseline = trials.drive_baseline(spots, steps["baseline"])
    report_finding(in_short.format_baseline(baseline.rates))
    results = []
    for result in trials.try_fixes(
        reading, drives.faults.repaired_map, costs, field, steps["fixes"]
    ):
        results.append(result)
        if is_better(result):
            report_finding(in_short.format_fix(result, baseline.rates))
    before, after, confirmed = trials.combine(results, steps["together"])
    return Check(
        grid=grid,
        faults=drives.faults,
        degenerate=float((costs.u[site.world.free] >= 0.5).mean()),
        spots=explain_spots(baseline.spots, drives.faults, results),
        routes=baseline.routes,
        baseline=baseline.rates,
        passage=baseline.passage,
        fixes=tuple(rank_fixes(results)),
        recommended=trials.recommended_kinds,
        before=before,
        after=after,
        confirmed=confirmed,
        recorded=drives.sentences,
        findings=drives.findings,
        preset_choice=trials.preset_choice,
        site=site,
        fixed_site=apply_fixes(trials.fixes_by_kind, trials.recommended_kinds, site),
        source=source,
        reading=reading,
        artifacts={kind: trials.fixes_by_kind[kind].artifact for kind in trials.recommended_kinds},
        assumed=assumed,
        effort=effort,
        seed=seed,
    )


def _read_map_and_plan_routes(
    grid: OccupancyGrid,
    source: MapSource | None,
    robot: Robot,
    stations: Stations | None,
    count: int,
    seed: int,
) -> tuple[MapReading, dict[str, Path]]:
    """How the map's file should be read, and the routes on it."""
    reading = MapReading.from_source(grid, source)
    try:
        return reading, plan_routes(Costmap.blank(reading.grid, robot=robot), stations, count, seed)
    except LocplanError:
        if not reading.is_sure:
            raise
        # If the robot fits only into what should be unknown, the routes are there, and the
        # corrected file is no fix: no route would be left on it.
        routes = plan_routes(Costmap.blank(grid, robot=robot), stations, count, seed)
        return MapReading(grid), routes


def _compute_field_and_spots(
    site: Site, threads: int | None, progress: ProgressCallback
) -> tuple[CovarianceField, Costmap, tuple[WeakSpot, ...]]:
    """The field, its costmap, and the weak spots."""
    lidar = site.robot.known_lidar
    config = FieldConfig(Fused(lidar), stride=COARSE_STRIDE)
    field = load_or_compute(site.world, config, threads=threads, progress=progress)
    costs = Costmap.from_field(field, robot=site.robot)
    robot_filter = site.robot.filter
    reach = robot_filter.reach(lidar) if isinstance(robot_filter, Amcl) else lidar.range
    return field, costs, find_weak_spots(costs, field, reach, site.paths)
