"""Global localization: find the poses that explain one scan, on a whole map or near a route."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.checks import (
    check_instance,
    check_integer,
    check_number,
    check_threads,
    short_repr,
)
from locplan._support.kernels.arrays import Bools, Floats, Ints, Singles
from locplan._support.output import ResultFiles
from locplan._support.poses import wrap_angles
from locplan._support.progress import ProgressCallback
from locplan._support.public import DrawableResult
from locplan._support.records import Result, Table, TableColumn
from locplan._support.tables import REPORT_WIDTH, nan_to_none
from locplan.errors import ConfigError, RecordingError
from locplan.field.covariance import position_axes
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.planning.path import Path
from locplan.recordings.matching import (
    CLEARANCE,
    MAX_MODE_EXCESS,
    MIN_RETURNS,
    MODE_DISTANCE,
    MODE_TURN,
    RangeDatabase,
    ScanDatabase,
    ScanOnMap,
    resolve_database,
    run_in_batches,
)
from locplan.recordings.recording import Recording
from locplan.robots.lidar import Lidar

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CERTAIN = 3.0
"""Minimum excess of the second place for a certain location [nats]."""
NEAR, MAX_TURN = 0.3, float(np.radians(3.0))
"""Maximum distance [m] and angle [rad] of a correct location from the recorded pose."""
AGREE = 0.5
"""Minimum share of correct locations among certain ones, and of fitting scans, to trust the map."""


def format_drive_sentence(is_certain: Bools, is_fitting: Bools, is_right: Bools | None) -> str:
    """Return a text with the number of located scans, and of correct ones among the certain ones.

    The masks are fields of `LocatedDrive`; `is_right` is None without recorded poses.
    """
    count = len(is_certain)
    limits = f"{NEAR:g} m and {np.degrees(MAX_TURN):.0f}°"
    certainty_text = f"have no alternative place within {CERTAIN:g} nats"
    if is_right is not None:
        text = (
            f"{int(is_right.sum())} of {count} scans are located within {limits} of the recorded"
            f" pose. {int(is_certain.sum())} {certainty_text};"
            f" {int((is_right & is_certain).sum())} of these are correct."
        )
        if is_certain.any() and is_right[is_certain].mean() < AGREE:
            return text + (
                " The recorded poses do not agree with the map: check their frame, and the mount of"
                " the lidar."
            )
    else:
        n_certain = int(is_certain.sum())
        text = f"{n_certain} of {count} scans {certainty_text}. The drive has no poses on the map."
    if is_fitting.mean() < AGREE:
        text += (
            f" Only {int(is_fitting.sum())} of {count} scans have most of their returns at walls:"
            " check for people, changes, or a wrong map."
        )
    return text


@dataclass(frozen=True, eq=False, repr=False)
class LocationMode:
    """A locally best pose of a scan."""

    pose: tuple[float, float, float]
    """x, y, heading in the world [m, m, rad]."""
    weight: float
    """Share of exp(-loss) among all modes, 0..1."""
    excess: float
    """Excess of the loss over the best mode, >= 0 [nats]."""
    covariance: Floats
    """Covariance of the pose in the world, (3, 3) [m, m, rad], of the posterior over +-1.5 m and
    +-4 deg around the pose, as in `match_scans`."""

    def __repr__(self) -> str:
        x, y, heading = self.pose
        return f"Mode({x:.2f},{y:.2f} m, {math.degrees(heading):.1f}°, weight {self.weight:.2f})"

    @property
    def position_std(self) -> float:
        """Largest standard deviation of the position [m]."""
        return float(position_axes(self.covariance)[0])

    @property
    def heading_std(self) -> float:
        """Standard deviation of the heading [rad]."""
        return math.sqrt(self.covariance[2, 2])


POSE = (
    TableColumn("x", "m", "x", value=lambda mode: mode.pose[0]),
    TableColumn("y", "m", "y", value=lambda mode: mode.pose[1]),
    TableColumn("heading", "rad", "heading", 1, "deg", value=lambda mode: mode.pose[2]),
)
DEVIATIONS = (
    TableColumn("position_std", "m", "std. dev.", 0, "cm"),
    TableColumn("heading_std", "rad", "std. dev.", 1, "deg"),
)
WEIGHT = TableColumn("weight", "", "weight", 0, "%")


def _make_covariance_getter(row: int, col: int) -> Callable[[LocationMode], float]:
    """Make a function that returns an entry of a mode's covariance."""
    return lambda mode: float(mode.covariance[row, col])


MODES = (
    *POSE,
    WEIGHT,
    TableColumn("excess", "nat", "worse by", 1),
    *DEVIATIONS,
    *(
        TableColumn(f"covariance_{'xyh'[row]}{'xyh'[col]}", value=_make_covariance_getter(row, col))
        for row, col in combinations_with_replacement(range(3), 2)
    ),
)


@dataclass(frozen=True, eq=False, repr=False)
class Location(DrawableResult):
    """Location of a robot by one scan: all poses that explain it. The result of `locate`."""

    grid: OccupancyGrid
    """The map."""
    lidar: Lidar
    """The lidar of the scan."""
    ranges: Floats
    """The scan: distances along the lidar's beams, (beams,) [m]; inf without a return."""
    modes: tuple[LocationMode, ...]
    """Poses that explain the scan, the best first."""
    second_excess: float
    """Excess of the second best place [nats]; infinite if there is none within 8 nats."""
    explained_share: float
    """Share of returns within two standard deviations of a wall at the best pose, 0..1."""
    is_restricted: bool
    """True if only places near a route were searched."""

    def __repr__(self) -> str:
        return f"Location({self.best!r}, second {self.second_excess:.1f} nats)"

    @property
    def best(self) -> LocationMode:
        """The pose that explains the scan best."""
        return self.modes[0]

    @property
    def is_certain(self) -> bool:
        """True if all other places have an excess of over 3 nats."""
        return self.second_excess > CERTAIN

    @property
    def fits(self) -> bool:
        """True if at least 60 % of the returns end at walls of the map at the best pose."""
        return self.explained_share >= 0.6

    @property
    def sentence(self) -> str:
        """Sentence for people: the location, or the similar places."""
        region_text = " near the route" if self.is_restricted else ""
        similar_modes = [mode for mode in self.modes if mode.excess <= CERTAIN]
        if self.is_certain:
            text = (
                f"The robot is at {_format_mode_pose(self.best)} (±"
                f" {100 * self.best.position_std:.0f} cm,"
                f" {math.degrees(self.best.heading_std):.1f}°): no other place{region_text}"
                f" explains the scan within {CERTAIN:g} nats."
            )
        elif len(similar_modes) <= 3:
            count = ("Two", "Three")[len(similar_modes) - 2]
            mode_texts = [
                f"{_format_mode_pose(mode)} ({mode.weight:.0%})" for mode in similar_modes
            ]
            place_list = f"{', '.join(mode_texts[:-1])} and {mode_texts[-1]}"
            text = f"{count} places{region_text} look alike: {place_list}."
        else:
            # The weights sum up to 1 unless modes were dropped.
            cut = sum(mode.weight for mode in self.modes) < 1 - 1e-9
            count_suffix = "or more " if cut and len(similar_modes) == len(self.modes) else ""
            text = (
                f"{len(similar_modes)} {count_suffix}places{region_text} look alike; the best,"
                f" {_format_mode_pose(self.best)}, has {self.best.weight:.0%} of the probability."
            )
        if self.fits:
            return text
        return (
            f"{text} Only {self.explained_share:.0%} of the returns end at walls there: check for"
            " people, changes, or a wrong map."
        )

    def table(self) -> Table:
        """Return a row per mode, the best first."""
        return Table.from_records(MODES, self.modes, number="place")

    def figure(self, *, recorded: ArrayLike | None = None) -> Figure:
        """Draw the map with the scan at the best mode, and all modes with numbers and weights.

        Ellipses show the standard deviations of the positions. If the robot sees only a small part
        of the map, its surroundings are drawn separately.

        Parameters
        ----------
        recorded : (3,) array, optional
            Another pose x, y, heading to draw, such as the recorded one [m, m, rad].
        """
        from locplan.recordings.figures import locate_figure

        return locate_figure(self, recorded=recorded)


def _format_mode_pose(mode: LocationMode) -> str:
    """Format the pose of a mode, without -0."""
    x, y, heading = mode.pose
    turn = round(math.degrees(heading)) + 0.0
    return f"{round(x, 2) + 0.0:.2f},{round(y, 2) + 0.0:.2f} m, {turn:.0f}°"


SCANS = (
    TableColumn("scan", title="scan", digits=0),
    TableColumn("time", "s"),
    *POSE,
    WEIGHT,
    TableColumn("second", "nat", "second", 1),
    TableColumn("explained"),
    *(replace(column, title=None) for column in DEVIATIONS),
    *(replace(column, name=f"recorded_{column.name}", title=None) for column in POSE),
    TableColumn("distance", "m", "off by", 1, "cm"),
    TableColumn("turn", "rad", "turned by", 1, "deg"),
)


@dataclass(frozen=True, eq=False, repr=False)
class LocatedDrive(Result):
    """Locations of the single scans of a recorded drive. The result of `locate_drive`."""

    files: ClassVar[ResultFiles] = ResultFiles(
        "located",
        ("located.json", "located.png", "modes.csv", "scans.csv"),
        purposes={
            "located.png": "the picture",
            "modes.csv": "the places where each scan fits",
            "scans.csv": "a row per scan",
        },
    )

    recording: Recording
    """The scans, with recorded poses if there are any."""
    grid: OccupancyGrid
    """The map."""
    locations: tuple[Location | None, ...]
    """Location of each scan; None for scans with too few returns."""

    def __repr__(self) -> str:
        if not self.recording.has_poses:
            return f"LocatedDrive({len(self)} scans, {self.is_certain.mean():.0%} certain)"
        return f"LocatedDrive({len(self)} scans, {self.is_right.mean():.0%} right)"

    def __len__(self) -> int:
        return len(self.locations)

    @property
    def single_location(self) -> Location | None:
        """The location of a drive with a single scan; otherwise None."""
        return self.locations[0] if len(self) == 1 else None

    @property
    def poses(self) -> Floats:
        """The best pose of each scan in the world, (n, 3) [m, m, rad]; NaN without a location."""
        missing_pose = (np.nan,) * 3
        return np.array(
            [
                missing_pose if scan_location is None else scan_location.best.pose
                for scan_location in self.locations
            ]
        )

    @property
    def distance(self) -> Floats:
        """Distance of each best pose from the recorded one, (n,) [m]."""
        return np.asarray(np.hypot(*(self.poses - self.recording.poses)[:, :2].T))

    @property
    def turn(self) -> Floats:
        """Angle of each best pose from the recorded one, (n,) [rad]."""
        return np.abs(wrap_angles(self.poses[:, 2] - self.recording.poses[:, 2]))

    @property
    def is_right(self) -> Bools:
        """Mask of the scans located within 0.3 m and 3 deg of the recorded pose, (n,)."""
        return np.asarray((self.distance <= NEAR) & (self.turn <= MAX_TURN))

    @property
    def is_certain(self) -> Bools:
        """Mask of the scans without an alternative place within 3 nats, (n,)."""
        return np.array(
            [
                scan_location is not None and scan_location.is_certain
                for scan_location in self.locations
            ]
        )

    @property
    def fits(self) -> Bools:
        """Mask of the scans with at least 60 % of the returns at walls of the map, (n,)."""
        return np.array(
            [scan_location is not None and scan_location.fits for scan_location in self.locations]
        )

    @property
    def sentence(self) -> str:
        """Sentence for people: how many scans are located, certain, and correct."""
        right = self.is_right if self.recording.has_poses else None
        return format_drive_sentence(self.is_certain, self.fits, right)

    def table(self) -> Table:
        """Return a row per scan: the best pose, and its distance from the recorded pose."""
        drive, unknown = self.recording, (math.nan,) * 8
        times = np.full(len(drive), np.nan) if drive.times is None else drive.times - drive.times[0]
        recorded_rows = np.column_stack([drive.poses, self.distance, self.turn]).tolist()
        rows = []
        for n, scan_location in enumerate(self.locations):
            location_values = unknown
            if scan_location is not None:
                best = scan_location.best
                location_values = (
                    *best.pose,
                    best.weight,
                    scan_location.second_excess,
                    scan_location.explained_share,
                    best.position_std,
                    best.heading_std,
                )
            rows.append((n, float(times[n]), *location_values, *recorded_rows[n]))
        return Table(SCANS, tuple(rows))

    def report(self) -> str:
        """Return the modes of a single scan, or the counts of several scans, for people."""
        if self.single_location is None:
            drive = repr(self.recording).removeprefix("Recording(").removesuffix(")")
            missing = sum(scan_location is None for scan_location in self.locations)
            missing_notes = [f"{missing} scans have too few returns."] if missing else []
            header = [f"{self.grid.name or 'map'}, {drive}", *missing_notes]
            return "\n".join(map(_wrap_text, [*header, self.sentence, *self._format_errors()]))
        modes = self.single_location.table()
        if not self.recording.has_poses:
            return f"{modes}\n{_wrap_text(self.single_location.sentence)}"
        recorded = ("recorded", *self.recording.poses[0].tolist())
        unknown = (math.nan,) * (len(modes.columns) - len(recorded))
        error_text = (
            f"The best place is {self.distance[0]:.2f} m and {math.degrees(self.turn[0]):.1f}° from"
            " the recorded pose."
        )
        table_with_recorded_pose = replace(modes, rows=(*modes.rows, (*recorded, *unknown)))
        summary = _wrap_text(f"{self.single_location.sentence} {error_text}")
        return f"{table_with_recorded_pose}\n{summary}"

    def _format_errors(self) -> list[str]:
        """Return a sentence on the errors of the correct locations; empty without any."""
        if not self.is_right.any():
            return []
        distances, turn = 100 * self.distance[self.is_right], np.degrees(self.turn[self.is_right])
        at = np.column_stack(
            [np.quantile(error_values, (0.5, 0.9)) for error_values in (distances, turn)]
        )
        median, below = (f"{distance:.1f} cm, {angle:.2f}°" for distance, angle in at)
        return [f"Errors of the correct locations: median {median}; 90 % below {below}."]

    def _write(self, folder: FilePath) -> None:
        if self.single_location:
            self.single_location.table().write_csv(folder / "modes.csv")
        else:
            self.table().write_csv(folder / "scans.csv")

    def summary(self) -> dict[str, object]:
        """Return a single scan with its modes, or the shares of several scans, for JSON."""
        map_name, drive_name = self.grid.name, self.recording.source.file
        right, certain = self.is_right, self.is_certain
        if self.single_location:
            names = ("x", "y", "heading", "distance", "turn")
            values = (*self.recording.poses[0].tolist(), self.distance[0], self.turn[0])
            recorded = dict(zip(names, map(float, values), strict=True))
            return nan_to_none(
                {
                    "map": map_name,
                    "drive": drive_name,
                    "sentence": self.single_location.sentence,
                    "certain": self.single_location.is_certain,
                    "second": self.single_location.second_excess,
                    "explained": self.single_location.explained_share,
                    "returns": int(np.isfinite(self.single_location.ranges).sum()),
                    "modes": self.single_location.table().records(),
                    "recorded": recorded,
                }
            )
        return nan_to_none(
            {
                "map": map_name,
                "drive": drive_name,
                "sentence": self.sentence,
                "scans": len(self),
                "right": float(right.mean()) if self.recording.has_poses else None,
                "certain": float(certain.mean()),
                "right_of_certain": float(right[certain].mean())
                if certain.any() and self.recording.has_poses
                else None,
                "median_distance": float(np.median(self.distance[right])) if right.any() else None,
                "median_turn": float(np.median(self.turn[right])) if right.any() else None,
            }
        )

    def figure(self) -> Figure:
        """Draw the recorded drive on the map, and whether each scan was located correctly.

        Lines connect wrongly located scans with the place where they were found. A single scan is
        drawn by `locate_figure`.
        """
        from locplan.recordings.figures import located_drive_figure

        return located_drive_figure(self)


def _wrap_text(text: str) -> str:
    """Wrap a text to the width of reports."""
    return textwrap.fill(text, REPORT_WIDTH, break_on_hyphens=False)


WITHIN = 3.0
"""Default maximum distance from a route [m]."""
COUNT = 10
"""Default maximum number of modes."""
STEPS, STEP = 5, 0.1
"""Number of steps to each side in the refinement of a mode, and their minimum length [m]."""
TURNS_ASIDE, TURN = 5, math.radians(2.0)
"""Number of turns to each side in the refinement of a mode, and their angle [rad]."""


class NotLocatedError(ConfigError):
    """Error of a scan that cannot be located."""


def locate(
    grid: OccupancyGrid,
    scan: ArrayLike | Recording,
    lidar: Lidar | None = None,
    *,
    near: Path | ArrayLike | None = None,
    within: float = WITHIN,
    count: int = COUNT,
    clearance: float = CLEARANCE,
    database: ScanDatabase | None = None,
) -> Location:
    """Locate a robot on a map by one scan.

    The scan is compared with expected scans at places 0.4 m apart throughout the map, at 96 turns.
    The best poses are refined on the map's likelihood field, at last with all beams. Beams without
    a return are ignored. The first call computes the expected scans, and later calls reuse them.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    scan : (beams,) array or Recording
        Distances along the beams [m] in the order of ``lidar.angles``, inf or 0 without a return;
        or a recording of one scan, such as ``drive[n : n + 1]``.
    lidar : Lidar, optional
        The lidar, with its mount on the robot. Omit it if the scan is a recording.
    near : Path or (n, 2) array, optional
        Search only along this path, or near these positions in the world [m]; by default the whole
        map.
    within : float, default 3.0
        Maximum distance of the robot from `near`, at least 0.5 [m].
    count : int, default 10
        Maximum number of modes in the result, at least 1. Weights also count dropped modes.
    clearance : float, default 0.1
        Minimum distance of the robot's centre from walls [m], >= 0. Raise it to the robot's radius
        if the map is accurate.
    database : ScanDatabase, optional
        The expected scans on this map, to reuse them between calls; its clearance is used. By
        default the last four databases are reused.

    Returns
    -------
    Location
        The modes, the best first.

    Raises
    ------
    LocplanError
        If the scan does not match the lidar, has too few returns, or the robot fits nowhere.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("places", resolution=0.1)
    >>> robot = locplan.Robot(locplan.Lidar(range=8.0, beams=180))
    >>> route = locplan.Path([[13.0, 5.5], [20.0, 5.5]])
    >>> drive = locplan.recordings.record_drive(grid, route, robot, seed=1)
    >>> anywhere = locate(grid, drive[:1])
    >>> anywhere.best.weight <= sum(mode.weight for mode in anywhere.modes) <= 1.001
    True
    >>> here = locate(grid, drive[:1], near=route, within=1.0)
    >>> bool(abs(here.best.pose[0] - 13.0) < 0.5)
    True
    """
    check_grid(grid)
    ranges, lidar = _check_scan(scan, lidar)
    check_integer("count", count)
    database = resolve_database(grid, lidar, clearance, database)
    places = select_places(database, near, within)
    return locate_scan(database, ranges, places, count, is_restricted=near is not None)


def select_places(
    database: ScanDatabase, near: Path | ArrayLike | None, within: float
) -> RangeDatabase:
    """Select the expected ranges at places near a path or positions, or of the whole map.

    Raises
    ------
    LocplanError
        If the robot fits at no such place, or the positions are invalid.
    """
    if near is None:
        return database.full_database
    # At least 0.5 m, slightly more than the distance between places with expected scans.
    radius, places = check_number("within", within, 0.5), near
    if isinstance(places, Path):
        places = places.resample(database.grid.resolution).xy
    return database.select_nearby(Path(np.asarray(places)).xy, radius)


def locate_scan(
    database: ScanDatabase,
    ranges: Floats,
    places: RangeDatabase,
    count: int,
    *,
    is_restricted: bool,
) -> Location:
    """Find the modes of a scan among places of a database; ranges are inf without a return."""
    from locplan.recordings.kernels.scan_losses import (
        TOP,
        can_robot_stand_at,
        find_distinct_poses,
        refine_on_lattice,
    )

    lidar, resolution = database.lidar, database.grid.resolution
    compared = places.matching.select_ranges(ranges[None])[0]
    scan = ScanOnMap(places, compared)
    starts = scan.shortlist_starts()
    scan_modes = scan.refine_starts(starts)
    on_robot = lidar.compute_ends_on_robot(ranges[None].astype(np.float32))
    ends = database.select_compared_ends(on_robot[0])
    if scan_modes.n_returns < MIN_RETURNS or ends.shape[1] < MIN_RETURNS:
        raise NotLocatedError(
            f"the scan has too few returns ({int(np.isfinite(ranges).sum())}) to locate it; at"
            f" least {MIN_RETURNS} of {int(places.matching.is_in_view.sum())} directions need one"
        )
    # Refine the modes, and the best starts as well: people around the robot can lead the first
    # refinement, which has a wide standard deviation, away from the true pose.
    poses = np.concatenate([scan_modes.poses[:150], starts[:20]])
    tables, lever, step = places.tables, scan.turn_lever, max(STEP / resolution, 1.0)
    losses = np.array(
        [
            refine_on_lattice(tables, ends, lever, STEPS, step, TURNS_ASIDE, TURN, pose)
            for pose in poses
        ]
    )
    losses *= database.max_loss_nats / TOP
    stands = np.array(
        [can_robot_stand_at(places.tables, *pose[:2]) for pose in poses.tolist()], bool
    )
    if not stands.any():
        raise NotLocatedError("the robot fits at no place that explains the scan; lower clearance")
    poses, losses = poses[stands], losses[stands]
    distinct = find_distinct_poses(
        poses, np.argsort(losses, kind="stable"), MODE_DISTANCE / resolution, MODE_TURN
    )
    excess = losses[distinct] - losses[distinct[0]]
    distinct = distinct[excess <= MAX_MODE_EXCESS]
    excess = excess[: len(distinct)]
    share = np.exp(-excess) / np.exp(-excess).sum()
    best = distinct[:count]
    world = places.convert_to_world(poses[best])
    matched = database.matcher.compute_posteriors(np.repeat(on_robot, len(best), axis=0), world)
    modes = [
        LocationMode(tuple(pose), float(weight), float(above), covariance)
        for pose, weight, above, covariance in zip(
            world.tolist(), share[:count], excess[:count], matched.covariance, strict=True
        )
    ]
    return Location(
        database.grid,
        lidar,
        ranges,
        tuple(modes),
        second_excess=float(excess[1]) if len(excess) > 1 else math.inf,
        explained_share=_compute_explained_share(places, ends, poses[distinct[0]]),
        is_restricted=is_restricted,
    )


def _compute_explained_share(places: RangeDatabase, ends: Singles, pose: Floats) -> float:
    """Compute the share of ends within two standard deviations of a wall at a pose on the map."""
    from locplan.recordings.kernels.scan_losses import TOP, compute_loss_at_pose

    tables, z_rand = places.tables, places.matching.z_rand
    # A wall explains a beam that ends within two standard deviations.
    max_loss = TOP * math.log((1 - z_rand) * math.exp(-0.5 * 2.0**2) + z_rand) / math.log(z_rand)
    last = len(tables.corners) - 1
    losses = [
        compute_loss_at_pose(tables, last, ends[:, [n]], *pose.tolist())
        for n in range(ends.shape[1])
    ]
    return float(np.mean(np.array(losses) <= max_loss))


def _check_scan(scan: ArrayLike | Recording, lidar: Lidar | None) -> tuple[Floats, Lidar]:
    """Check a scan; return its ranges, inf without a return, and its lidar."""
    if isinstance(scan, Recording):
        if lidar is not None and lidar != scan.lidar:
            raise ConfigError("the recording has another lidar; omit lidar")
        if len(scan) != 1:
            raise ConfigError(
                f"one scan is located at a time, not {len(scan)}; use drive[n : n + 1], or"
                " locplan.recordings.location.locate_drive for all scans"
            )
        return scan.ranges[0].astype(np.float64), scan.lidar
    if lidar is None:
        raise ConfigError("an array of ranges needs a lidar; pass lidar=")
    check_instance("lidar", lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')
    try:
        ranges = np.array(scan, np.float64)
    except (TypeError, ValueError):
        raise ConfigError(
            f"a scan must be an array of ranges [m], not {short_repr(scan)}"
        ) from None
    if ranges.shape != (lidar.beams,):
        raise ConfigError(
            f"a scan must be the ranges of the lidar's {lidar.beams} beams, not an array of shape"
            f" {ranges.shape}; see locplan.Lidar.from_scan"
        )
    if np.isnan(ranges).any():
        raise ConfigError(
            f"the range of beam {int(np.argmax(np.isnan(ranges)))} is NaN; use inf for no return"
        )
    returns = lidar.has_return(ranges.astype(np.float32))
    if not returns.any():
        raise ConfigError(
            f"no beam of the scan ends within {lidar.min_range:g} to {lidar.range:g} m; check that"
            " the ranges are in metres, and the lidar"
        )
    return np.where(returns, ranges, np.inf), lidar


def locate_drive(
    recording: Recording,
    grid: OccupancyGrid,
    *,
    near: Path | ArrayLike | None = None,
    within: float = WITHIN,
    count: int = COUNT,
    clearance: float = CLEARANCE,
    database: ScanDatabase | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> LocatedDrive:
    """Locate each scan of a recorded drive independently by `locate`.

    The recorded poses are only used to check the locations.

    Parameters
    ----------
    recording : Recording
        The drive.
    grid : OccupancyGrid
        The map.
    near, within, count, clearance, database
        See `locate`.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) scans.

    Returns
    -------
    LocatedDrive
        The location of each scan.

    Raises
    ------
    LocplanError
        If a value is out of range, no scan has enough returns, or the robot fits nowhere.
    """
    check_instance(
        "recording", recording, Recording, "read one with locplan.recordings.read_recording"
    )
    check_grid(grid)
    check_integer("count", count)
    workers = check_threads(threads)
    database = resolve_database(grid, recording.lidar, clearance, database)
    places = select_places(database, near, within)
    _ = database.matcher.kernel_arguments  # computed once, before threads need it

    def locate_batch(scan_numbers: Ints) -> list[Location | None]:
        batch_locations: list[Location | None] = []
        for n in scan_numbers:
            ranges = recording.ranges[n].astype(np.float64)
            try:
                batch_locations.append(
                    locate_scan(database, ranges, places, count, is_restricted=near is not None)
                )
            except NotLocatedError:
                batch_locations.append(None)
        return batch_locations

    locations = run_in_batches(locate_batch, len(recording), workers, progress)
    if not any(locations):
        raise RecordingError(f"none of {len(recording)} scans has enough returns to locate it")
    return LocatedDrive(recording, grid, tuple(locations))
