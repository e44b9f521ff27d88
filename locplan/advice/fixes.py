"""Fixes of a scenario: changes that may let the robot localize better."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

from locplan._support.kernels.arrays import Floats
from locplan._support.progress import ProgressCallback
from locplan.advice.driving import Scenario, ScenarioRunner
from locplan.advice.landmark_objects import Pole, mark_objects
from locplan.advice.landmarks import place_landmarks
from locplan.advice.map_reading import MapCorrection
from locplan.advice.preset_choice import PresetChoice
from locplan.advice.trials import WORTHWHILE, DrivesOnRoutes
from locplan.errors import ConfigError
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.planning.plans import plan
from locplan.robots.amcl import Amcl
from locplan.robots.presets import with_preset
from locplan.simulation.recommendation import Recommendation

POLES = 3
"""Number of poles to place if the cheaper fixes do not suffice."""
CORRECTED_MAP, REPAIRED_MAP, FULL_RANGE = "walls", "map", "range"
SETTINGS, PATHS, LANDMARKS = "settings", "paths", "landmarks"
"""The kinds of fixes."""
CHEAP = CORRECTED_MAP, REPAIRED_MAP, FULL_RANGE, SETTINGS
"""Kinds of fixes that only change a file or a parameter."""
KINDS = (*CHEAP, PATHS, LANDMARKS)
"""All kinds by effort. Fixes of a cause come before fixes that compensate for it."""


@dataclass(frozen=True)
class Fix:
    """A change that may help, with a function that applies it to a scenario."""

    kind: str
    """One of the kinds above."""
    title: str
    """The fix in a few words."""
    detail: str
    """What exactly is changed."""
    effort: str
    """The work that the fix takes."""
    apply: Callable[[Scenario], Scenario]
    """Returns a scenario with the fix applied."""
    is_certain: bool = False
    """True if it is recommended even if no drive improves."""
    artifact: Any = None
    """Data for its files: a mask's costmap, or placed poles."""


def iterate_fixes(
    scenario: Scenario, correction: MapCorrection, repaired_map: OccupancyGrid
) -> Iterator[Fix]:
    """Yield the applicable fixes of the map and of the robot's range.

    Parameters
    ----------
    scenario : Scenario
        The scenario.
    reading : Reading
        The corrections of the map's file.
    repaired_map : OccupancyGrid
        The repaired map for the filter.
    """
    if correction.reasons:
        yield Fix(
            *(CORRECTED_MAP, "corrected map file", correction.title, "the map's YAML"),
            lambda old: replace(old, filter_map=correction.grid, stretch=1.0),
            is_certain=correction.is_certain,
        )
    if repaired_map not in (correction.grid, scenario.filter_map):
        yield Fix(
            *(
                REPAIRED_MAP,
                "repaired map",
                "the repaired map for the filter",
                "a second map server",
            ),
            lambda old: replace(old, filter_map=repaired_map),
        )
    robot_filter = scenario.robot.filter
    if (
        isinstance(robot_filter, Amcl)
        and robot_filter.compute_max_range(scenario.robot.known_lidar)
        < scenario.robot.known_lidar.range
    ):
        full_range = Amcl().laser_max_range
        yield Fix(
            *(FULL_RANGE, "full lidar range", f"laser_max_range {full_range:g}", "one parameter"),
            lambda old: with_filter_settings(
                old, replace(old.robot.amcl, laser_max_range=full_range)
            ),
        )


def with_filter_settings(scenario: Scenario, amcl: Amcl) -> Scenario:
    """Return a scenario with these settings of the filter.

    Parameters
    ----------
    scenario : Scenario
        The scenario.
    amcl : Amcl
        The settings.
    """
    return replace(scenario, robot=replace(scenario.robot, filter=amcl))


def make_preset_fix(choice: PresetChoice) -> Fix | None:
    """Return the fix of the preset to use; None if the user's settings stay.

    Parameters
    ----------
    choice : PresetChoice
        The choice among the presets. If recordings decided, simulated drives do not overrule it.
    """
    if not choice.is_preset:
        return None
    return Fix(
        *(SETTINGS, f"{choice.name} settings", choice.changes, "a parameter file"),
        lambda old: with_filter_settings(old, with_preset(old.robot.amcl, choice.name)),
        is_certain=bool(choice.recordings),
    )


def choose_paths_fix(
    scenario: Scenario,
    recommendations: Mapping[str, Recommendation],
    score_scenario: Callable[[Scenario], float],
) -> Fix | None:
    """Return the better of two fixes: following the recommended paths, or a keepout mask.

    Parameters
    ----------
    scenario : Scenario
        The scenario.
    recommendations : mapping of str to Recommendation
        The recommendation of each route by its name, with costmaps.
    score_scenario : callable
        Simulates a scenario and returns its score; less is better.
    """
    useful_recommendations = {
        name: recommendation
        for name, recommendation in recommendations.items()
        if recommendation.path and recommendation.best > 0
    }
    paths_by_route = {
        name: recommendation.path
        for name, recommendation in useful_recommendations.items()
        if recommendation.path
    }
    if not paths_by_route:
        return None
    best = _make_paths_fix(scenario, paths_by_route, "other paths", "routes for Nav2")
    # A mask covers all routes, so that it may score slightly worse than fixed routes.
    best_score = score_scenario(best.apply(scenario)) - math.log(WORTHWHILE)
    for recommendation in useful_recommendations.values():
        mask = recommendation.costmap()
        ways = {name: plan(mask, *path.xy[[0, -1]]).path for name, path in scenario.paths.items()}
        usable_paths = {name: path for name, path in ways.items() if path and path.length}
        if len(usable_paths) < len(ways):
            continue
        mask_fix = _make_paths_fix(
            scenario, usable_paths, "a keepout mask, other paths", "a mask for Nav2", mask
        )
        if (mask_score := score_scenario(mask_fix.apply(scenario))) < best_score:
            best, best_score = mask_fix, mask_score
    return best


def _make_paths_fix(
    scenario: Scenario,
    paths: Mapping[str, Path],
    subject: str,
    effort: str,
    mask: Costmap | None = None,
) -> Fix:
    """Return the fix that changes paths; paths of unchanged length count as unchanged."""
    longer = {name: path.length - scenario.paths[name].length for name, path in paths.items()}
    changed = {
        name: paths[name] for name, extra_length in longer.items() if abs(extra_length) > 0.01
    }
    extra_length = sum(longer.values()) / max(1, len(changed))
    detail = f"{subject} on {len(changed)} of {len(scenario.paths)} routes, {extra_length:+.1f} m"
    title = "keepout mask" if mask else "other paths"

    def apply(old: Scenario) -> Scenario:
        return replace(old, paths={**old.paths, **changed})

    return Fix(PATHS, title, detail, effort, apply, artifact=mask)


class PolePlacement(NamedTuple):
    """Poles placed on a map."""

    poses: Floats
    """World x, y and heading of each, (n, 3) [m, m, rad]."""
    grid: OccupancyGrid
    """The map with them."""


def make_poles_fix(scenario: Scenario, threads: int | None) -> Fix | None:
    """Return the fix of three poles next to the routes; None if no pole helps or fits.

    Parameters
    ----------
    scenario : Scenario
        The scenario.
    threads : int or None
        Number of threads.
    """
    kind = Pole(max(0.2, 2 * scenario.world.resolution))
    try:
        poses = place_landmarks(
            scenario.world,
            kind,
            POLES,
            paths=scenario.paths,
            robot=scenario.robot,
            threads=threads,
        ).poses
    except ConfigError:
        return None
    if not len(poses):
        return None

    def apply(old: Scenario) -> Scenario:
        world = mark_objects(old.world, kind, poses)
        same = old.filter_map is old.world
        filter_map = world if same else mark_objects(old.filter_map, kind, poses)
        return replace(old, world=world, filter_map=filter_map)

    poles = PolePlacement(poses, mark_objects(scenario.world, kind, poses))
    count = f"{len(poses)} poles"
    return Fix(LANDMARKS, count, f"{count} next to the routes", count, apply, artifact=poles)


def apply_fixes(
    fixes_by_kind: Mapping[str, Fix], kinds: tuple[str, ...], scenario: Scenario
) -> Scenario:
    """Return a scenario with several fixes; the map file is corrected before it is repaired."""
    for kind in sorted(kinds, key=KINDS.index):
        scenario = fixes_by_kind[kind].apply(scenario)
    return scenario


class ScenarioDriver(Protocol):
    """Function that simulates the drives of some numbers in a scenario."""

    def __call__(
        self, scenario: Scenario, numbers: range, progress: ProgressCallback | None = None
    ) -> DrivesOnRoutes: ...


def make_scenario_runner(seed: int, threads: int | None) -> ScenarioDriver:
    """Return a function that simulates scenarios and caches each drive."""
    outcomes: dict[str, dict[int, DrivesOnRoutes]] = defaultdict(dict)

    def drive(
        scenario: Scenario, numbers: range, progress: ProgressCallback | None = None
    ) -> DrivesOnRoutes:
        drives_by_number = outcomes[scenario.digest]
        new = [number for number in numbers if number not in drives_by_number]
        if new:
            missing = range(new[0], new[-1] + 1)
            new_outcomes = ScenarioRunner(scenario, seed, threads)(missing, progress)
            for place, number in enumerate(missing):
                drives_by_number[number] = new_outcomes.select(drives=slice(place, place + 1))
        return DrivesOnRoutes.join([drives_by_number[number] for number in numbers])

    return drive
