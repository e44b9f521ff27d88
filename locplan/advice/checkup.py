"""`check`: find the failures of a robot on a map, and the fixes that help."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from dataclasses import replace

from locplan._support.checks import check_choice, check_integer, check_threads
from locplan._support.progress import ProgressCallback, scale_progress, split_progress
from locplan.advice import text
from locplan.advice.check_drives import EFFORTS, FixTrials
from locplan.advice.check_result import Check, explain_spots
from locplan.advice.driving import Scenario
from locplan.advice.fixes import apply_fixes
from locplan.advice.map_reading import MapCorrection
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

LOG = logging.getLogger(__name__)
STAGE_SHARES = {"field": 200, "baseline": 150, "fixes": 450, "together": 200}
"""Share of the total work of each stage, in thousandths."""


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
    progress: ProgressCallback | None = None,
) -> Check:
    """Find a robot's failures on a map, and the fixes that help, by simulated drives.

    `check` finds the map's faults and weak spots, and simulates the robot with its filter along
    routes, in open loop and in closed loop. It then simulates each applicable fix on the same
    routes, in the same worlds: the corrected map file, the repaired map, AMCL presets, the lidar's
    full range, recommended paths or a mask, and landmarks if the robot still gets lost. It combines
    fixes until neither lost drives nor the error fall further. Fresh drives alone decide about the
    combination. If robots fail even with perfect localization, the result names the passage. The
    log has each finding as soon as it is known, at level INFO.

    AMCL settings are the presets of `locplan.robots.presets`. Without a recording, a preset is
    recommended only if it does no significant harm at any level of disturbance, see
    `locplan.simulation.levels`. With one, settings are recommended that hold on the recording.

    Parameters
    ----------
    grid : OccupancyGrid, str or path
        The map, or its file; for a file, thresholds and grey levels are checked as well.
    robot : Robot, optional
        The robot, for example from `Robot.load`. By default it has Nav2's filter and a lidar of
        6 m that sees all round.
    stations : path, mapping or sequence, optional
        The places to drive between: a CSV file of name, x, y [m], or of queries; positions by
        name; or (start, goal) pairs. By default places far apart in each room.
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
        Number of drives: 32, without recommended paths and landmarks; 96, which measure the share
        of lost drives to 10 points; or 288.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal results, on any number of threads.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
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
    >>> robot = robot.with_settings({"min_particles": 100, "max_particles": 100})
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
    checked_filter_map = check_filter_map(filter_map, grid)
    equipped_robot = equip_robot(robot)  # raises for anything but a robot
    is_lidar_assumed = robot is None or robot.lidar is None
    robot = equipped_robot
    stages = split_progress(progress, [*STAGE_SHARES.values()])
    steps = {
        name: scale_progress(part, size)
        for part, (name, size) in zip(stages, STAGE_SHARES.items(), strict=True)
    }
    map_faults = faults(grid, source)
    map_faults.check_is_no_mask()
    correction, paths = _read_map_and_plan_routes(
        grid, source, robot, stations, EFFORTS[effort].max_routes, seed
    )
    LOG.info(text.format_fault_finding(map_faults))
    drives = analyze_recordings(
        recordings, correction, map_faults, robot, filter_map, seed, threads
    )
    for sentence in drives.sentences:
        LOG.info(sentence)
    for fault in drives.faults:
        if fault not in map_faults:
            LOG.info(f"map: {fault.sentence}")
    map_faults = drives.faults
    if filter_map is not None:  # the filter does not read the map's file
        correction = replace(correction, reasons=(), is_certain=False)
        map_faults = map_faults.without_repair_remedies()
    if drives.stretch != 1:
        correction = correction.with_scale(drives.stretch)
    scenario = Scenario(correction.grid, checked_filter_map, drives.robot, paths, drives.stretch)
    field, costs, spots = _compute_field_and_spots(scenario, threads, steps["field"])
    LOG.info(text.format_spots(spots))
    trials = FixTrials(scenario, EFFORTS[effort], drives, seed, threads)
    baseline = trials.drive_baseline(spots, steps["baseline"])
    LOG.info(text.format_baseline(baseline.rates))
    results = []
    for result in trials.try_fixes(
        correction, drives.faults.repaired_map, costs, field, steps["fixes"]
    ):
        results.append(result)
        if is_better(result):
            LOG.info(text.format_fix(result, baseline.rates))
    before, after, confirmed = trials.combine_fixes(results, steps["together"])
    return Check(
        grid=grid,
        faults=map_faults,
        degenerate_share=float((costs.u[scenario.world.free] >= 0.5).mean()),
        spots=explain_spots(baseline.spots, drives.faults, results),
        routes=baseline.routes,
        baseline=baseline.rates,
        passage=baseline.passage,
        fixes=tuple(rank_fixes(results)),
        recommended=trials.recommended_kinds,
        before=before,
        after=after,
        confirmation=confirmed,
        recording_sentences=drives.sentences,
        recording_findings=drives.findings,
        preset_choice=trials.preset_choice,
        scenario=scenario,
        fixed_scenario=apply_fixes(trials.fixes_by_kind, trials.recommended_kinds, scenario),
        source=source,
        correction=correction,
        artifacts={kind: trials.fixes_by_kind[kind].artifact for kind in trials.recommended_kinds},
        is_lidar_assumed=is_lidar_assumed,
        effort=effort,
        seed=seed,
    )


def _read_map_and_plan_routes(
    grid: OccupancyGrid,
    source: MapSource | None,
    robot: Robot,
    stations: Stations | None,
    max_routes: int,
    seed: int,
) -> tuple[MapCorrection, dict[str, Path]]:
    """Return the corrections of the map's file, and the routes on the corrected map."""
    correction = MapCorrection.from_source(grid, source)
    try:
        return correction, plan_routes(
            Costmap.blank(correction.grid, robot=robot), stations, max_routes, seed
        )
    except LocplanError:
        if not correction.is_certain:
            raise
        # The robot fits only into space that should be unknown. The corrected file is no fix: it
        # would leave no route.
        routes = plan_routes(Costmap.blank(grid, robot=robot), stations, max_routes, seed)
        return MapCorrection(grid), routes


def _compute_field_and_spots(
    scenario: Scenario, threads: int | None, progress: ProgressCallback
) -> tuple[CovarianceField, Costmap, tuple[WeakSpot, ...]]:
    """Return the field, its costmap, and the weak spots."""
    lidar = scenario.robot.known_lidar
    config = FieldConfig(Fused(lidar), stride=COARSE_STRIDE)
    field = load_or_compute(scenario.world, config, threads=threads, progress=progress)
    costs = Costmap.from_field(field, robot=scenario.robot)
    robot_filter = scenario.robot.filter
    reach = robot_filter.compute_max_range(lidar) if isinstance(robot_filter, Amcl) else lidar.range
    return field, costs, find_weak_spots(costs, field, reach, scenario.paths)
