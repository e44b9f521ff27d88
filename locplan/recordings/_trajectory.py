"""The trajectory of a recorded drive: where the robot was, and where that is not sure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats
from locplan._util.output import Results
from locplan._util.records import POSE, Column, Result, Table
from locplan._util.saved import Stored
from locplan._util.tables import finite, table
from locplan.errors import RecordingError
from locplan.field import position_axes
from locplan.maps import OccupancyGrid
from locplan.recordings._odometry_model import OdometryModel
from locplan.recordings._recording import Recording
from locplan.simulation import LOST

UNCERTAIN, AMBIGUOUS, BAD_FIT, JUMPED, MAP_MOVED = range(1, 6)
DOUBTS = (
    "",
    "the deviation is over 15 cm or 4 deg",
    "other places explain the scans as well",
    "the scan does not fit the map",
    "odometry jumps",
    "the map is displaced, by odometry before and after",
)
"""Why a pose is not to be trusted, by its number; 0 where it is."""
CARRIED = 3.0
"""Distance up to which a jump of odometry may be a slip of wheels [m]."""
SMOOTHED = "smoothed"
"""The source of the poses of a recording that has a trajectory's."""
SHOWN = 20
"""Number of the stretches not to be trusted that the report shows."""


@dataclass(frozen=True)
class Jump:
    """A place to which odometry does not lead."""

    scan: int
    """Index of the first scan after it."""
    kind: str
    """Kind: "slip" of wheels up to 3 m; "carried" away farther than that; or "gap" in the log."""
    x: float
    """Position after it in the world [m]."""
    y: float
    """Position after it in the world [m]."""
    distance: float
    """How far the robot is from where odometry has it [m]."""
    turn: float
    """By how much its heading is off [rad]."""


def jump_at(scan: int, pose: Floats, error: Floats, times: Floats | None) -> Jump:
    """The jump to a scan's pose, where odometry errs so."""
    away, kind = float(np.hypot(error[0], error[1])), "slip"
    steps = np.zeros(1) if times is None else np.diff(times)
    if times is not None and steps[scan - 1] > max(5.0, 10 * float(np.median(steps))):
        kind = "gap"
    elif away > CARRIED:
        kind = "carried"
    return Jump(scan, kind, float(pose[0]), float(pose[1]), away, float(error[2]))


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Result, Stored):
    """Where a robot was along a recorded drive, at all scans, and how sure that is."""

    kind: ClassVar[str] = "trajectory"
    files: ClassVar[Results] = Results(
        "trajectory",
        ("trajectory.json", "trajectory.npz", "trajectory.png", "poses.csv", "poses.tum"),
    )
    _reported_by: ClassVar[str] = "locplan.recordings._trajectory:trajectory_report"
    _drawn_by: ClassVar[str] = "locplan.recordings:trajectory_figure"

    poses: Floats
    """Poses x, y, heading of the robot in the map's frame, (n, 3) [m, m, rad]."""
    covariances: Floats
    """Their covariances, (n, 3, 3) [m, m, rad]."""
    doubts: NDArray[np.int64]
    """Why each is not to be trusted, (n,): a place in `DOUBTS`, or 0 where it is."""
    fits: Floats
    """Log-likelihood a return of each scan, (n,): 0 where all ends lie on walls; NaN without."""
    jumps: tuple[Jump, ...]
    """The places to which odometry does not lead."""
    odometry: OdometryModel | None
    """How odometry errs; None where the log has none."""
    recorded: Floats
    """The poses of the log, (n, 3) [m, m, rad]."""
    times: Floats | None
    """Times of the scans, (n,) [s]; None where the log has none."""
    drive: str
    """Name of the drive's file."""
    map: str
    """Name of the map."""
    grid: OccupancyGrid | None = field(default=None, compare=False)
    """The map, for the figure; None in what was loaded."""

    def __repr__(self) -> str:
        return f"Trajectory({len(self)} scans, median deviation {100 * self._median:.1f} cm)"

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def drawable(self) -> bool:
        """Whether the map is known, on which it is drawn."""
        return self.grid is not None

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Mask of the poses that are to be trusted, (n,)."""
        return np.asarray(self.doubts == 0)

    @cached_property
    def deviation(self) -> Floats:
        """Largest standard deviation of each position, (n,) [m]."""
        return position_axes(self.covariances)[0]

    @property
    def _median(self) -> float:
        return float(np.median(self.deviation))

    @cached_property
    def off(self) -> Floats:
        """Distance of the log's own poses from these, (n,) [m]."""
        return np.asarray(np.hypot(*(self.recorded - self.poses)[:, :2].T))

    @cached_property
    def stretches(self) -> list[slice]:
        """Scans that follow each other and are not to be trusted."""
        edges = np.flatnonzero(np.diff(np.concatenate([[True], self.trusted, [True]])))
        return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]

    def of(self, recording: Recording) -> Recording:
        """A recording with these poses, without the scans whose poses are not to be trusted.

        Parameters
        ----------
        recording : Recording
            The drive that they are of.

        Raises
        ------
        RecordingError
            If none is to be trusted.
        """
        if not self.trusted.any():
            raise RecordingError(
                f"no pose of the trajectory on {self.map or 'the map'} is to be trusted; name the"
                " map that the drive was recorded on"
            )
        poses = self.poses.copy()
        poses.setflags(write=False)
        source = replace(recording.source, poses=SMOOTHED)
        return replace(recording, poses=poses, source=source)[np.flatnonzero(self.trusted)]

    @property
    def sentences(self) -> list[str]:
        """What was found, in plain words."""
        if not self.trusted.any():
            return [
                f"None of {len(self):,} scans is to be trusted: is it the right map, and odometry"
                " that of the wheels?"
            ]
        count = len(self.stretches)
        some = int((~self.trusted).sum())
        doubtful = (
            f"{count} stretch{'es' * (count > 1)} with {some} scans ({some / len(self):.0%}) not to"
            " be trusted"
            if count
            else "all are to be trusted"
        )
        found = [f"{len(self):,} scans, known to {100 * self._median:.0f} cm; {doubtful}."]
        names = {"slip": "wheels slip", "carried": "the robot is carried", "gap": "the log lacks"}
        found += [
            f"At {each.x:.1f},{each.y:.1f} (scan {each.scan}) {names[each.kind]}"
            f" {each.distance:.2g} m, {math.degrees(each.turn):.0f} deg."
            for each in self.jumps
        ]
        if self.odometry is None:
            found.append("The log has no odometry: its own poses stand for it.")
        off = self.off[self.trusted]
        lost = float((off > LOST).mean())
        found.append(
            f"The log's own poses are off by {100 * float(np.median(off)):.0f} cm in the"
            f" median, 95 %: {100 * float(np.quantile(off, 0.95)):.0f} cm"
            + (f"; they are lost, over 1 m off, at {lost:.0%} of the scans." if lost else ".")
        )
        return found

    def summary(self) -> dict[str, object]:
        """What was found, fit for JSON."""
        model = self.odometry
        of_odometry = model and {
            "distance_scale": model.scale,
            "bend": model.bend,
            "turn_scale": model.turn_scale,
            "mount": list(model.mount),
            "variances": model.variances.tolist(),
        }
        off = self.off[self.trusted]
        return finite(
            {
                "map": self.map,
                "drive": self.drive,
                "scans": len(self),
                "sentences": self.sentences,
                "deviation": self._median,
                "not_trusted": int((~self.trusted).sum()),
                "stretches": [[each.start, each.stop] for each in self.stretches],
                "jumps": [vars(each) for each in self.jumps],
                "log_off": float(np.median(off)) if len(off) else math.nan,
                "odometry": of_odometry,
            }
        )

    def table(self) -> Table:
        """A row per scan: its pose, how sure it is, and how far off the log's own is."""
        major, minor, direction = position_axes(self.covariances)
        values: dict[Column, NDArray[Any]] = {
            Column("scan"): np.arange(len(self)),
            Column("time", "s"): np.full(len(self), np.nan) if self.times is None else self.times,
            **dict(zip(POSE, self.poses.T, strict=True)),
            Column("major_std", "m"): major,
            Column("minor_std", "m"): minor,
            Column("major_axis", "rad"): direction,
            Column("heading_std", "rad"): np.sqrt(self.covariances[:, 2, 2]),
            Column("fit"): self.fits,
            Column("off", "m"): self.off,
            Column("doubt"): np.array(DOUBTS)[self.doubts],
        }
        return Table(tuple(values), tuple(zip(*(v.tolist() for v in values.values()), strict=True)))

    def _write(self, folder: Path, *about: Any) -> None:
        self.write(folder / "trajectory.npz")
        self.table().write_csv(folder / "poses.csv")
        self.write_tum(folder / "poses.tum")

    def write_tum(self, file: Path) -> None:
        """Write the trusted poses as evo and others read them: time, x, y, z, quaternion.

        Parameters
        ----------
        file : path
            The file; one that is there is replaced.
        """
        some = np.flatnonzero(self.trusted)
        times = np.arange(len(self), dtype=float) if self.times is None else self.times
        half, none = self.poses[some, 2] / 2, np.zeros(len(some))
        rows = (times[some], *self.poses[some, :2].T, none, none, none, np.sin(half), np.cos(half))
        np.savetxt(file, np.column_stack(rows), "%.9f" + 7 * " %.6f")


def trajectory_report(found: Trajectory) -> str:
    """What was found and how odometry errs."""
    rows = [("map", found.map), ("drive", found.drive or "a recording")]
    for n, stretch in enumerate(found.stretches[:SHOWN]):
        at, most = found.poses[stretch.start], np.bincount(found.doubts[stretch]).argmax()
        first, last = stretch.start, stretch.stop - 1
        which = f"scan {first}" if first == last else f"scans {first} to {last}"
        place = f"{which} at {at[0]:.1f},{at[1]:.1f}"
        rows.append(("" if n else "not trusted", f"{place}: {DOUBTS[most]}"))
    if (more := len(found.stretches) - SHOWN) > 0:
        rows.append(("", f"and {more} more, which -o writes into poses.csv"))
    if (model := found.odometry) is not None and found.trusted.any():
        x, y, yaw = model.mount
        ways = f"{abs(model.scale):.1%} too {'short' if model.scale > 0 else 'long'}"
        turns = f"{abs(model.turn_scale):.1%} too {'small' if model.turn_scale > 0 else 'large'}"
        side = "left" if model.bend > 0 else "right"
        bend = f"{math.degrees(abs(model.bend)):.2f} deg/m to the {side}"
        said = f"reports ways {ways} and turns {turns}; its straight ways bend by {bend}"
        mount = f"off by {x:+.2f},{y:+.2f} m, {math.degrees(yaw):+.1f} deg"
        rows += [("odometry", said), ("lidar's mount", mount)]
    return "\n".join([" ".join(found.sentences), table([], rows)])
