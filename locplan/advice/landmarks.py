"""Landmarks: choose places for objects that keep a robot localized, and verify them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.checks import (
    check_integer,
    check_position,
    check_threads,
    set_frozen_fields,
    short_repr,
)
from locplan._support.intervals import make_generator
from locplan._support.kernels.arrays import Bools, Floats
from locplan._support.output import ResultFiles
from locplan._support.progress import ProgressCallback, split_progress
from locplan._support.records import POSE, Result, Table, TableColumn
from locplan._support.tables import nan_to_none, wrap_lines
from locplan.advice.landmark_objects import (
    LandmarkObject,
    check_object,
    compute_outline_points,
    map_poses_from_world,
    mark_objects,
)
from locplan.advice.landmark_search import (
    CLEARANCE,
    LandmarkSearch,
    RobotSpace,
    find_refusal_reasons,
    format_reason_counts,
    list_candidate_places,
    poses_from_places,
)
from locplan.advice.landmark_sight import PlacementObjective, make_route_views, sample_lines
from locplan.errors import ConfigError, LocplanError
from locplan.field.config import equip_robot
from locplan.maps.files import save_map
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.zones import Zones, normalize_zones
from locplan.planning.costmap import Costmap
from locplan.planning.metrics import crosses_no_go
from locplan.planning.path import Path
from locplan.planning.plans import plan
from locplan.robots.robot import Robot
from locplan.simulation.driver import drive_open
from locplan.simulation.drives import (
    RATE_COLUMNS,
    Drives,
    RateProperties,
    check_drive_count,
    format_rates,
)
from locplan.simulation.simulator import Simulator
from locplan.simulation.verdict import DriveSet, Verdict, compare_drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure


DRIVES = 100
"""Number of drives along each route by default."""
DRIVE_COLUMNS = (
    TableColumn("drives", title="drives", digits=0, value=lambda outcome: outcome.n_drives),
    *RATE_COLUMNS,
    TableColumn("rmse", "m", "error, all drives", interval=True),
    TableColumn("kept_rmse", "m", "of those never lost", interval=True),
)


@dataclass(frozen=True, eq=False, repr=False)
class VerificationDrives(RateProperties):
    """Drives along all routes with the same objects, or with random sets of objects."""

    drives: tuple[Drives, ...]
    """Drives of each route and set."""

    @property
    def n_drives(self) -> int:
        """Number of drives."""
        return len(self.lost)

    @property
    def lost(self) -> Bools:
        """True for each drive that was lost, (n_drives,)."""
        return np.concatenate([route_drives.lost for route_drives in self.drives])

    @property
    def mean_squares(self) -> Floats:
        """Mean square of each drive's position error, (n_drives,) [m^2]."""
        return np.concatenate([route_drives.mean_squares for route_drives in self.drives])

    @property
    def off_at_end(self) -> Bools:
        """True for each drive that is off at the end, (n_drives,)."""
        return np.concatenate([route_drives.off_at_end for route_drives in self.drives])

    def __repr__(self) -> str:
        return f"VerificationDrives({self.n_drives} drives, {format_rates(self)})"


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """Drives without landmarks, with them, and with as many objects at random places."""

    before: VerificationDrives
    """Drives without landmarks."""
    after: VerificationDrives
    """Drives with them."""
    random: VerificationDrives | None
    """Drives with objects at random places; None if no other places are allowed."""
    profiles: Mapping[str, tuple[Drives, Drives]]
    """Drives of each route before and after."""
    seed: int
    """Seed of all random numbers."""

    def __repr__(self) -> str:
        return f"Verification({self.verdict})"

    @cached_property
    def comparison(self) -> Verdict:
        """The verdict on the drives with landmarks, compared with drives without."""
        return compare_drives(
            *(DriveSet.from_drives(drive_group.drives) for drive_group in (self.before, self.after))
        )

    @property
    def word(self) -> str:
        """The verdict: "better", "worse", "no difference" or "undecided"."""
        return self.comparison.word

    @property
    def has_no_losses(self) -> bool:
        """True if at most 2 % of the drives were lost before and after."""
        return max(self.before.lost_rate.value, self.after.lost_rate.value) <= 0.02

    @property
    def verdict(self) -> str:
        """The verdict with its figures, in one line."""
        before, after, random = self.before, self.after, self.random
        lost = before.lost_rate.value
        error = f"{before.rmse.value:.2f} -> {after.rmse.value:.2f} m"
        if self.has_no_losses:
            lost_text = f"{lost:.0%} of the drives were" if lost else "no drive was"
            sentence = f"{self.word}: {lost_text} lost to begin with; error {error}"
            return sentence + (f", {random.rmse.value:.2f} m at random places" if random else "")
        sentence = f"{self.word}: {lost:.0%} of the drives lost before,"
        sentence += f" {after.lost_rate.value:.0%} after"
        sentence += f", {random.lost_rate.value:.0%} at random places" if random else ""
        return f"{sentence}; error {error}"

    def table(self) -> Table:
        """Return the table of drives on each map: rates and errors."""
        drive_groups = {"none": self.before, "proposed": self.after}
        if self.random:
            drive_groups["as many at random"] = self.random
        rows = zip(
            drive_groups, Table.from_records(DRIVE_COLUMNS, drive_groups.values()).rows, strict=True
        )
        return Table(
            (TableColumn("world", title="landmarks"), *DRIVE_COLUMNS),
            tuple((name, *row) for name, row in rows),
        )


PAYING_SHARE = 0.05
"""Minimum share by which a useful landmark lowers the expected deviation."""
EXPECTED_DEVIATION = TableColumn("expected_deviation", "m", "expected deviation", 3)
LANDMARK_COLUMNS = (
    TableColumn("number", title="landmark", digits=0),
    *POSE,
    TableColumn("kind"),
    TableColumn("length", "m"),
    TableColumn("width", "m"),
    TableColumn("gain"),
    EXPECTED_DEVIATION,
)
"""Columns of landmarks; a pole's length and width are its diameter."""
POLE_COLUMNS = tuple(
    replace(column, title=None) if column.name == "heading" else column
    for column in LANDMARK_COLUMNS
)
"""Columns of poles, whose heading is in files only."""


@dataclass(frozen=True, eq=False)
class PlacementSetting:
    """The input of a placement: map, kind of object, routes, and robot."""

    grid: OccupancyGrid
    """The map without the objects."""
    kind: LandmarkObject
    """The kind of object."""
    routes: Mapping[str, Path]
    """Routes of the robot by name."""
    is_planned: bool
    """True if the routes are shortest paths, to be planned again among the objects."""
    robot: Robot
    """The robot that was simulated."""
    zones: Zones = field(default_factory=Zones)
    """The zones; no-go zones have neither objects nor planned routes."""

    def replan_routes(self, grid: OccupancyGrid) -> Mapping[str, Path]:
        """Return the user's paths, or the shortest paths between the places on a map.

        Parameters
        ----------
        grid : OccupancyGrid
            The map, with landmarks or without.

        Raises
        ------
        LocplanError
            If the landmarks block a route.
        """
        if not self.is_planned:
            return self.routes
        costs = Costmap.blank(grid, robot=self.robot, zones=self.zones)
        paths = {}
        for name, path in self.routes.items():
            (x0, y0), (x1, y1) = path.xy[[0, -1]].tolist()
            new_path = plan(costs, (x0, y0), (x1, y1)).path
            if new_path is None:
                raise LocplanError(
                    f"no path of the robot leads along {name} on the map"
                    f" {'with' if grid is not self.grid else 'without'} landmarks"
                )
            paths[name] = new_path
        return paths


@dataclass(frozen=True, eq=False, repr=False)
class Landmarks(Result):
    """Result of `place_landmarks`: places of equal objects, in order of gain."""

    files: ClassVar[ResultFiles] = ResultFiles(
        "landmarks",
        (
            "landmarks.json",
            "landmarks.png",
            "landmarks.csv",
            "landmarks.geojson",
            "verification.csv",
            "map_with_landmarks.yaml",
            "map_with_landmarks.pgm",
        ),
        purposes={
            "landmarks.csv": "where each object goes",
            "map_with_landmarks.yaml": "the map with the objects",
            "landmarks.geojson": "the outlines, for QGIS",
            "landmarks.png": "the picture",
            "verification.csv": "the drives that verify them",
        },
    )

    setting: PlacementSetting
    """The map, the routes and the robot that they are placed for."""
    poses: Floats
    """World x, y and heading of each, (k, 3) [m, m, rad]."""
    curve: Floats
    """Expected mean of P_xx + P_yy along the routes with 0, 1, ... landmarks, (k + 1,) [m^2]."""
    search: LandmarkSearch
    """The search, for places at random."""

    grid: OccupancyGrid = field(init=False)
    """The map with the landmarks."""

    def __post_init__(self) -> None:
        set_frozen_fields(self, grid=mark_objects(self.setting.grid, self.setting.kind, self.poses))

    def __repr__(self) -> str:
        low, high = self.expected_deviations[-1], self.expected_deviations[0]
        return (
            f"Landmarks({len(self)} x {self.setting.kind.title} in {self.grid.name or 'map'},"
            f" {EXPECTED_DEVIATION.title} {high:.3g} -> {low:.3g})"
        )

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def positions(self) -> Floats:
        """World x and y of each landmark, (k, 2) [m]."""
        return np.asarray(self.poses[:, :2])

    @property
    def gains(self) -> Floats:
        """Decrease of the curve by each landmark, (k,) [m^2]."""
        return -np.diff(self.curve)

    @property
    def expected_deviations(self) -> Floats:
        """Expected deviation of the position along routes, the root of the curve, (k + 1,) [m]."""
        return np.asarray(self.curve**0.5)

    @property
    def n_useful(self) -> int:
        """Number of useful landmarks.

        Each further one lowers the expected deviation by less than 5 %.
        """
        steps = 1 - self.expected_deviations[1:] / np.maximum(self.expected_deviations[:-1], 1e-12)
        paying = np.flatnonzero(steps >= PAYING_SHARE)
        return int(paying[-1]) + 1 if paying.size else 0

    @property
    def advice(self) -> str:
        """Sentence on landmarks with little effect; empty if all are useful."""
        little = f"lowers the expected deviation by less than {100 * PAYING_SHARE:.0f} %"
        if self.n_useful == 0:
            return f"Each landmark {little}."
        if self.n_useful < len(self):
            return f"From number {self.n_useful + 1} on, each {little}: {self.n_useful} may do."
        return ""

    def table(self) -> Table:
        """Return the table of landmarks in order of gain, with the expected deviations."""
        kind, shape = self.setting.kind, self.setting.kind.shape
        object_values = kind.word, 2 * shape.half_length, 2 * shape.half_width
        values = self.poses.tolist(), self.gains.tolist(), self.expected_deviations[1:].tolist()
        rows = enumerate(zip(*values, strict=True), 1)
        return Table(
            POLE_COLUMNS if self.setting.kind.word == "pole" else LANDMARK_COLUMNS,
            tuple((n, *pose, *object_values, gain, expected) for n, (pose, gain, expected) in rows),
        )

    def _write(self, folder: FilePath, verification: Verification | None = None) -> None:
        table = self.table()
        table.write_csv(folder / "landmarks.csv")
        outlines = (compute_outline_points(self.setting.kind.shape, pose) for pose in self.poses)
        table.write_geojson(folder / "landmarks.geojson", outlines)
        if verification:
            verification.table().write_csv(folder / "verification.csv")
        save_map(self.grid, folder / "map_with_landmarks.yaml")

    def summary(self, verification: Verification | None = None) -> dict[str, object]:
        """Return places, gains and settings as plain data for JSON.

        Parameters
        ----------
        verification : Verification, optional
            The result of `verify_landmarks`.
        """
        setting = self.setting
        return nan_to_none(
            {
                "verification": verification
                and {
                    "verdict": verification.word,
                    "sentence": verification.verdict,
                    "ratio": list(verification.comparison.ratio),
                    "drives": verification.table().records(),
                    "seed": verification.seed,
                },
                "map": {"name": setting.grid.name, "digest": setting.grid.digest},
                "map_with_landmarks": {"digest": self.grid.digest},
                "object": {"kind": setting.kind.word, **vars(setting.kind)},
                "landmarks": self.table().records(),
                EXPECTED_DEVIATION.name: self.expected_deviations.tolist(),
                "paying": self.n_useful,
                "routes": {name: path.length for name, path in setting.routes.items()},
                "robot": setting.robot.summary(),
            }
        )

    def report(self, verification: Verification | None = None) -> str:
        """Return the landmarks in order of gain, and the verdict of the drives, as text."""
        return landmarks_report(self, verification)

    def figure(self, verification: Verification | None = None) -> Figure:
        """Draw maps before and after, the expected deviation, and errors along the route.

        Parameters
        ----------
        verification : Verification, optional
            Result of `verify_landmarks`; with it the routes are coloured by the mean position
            error.
        """
        from locplan.advice.figures import landmarks_figure

        return landmarks_figure(self, verification)


def landmarks_report(landmarks: Landmarks, verification: Verification | None = None) -> str:
    """Return the landmarks in order of gain, and the verdict of the drives, as text."""
    setting = landmarks.setting
    verdict = [verification.verdict if verification else "not verified by simulated drives"]
    verdict.append(f"with {setting.robot.title}")
    gains = [
        f"{len(landmarks)} x {setting.kind.title}, in order of gain."
        f" {EXPECTED_DEVIATION.heading} without landmarks: {landmarks.expected_deviations[0]:.3f}"
    ]
    if landmarks.advice:
        gains.append(landmarks.advice)
    drives = [str(verification.table())] if verification else []
    return "\n".join([str(landmarks.table()), *wrap_lines(gains), *drives, *wrap_lines(verdict)])


MAX_PLACES = 8
"""Maximum number of places; all of them are joined by routes."""


def place_landmarks(
    grid: OccupancyGrid,
    kind: LandmarkObject,
    count: int,
    *,
    paths: Mapping[str, Path | ArrayLike] | Sequence[Path | ArrayLike] | Path | None = None,
    places: Mapping[str, Sequence[float]] | Sequence[Sequence[float]] | None = None,
    robot: Robot | None = None,
    zones: Zones | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Landmarks:
    """Choose places for objects that keep a robot from getting lost on its routes.

    The choice is greedy: each place minimizes the mean of P_xx + P_yy along the routes. P is the
    covariance of an information filter with the noise of the robot's filter. `verify_landmarks`
    tests the objects by simulated drives.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    kind : Pole or Box
        The object.
    count : int
        Number of objects, 1 to 200. There are fewer if no further one helps, or may stand.
    paths : Path, or mapping of str to Path or to (n, 2) array, optional
        Routes of the robot in the world [m], within the free cells. It drives just these.
    places : sequence of (x, y), or mapping of str to (x, y), optional
        Instead of paths: the robot drives the shortest paths between all of these, 2 to 8 [m],
        planned again among the objects.
    robot : Robot, optional
        The robot, for example from `Robot.load`. By default it has Nav2's filter and a lidar of
        6 m that sees all round.
    zones : Zones, optional
        The zones: no object stands in a no-go zone, and no route leads through it.
    threads : int, optional
        Number of threads, at least 1; all cores by default. The result does not depend on it.
    progress : callable, optional
        Called with (done, total) objects.

    Returns
    -------
    Landmarks
        The places in order of gain, and the map with the objects.

    Raises
    ------
    LocplanError
        If an argument is out of its range, a path leaves the free cells, or no object may stand
        anywhere.

    See Also
    --------
    verify_landmarks : Drives before, after, and with as many objects at random places.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> route = Path(np.array([[6.0, 3.0], [30.0, 3.0]]))
    >>> robot = locplan.Robot().with_settings({"laser_model_type": "likelihood_field_prob"})
    >>> made = place_landmarks(grid, locplan.advice.Pole(0.2), 2, paths=route, robot=robot)
    >>> made.poses.shape, bool(made.curve[2] < made.curve[1] < made.curve[0])
    ((2, 3), True)
    """
    check_grid(grid)
    check_object(kind)
    check_integer("count", count, 1, 200)
    robot = equip_robot(robot)
    threads = check_threads(threads)
    if (paths is None) == (places is None):
        raise ConfigError("give either paths or places")
    zones = normalize_zones(zones)
    routes = parse_routes(grid, paths, places, robot.radius, zones)
    search = _prepare_search(grid, kind, routes, robot, zones, threads)
    place_numbers, curve = search.select_places(count, progress)
    setting = PlacementSetting(grid, kind, routes, paths is None, robot, zones)
    return Landmarks(setting, poses_from_places(grid, search.places[place_numbers]), curve, search)


def _prepare_search(
    grid: OccupancyGrid,
    kind: LandmarkObject,
    routes: Mapping[str, Path],
    robot: Robot,
    zones: Zones,
    threads: int,
) -> LandmarkSearch:
    """Return the search among the allowed places that the robot can see from its routes.

    Raises
    ------
    LocplanError
        If a path leaves the free cells, or there is no such place.
    """
    from scipy.spatial import cKDTree

    lines = sample_lines(grid, routes, robot)
    robot_space = RobotSpace(grid, kind.shape, robot.radius, CLEARANCE)
    route_views = make_route_views(grid, lines, kind.shape, robot)
    keep, closed = robot.radius + CLEARANCE, zones.cells(grid, "no-go")
    candidates = list_candidate_places(grid, kind.shape, routes.values(), keep)
    robots = cKDTree(map_poses_from_world(grid, np.concatenate(lines))[:, :2])
    within = (route_views.rays.max_range + kind.shape.outer_radius) / grid.resolution
    candidates = candidates[
        np.isfinite(robots.query(candidates[:, :2], distance_upper_bound=within)[0])
    ]
    clear_of = [path.resample(grid.resolution / 2).xy for path in routes.values()]
    at = np.column_stack(grid.world_to_grid(*np.concatenate(clear_of).T))
    reasons = find_refusal_reasons(candidates, grid, robot_space, at, keep, closed)
    allowed = np.array([not reason for reason in reasons], bool)
    if not allowed.any():
        raise ConfigError(
            f"no {kind.title} may stand within the lidar's range of the robot:"
            f" {format_reason_counts(reasons)}. Use a smaller object or smaller no-go zones"
        )
    return LandmarkSearch(
        PlacementObjective(grid, route_views, kind.shape, candidates[allowed], threads), robot_space
    )


def parse_routes(
    grid: OccupancyGrid, paths: Any, places: Any, robot_radius: float, zones: Zones
) -> dict[str, Path]:
    """Return routes by name: the user's paths, or the shortest paths between places.

    Raises
    ------
    ConfigError
        If paths or places are not valid.
    LocplanError
        If the robot cannot stand at a place, or no path joins two.
    """
    if paths is not None:
        raw_paths = {"path": paths} if isinstance(paths, Path) else paths
        values_by_name = _name_values_by_number(raw_paths, "path", "paths by name")
        if not values_by_name:
            raise ConfigError("there are no paths. Give at least one path for the landmarks")
        routes = {
            str(name): path if isinstance(path, Path) else Path(np.asarray(path))
            for name, path in values_by_name.items()
        }
        for name, path in routes.items():
            if crosses_no_go(zones, grid, path):
                raise ConfigError(f"path {name} crosses a no-go zone; change the path or the zone")
        return routes
    values_by_name = _name_values_by_number(places, "place", "positions x, y in metres")
    if not 2 <= len(values_by_name) <= MAX_PLACES:
        raise ConfigError(
            f"there must be 2 to {MAX_PLACES} places, not {len(values_by_name)}. Give more routes"
            " as paths"
        )
    ends = {
        str(name): check_position(xy, name=f"place {name}") for name, xy in values_by_name.items()
    }
    costs = Costmap.blank(grid, robot=robot_radius, zones=zones)
    for name, xy in ends.items():
        costs.find_cell(xy, name)
    routes = {}
    for (first, start), (second, goal) in combinations(ends.items(), 2):
        shortest = plan(costs, start, goal).path
        if shortest is None:
            raise LocplanError(f"no path leads from {first} to {second}. Name connected places")
        routes[f"{first} to {second}"] = shortest
    return routes


def _name_values_by_number(values: Any, word: str, requirement: str) -> Mapping[Any, Any]:
    """Return a mapping as it is, or values named by numbers from 1."""
    if isinstance(values, Mapping):
        return values
    if not isinstance(values, Iterable) or isinstance(values, str):
        raise ConfigError(f"{word}s must be {requirement}, not {short_repr(values)}")
    return {f"{word} {n}": value for n, value in enumerate(values, 1)}


def verify_landmarks(
    landmarks: Landmarks,
    drives: int = DRIVES,
    *,
    random_sets: int = 5,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Verification:
    """Simulate drives without landmarks, with them, and with as many objects at random places.

    Routes that were planned between places are planned again among the objects.

    Parameters
    ----------
    landmarks : Landmarks
        The landmarks, with the map, the robot and the routes.
    drives : int, default 100
        Number of drives along each route, 2 to 100,000; all random sets together have as many.
    random_sets : int, default 5
        Number of sets of random places, 1 to 1000.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    Verification
        Share of lost drives and errors on each map, and a verdict.

    Raises
    ------
    ConfigError
        If a number is out of its range.
    """
    check_drive_count(drives)
    check_integer("random_sets", random_sets, 1, 1000)
    setting = landmarks.setting
    random_maps = _make_random_maps(landmarks, min(random_sets, drives // 2), seed)
    n_random = drives // max(len(random_maps), 1)
    maps = [setting.grid, landmarks.grid, *random_maps]
    counts = [drives, drives, *[n_random] * len(random_maps)]
    callbacks = split_progress(progress, [count * len(setting.routes) for count in counts])
    outcomes = []
    for grid, count, report in zip(maps, counts, callbacks, strict=True):
        simulator = Simulator(grid, setting.robot, seed=seed, threads=threads)
        drives_by_route = drive_open(
            simulator, setting.replan_routes(grid), range(count), progress=report
        )
        outcomes.append(VerificationDrives(tuple(drives_by_route.values())))
    before, after, *at_random = outcomes
    pooled = VerificationDrives(
        tuple(line_drives for outcome in at_random for line_drives in outcome.drives)
    )
    pairs = zip(before.drives, after.drives, strict=True)
    profiles = dict(zip(setting.routes, pairs, strict=True))
    return Verification(before, after, pooled if at_random else None, profiles, seed)


def _make_random_maps(landmarks: Landmarks, n_sets: int, seed: int) -> list[OccupancyGrid]:
    """Return maps with objects at random places; none if too few places are allowed."""
    grid, kind, search = landmarks.setting.grid, landmarks.setting.kind, landmarks.search
    # Stream of random numbers of places at random, next to those of `Simulator`.
    choices = [
        search.draw_random_places(len(landmarks), make_generator(seed, 100, n))
        for n in range(n_sets)
    ]
    if not all(choices):
        return []
    poses = [poses_from_places(grid, search.places[choice]) for choice in choices]
    return [mark_objects(grid, kind, object_poses) for object_poses in poses]
