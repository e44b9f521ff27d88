"""Closed-loop drives, and whether a robot that its estimate steers reaches the goal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from locplan._support.checks import Settings, check_positive
from locplan._support.intervals import Interval, compute_wilson_interval
from locplan._support.kernels.arrays import Bools, Floats
from locplan._support.poses import Poses, wrap_angles
from locplan._support.records import POSE, Table, TableColumn
from locplan._support.saved import EqualByValue
from locplan.planning.path import Path
from locplan.simulation.drives import check_drive_count, make_rate_column

ARRIVED, ELSEWHERE, ABORTED, TIMED_OUT = "arrived", "elsewhere", "aborted", "timed out"
"""How a drive ends; elsewhere, the robot believes to be at the goal, and is not. Aborted, it
stood still too often, or its estimate jumped too far from the path."""
NEAR_GOAL = 0.5
"""Distance from the goal within which a robot reaches it [m]."""
FOLLOWER_FAULT: str = "follower"
WORLD_FAULT: str = "world"
"""What is at fault where a drive fails with perfect localization, too: the follower, or a world
in which no way leads to the goal."""

CLOSED_DRIVES = 16
"""Number of closed-loop drives along a path that commands add unless they are told a number."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ClosedLoopSettings(Settings):
    """Closed-loop drives that `simulate` adds.

    Raises
    ------
    ConfigError
        If a value is out of its range.
    """

    drives: int = CLOSED_DRIVES
    """Number of drives along each path, 2 to 100,000."""
    replan: float | None = None
    """Time after which a new plan is made in any case, above 0 [s]; None plans only where something
    is in the way."""

    def __post_init__(self) -> None:
        check_drive_count(self.drives)
        if self.replan is not None:
            check_positive("replan", self.replan, "s")


PLACE_SEPARATION = 0.5
"""Distance from the path, and between two stops, from which a place is one of its own [m]."""
LEAVES: str = f"leaves the path by {PLACE_SEPARATION:g} m"
STOPS: str = "stops"
ENDS: str = "ends"
"""What is at a place."""
NO_POSES = np.empty((0, 3))
Place = tuple[float, float, float]


@dataclass(frozen=True, eq=False, repr=False)
class ClosedLoopDrive(EqualByValue):
    """One closed-loop drive."""

    outcome: str
    """How it ended: arrived, elsewhere, aborted or timed out."""
    seconds: float
    """Duration [s]."""
    end: Place
    """True pose at the end, in the world [m, m, rad]."""
    believed_end: Place
    """The filter's pose at the end, in the world [m, m, rad]."""
    standstills: int = 0
    """Number of times that the robot stood still because its way led into a wall."""
    stops: tuple[Place, ...] = ()
    """True poses at which the robot stood for 2 s or more, at least `APART` from each other."""
    leaves: tuple[Place, ...] = ()
    """True poses at which it was `APART` off the path, each time anew."""
    fault: str = ""
    """What fails with perfect localization, too: the follower, or the world, in which no way leads
    to the goal; empty if nothing does."""
    truth: Poses = field(default_factory=NO_POSES.copy, compare=False)
    """The true poses every 0.1 s, (n, 3), in the world [m, m, rad]; none in what was loaded."""
    believed: Poses = field(default_factory=NO_POSES.copy, compare=False)
    """The filter's poses, (n, 3), in the world [m, m, rad]."""

    @classmethod
    def from_drive(
        cls, outcome: str, truth: Poses, believed: Poses, path: Path, standstills: int = 0
    ) -> ClosedLoopDrive:
        """A drive that ended.

        Parameters
        ----------
        outcome : str
            How it ended.
        truth, believed : (n, 3) array
            The true and the filter's poses every 0.1 s, in the world [m, m, rad].
        path : Path
            The path that was followed.
        standstills : int, default 0
            Number of its standstills.
        """
        from scipy.spatial import cKDTree

        from locplan.simulation.kernels.pursuit import TICK

        off = cKDTree(path.resample(0.1).xy).query(truth[:, :2])[0] > PLACE_SEPARATION
        wait = round(2.0 / TICK)  # A robot that stands still for two seconds has stopped.
        stands = (truth[wait:] == truth[:-wait]).all(axis=1)
        stops: list[Floats] = []
        for pose in truth[np.flatnonzero(stands)]:
            if all(np.hypot(*(pose - stop)[:2]) > PLACE_SEPARATION for stop in stops):
                stops.append(pose)
        begins = np.flatnonzero(off & ~np.append(False, off[:-1]))
        end, believed_end = _places_from_poses((truth[-1], believed[-1]))
        places = _places_from_poses(stops), _places_from_poses(truth[begins])
        seconds = (len(truth) - 1) * TICK
        ends = end, believed_end, standstills
        return cls(outcome, seconds, *ends, *places, truth=truth, believed=believed)

    @property
    def places(self) -> tuple[tuple[str, tuple[Place, ...]], ...]:
        """True poses at which a drive goes wrong, by the kind of fault."""
        ends = () if self.outcome == ARRIVED else (self.end,)
        return (LEAVES, self.leaves), (STOPS, self.stops), (ENDS, ends)

    def __repr__(self) -> str:
        return f"Arrival({self.outcome} after {self.seconds:.1f} s)"


@dataclass(frozen=True, eq=False, repr=False)
class Arrivals(EqualByValue):
    """Closed-loop drives along one path; the n-th of two paths with the same ends are pairs."""

    drives: tuple[ClosedLoopDrive, ...]
    """The drives by number."""

    def __repr__(self) -> str:
        return f"Arrivals({self.arrival_rate.value:.0%} of {len(self.drives)} arrived)"

    @property
    def has_reached_goal(self) -> Bools:
        """True for each drive that reaches the goal, (drives,)."""
        return np.array([drive.outcome == ARRIVED for drive in self.drives], bool)

    @property
    def n_reached(self) -> int:
        """Number of drives that reach the goal."""
        return int(self.has_reached_goal.sum())

    @property
    def failure_counts(self) -> Counter[str]:
        """Number of the drives that do not arrive, by their ending in words."""
        endings = (drive.fault or drive.outcome for drive in self.drives)
        return Counter(ENDINGS[ending][1] for ending in endings if ending != ARRIVED)

    @property
    def arrivals_text(self) -> str:
        """Number of drives that reach the goal, with the 95 % interval of their share, as text."""
        _, low, high = self.arrival_rate
        return f"{self.n_reached} of {len(self.drives)} [{100 * low:.0f}, {100 * high:.0f} %]"

    @property
    def arrival_rate(self) -> Interval:
        """Share of the drives that arrive, 0..1, with its 95 % interval."""
        return self.compute_rate(ARRIVED)

    @property
    def abort_rate(self) -> Interval:
        """Share of the drives that are aborted, 0..1, with its 95 % interval."""
        return self.compute_rate(ABORTED)

    @property
    def standstills(self) -> float:
        """Mean number of standstills before a wall per drive."""
        return float(np.mean([drive.standstills for drive in self.drives]))

    def compute_rate(self, ending: str) -> Interval:
        """Return the share of drives with this outcome or fault, 0..1, with its 95 % interval.

        Parameters
        ----------
        ending : str
            "elsewhere" (the robot believes to be at the goal, and is not), "aborted", "timed out";
            or "follower" (it also fails with perfect localization), "world" (no way to the goal).
        """
        n_matching = sum(ending in (drive.outcome, drive.fault) for drive in self.drives)
        return compute_wilson_interval(n_matching / len(self.drives), len(self.drives))

    def places(self) -> Table:
        """Return the poses at which robots stop, end away from the goal, and leave the path."""
        drive_places = [
            (n, *place) for n, drive in enumerate(self.drives) for place in drive.places
        ]
        columns = TableColumn("drive"), TableColumn("what"), *POSE
        return Table(
            columns,
            tuple(
                (n, place_kind, *pose) for n, place_kind, poses in drive_places for pose in poses
            ),
        )


ENDINGS = {
    ARRIVED: ("arrived", "arrives, steered by its filter"),
    ELSEWHERE: ("elsewhere", "stops at a wrong place"),
    ABORTED: ("aborted", "is aborted"),
    TIMED_OUT: ("timed_out", "runs out of time"),
    FOLLOWER_FAULT: ("follower_fails", "fails with perfect localization, too"),
    WORLD_FAULT: ("no_way", "has no way in its world"),
}
"""Name in files and words of each outcome and fault."""


def _make_ending_column(ending: str) -> TableColumn:
    return make_rate_column(*ENDINGS[ending], lambda arrivals: arrivals.compute_rate(ending))


ENDING_COLUMNS: tuple[TableColumn, ...] = tuple(map(_make_ending_column, ENDINGS))
"""Columns of the shares of drives by their ends."""
ARRIVAL_COLUMNS: tuple[TableColumn, ...] = (
    ENDING_COLUMNS[0],
    TableColumn("standstills", title="standstills before a wall, per drive", digits=1),
    *ENDING_COLUMNS[1:],
)
"""Columns of `Arrivals`."""


def tabulate_ends(arrivals: Mapping[str, Arrivals]) -> Table:
    """Return the true and the estimated end of each closed-loop drive along some paths."""
    columns = (
        *map(TableColumn, ("path", "drive", "outcome")),
        TableColumn("seconds", "s"),
        TableColumn("standstills"),
        TableColumn("fault"),
        *POSE,
        *(TableColumn(f"believed_{pose_column.name}", pose_column.unit) for pose_column in POSE),
    )
    rows = (
        (name, n, *_get_ending_values(drive), *drive.end, *drive.believed_end)
        for name, path_arrivals in arrivals.items()
        for n, drive in enumerate(path_arrivals.drives)
    )
    return Table(columns, tuple(rows))


def _get_ending_values(drive: ClosedLoopDrive) -> tuple[Any, ...]:
    return drive.outcome, drive.seconds, drive.standstills, drive.fault


def describe_faults(*arrivals: Arrivals) -> str:
    """Which of the failed drives are not the filter's, in words; empty if all are.

    Parameters
    ----------
    *arrivals : Arrivals
        Closed-loop drives along some paths.
    """
    faults = [drive.fault for path_arrivals in arrivals for drive in path_arrivals.drives]
    words = {FOLLOWER_FAULT: "fail with perfect localization, too", WORLD_FAULT: "have no way"}
    fault_texts = [
        f"{faults.count(fault)} {text}" for fault, text in words.items() if fault in faults
    ]
    return f" ({', '.join(fault_texts)})" if fault_texts else ""


def _places_from_poses(poses: Any) -> tuple[Place, ...]:
    x, y, heading = np.reshape(poses, (-1, 3)).T
    return tuple(zip(x.tolist(), y.tolist(), wrap_angles(heading).tolist(), strict=True))
