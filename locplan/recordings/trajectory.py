"""The trajectory of a recorded drive, and the errors of its odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from locplan._support.kernels.arrays import Floats
from locplan._support.output import ResultFiles
from locplan._support.poses import apply_motions, compute_motions, wrap_angles
from locplan._support.records import POSE, Column, Result, Table
from locplan._support.saved import EqualByValue, StoredResult
from locplan._support.tables import format_table, nan_to_none
from locplan.errors import RecordingError
from locplan.field.covariance import position_axes
from locplan.maps.grid import OccupancyGrid
from locplan.recordings.recording import Recording
from locplan.robots.parts import Odometry
from locplan.simulation.drives import LOST_DISTANCE, LOST_TEXT

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FREEDOM = 4.0
"""Degrees of freedom of Student's distribution of the errors."""
AHEAD, LEFT, TURN = range(3)
TINY = 1e-12


@dataclass(frozen=True)
class OdometryMoves:
    """What odometry says of the ways between n scans; the first one stands for none."""

    ways: Floats
    """Each scan as seen from the one before, (n, 3) [m, m, rad]."""
    lengths: Floats
    """Length of the way [m], (n,)."""
    turn_sums: Floats
    """Sum of the turns [rad], (n,)."""

    @classmethod
    def from_odometry(cls, odometry: Floats, scans: NDArray[np.int64]) -> OdometryMoves:
        """Moves between some scans of a drive."""
        steps = compute_motions(odometry[:-1], odometry[1:])
        sums = np.zeros((len(odometry), 2))
        sums[1:, 0] = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))
        sums[1:, 1] = np.cumsum(np.abs(wrap_angles(steps[:, 2])))
        ways = np.zeros((len(scans), 3))
        ways[1:] = compute_motions(odometry[scans[:-1]], odometry[scans[1:]])
        ways[:, 2] = wrap_angles(ways[:, 2])
        return cls(ways, *np.diff(sums[scans], axis=0, prepend=sums[scans[:1]]).T)

    @property
    def features(self) -> Floats:
        """What variances are made of, (n, 3)."""
        return np.column_stack([self.lengths, self.turn_sums, np.ones(len(self.lengths))])


@dataclass(frozen=True, eq=False)
class OdometryModel(EqualByValue):
    """Odometry of one drive: the true ways are the reported ones, corrected, with an error.

    The errors are Student's with 4 degrees of freedom, and independent from scan to scan.
    """

    scale: float
    """True distances over reported ones, minus 1."""
    bend: float
    """Bend to the left of ways that are reported straight [rad/m]."""
    turn_scale: float
    """True turns over reported ones, minus 1."""
    mount: tuple[float, float, float]
    """Pose of the lidar from where it is said to be, as the drive shows it [m, m, rad]."""
    variances: Floats
    """Squared scales of the errors ahead, to the left, and of the turn, a metre of way, a radian
    turned, and a scan, (3, 3) [m^2, m^2, rad^2]."""

    @classmethod
    def make_prior(cls, odometry: Odometry) -> OdometryModel:
        """What is taken for granted at first: wide errors, or those of a robot that has wider.

        Parameters
        ----------
        odometry : Odometry
            That of the robot.
        """
        turn = math.radians(4.0)
        drifts = math.radians(odometry.heading_drift_deg), math.radians(odometry.turn_drift_deg)
        deviations = [
            [max(0.10, odometry.distance_drift), 0.05, 0.01],
            [0.07, 0.05, 0.01],
            [max(turn, drifts[0]), max(turn, drifts[1]), math.radians(0.3)],
        ]
        return cls(0.0, 0.0, 0.0, (0.0, 0.0, 0.0), np.square(deviations))

    def correct_ways(self, moves: OdometryMoves) -> Floats:
        """The corrected ways, (n, 3), of a robot whose lidar is where it is said to be.

        Parameters
        ----------
        moves : Moves
            What odometry says.
        """
        ahead, left, turn = moves.ways.T
        turn = turn * (1 + self.turn_scale) + self.bend * moves.lengths
        robot = np.column_stack([ahead * (1 + self.scale), left * (1 + self.scale), turn])
        lidar = np.broadcast_to(np.array(self.mount), robot.shape)
        return compute_motions(lidar, apply_motions(robot, lidar))

    def compute_deviations(self, moves: OdometryMoves) -> Floats:
        """Scales of the errors, (n, 3) [m, m, rad].

        Parameters
        ----------
        moves : Moves
            What odometry says.
        """
        return np.asarray(np.sqrt(moves.features @ self.variances.T))

    def refit(
        self, moves: OdometryMoves, true_ways: Floats, way_variances: Floats, used: Floats
    ) -> OdometryModel:
        """The model that explains the true ways best: a step of expectation and maximisation.

        Parameters
        ----------
        moves : Moves
            What odometry says.
        true_ways : (n, 3) array
            The ways [m, m, rad].
        way_variances : (n, 3) array
            Variances with which they are known, without which those of odometry would vanish.
        used : (n,) array
            1 where a way counts, and 0 where it is a jump.
        """
        model = self
        for _ in range(3):
            model = model._refit_biases(moves, true_ways, used)
            errors = true_ways - model.correct_ways(moves)
            errors[:, TURN] = wrap_angles(errors[:, TURN])
            variances = np.empty((3, 3))
            for axis in range(3):
                square, scale = errors[:, axis] ** 2, model.compute_deviations(moves)[:, axis] ** 2
                robust_weights = (FREEDOM + 1) / (FREEDOM + square / scale)
                squares, zeros = (
                    robust_weights * square + way_variances[:, axis],
                    np.zeros(len(square)),
                )
                variances[axis] = fit_variances(squares, moves.features, zeros, used)
            # So that a drive that hardly errs does not become one without error.
            min_variances = np.array([0.005, 0.005, math.radians(0.1)]) ** 2
            variances[:, 2] = np.maximum(variances[:, 2], min_variances)
            model = replace(model, variances=variances)
        return model

    def _refit_biases(self, moves: OdometryMoves, true: Floats, used: Floats) -> OdometryModel:
        """The model with the biases, by robust regression towards none."""
        ahead, left, turn = moves.ways.T
        cos, sin = np.cos(turn) - 1, np.sin(turn)
        deviations = self.compute_deviations(moves)
        off = true - moves.ways
        off[:, TURN] = wrap_angles(off[:, TURN])
        # A lidar that is mounted elsewhere swings about the robot in turns.
        features = [
            np.column_stack([ahead, left, cos, -sin]),
            np.column_stack([left, -ahead, sin, cos]),
        ]
        scaled_features = np.concatenate(
            [axis_features / deviations[:, [n]] for n, axis_features in enumerate(features)]
        )
        places = np.concatenate([off[:, AHEAD] / deviations[:, 0], off[:, LEFT] / deviations[:, 1]])
        scale, yaw, x, y = _fit_robust(
            scaled_features, places, np.tile(used, 2), (0.1, 0.1, 0.2, 0.2)
        )
        turns = np.column_stack([turn, moves.lengths]) / deviations[:, [TURN]]
        scaled_turns = off[:, TURN] / deviations[:, TURN]
        turn_scale, bend = _fit_robust(turns, scaled_turns, used, (0.2, 0.1))
        return OdometryModel(scale, bend, turn_scale, (x, y, yaw), self.variances)


def _fit_robust(
    features: Floats, values: Floats, used: Floats, near: tuple[float, ...]
) -> list[float]:
    """Coefficients by least squares with Student's weights, and a prior about zero."""
    prior = np.diag(1 / np.square(near))
    coefficients: Floats = np.zeros(len(near))
    for _ in range(6):
        weights = used * (FREEDOM + 1) / (FREEDOM + (values - features @ coefficients) ** 2)
        weighed = (features * weights[:, None]).T
        coefficients = np.asarray(np.linalg.solve(weighed @ features + prior, weighed @ values))
    return list(map(float, coefficients))


def compute_ways(poses: Floats, covariances: Floats, across: Floats) -> tuple[Floats, Floats]:
    """Ways between n poses, the first one none, and the variances with which they are known.

    Parameters
    ----------
    poses : (n, 3) array
        The poses [m, m, rad].
    covariances, across : (n, 3, 3) arrays
        Covariances of each, and of each with the one before.
    """
    ways, variances = np.zeros((len(poses), 3)), np.zeros((len(poses), 3))
    ways[1:] = compute_motions(poses[:-1], poses[1:])
    ways[:, TURN] = wrap_angles(ways[:, TURN])
    cos, sin = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    after = np.zeros((len(cos), 3, 3))
    after[:, 0, 0], after[:, 0, 1], after[:, 1, 0], after[:, 1, 1] = cos, sin, -sin, cos
    after[:, 2, 2] = 1.0
    before = -after
    before[:, 0, 2], before[:, 1, 2] = ways[1:, LEFT], -ways[1:, AHEAD]
    jacobian = np.concatenate([before, after], axis=2)
    joint = np.block(
        [[covariances[:-1], across[1:].transpose(0, 2, 1)], [across[1:], covariances[1:]]]
    )
    variances[1:] = np.einsum("nij,njk,nik->ni", jacobian, joint, jacobian)
    return ways, variances


def fit_variances(
    squares: Floats,
    features: Floats,
    fixed: Floats,
    weights: Floats,
    start: Floats | None = None,
) -> Floats:
    """Coefficients of the variance of Gaussian values that are likeliest, none below 0.

    The variance of a value is ``features @ coefficients + fixed``. Each round is a step of Fisher's
    scoring: least squares of the squares, weighted by the precision that they have by now.
    """
    scale = np.maximum(weights @ features, TINY)
    coefficients = weights @ squares / scale if start is None else start
    # So that no value of hardly any variance counts for all others.
    min_variance = 1e-3 * float(weights @ squares / max(weights.sum(), TINY)) + TINY
    for _ in range(12):
        variance = np.maximum(features @ coefficients + fixed, min_variance)
        weighted_features = (weights / variance**2)[:, None] * features
        coefficients = (
            coefficients
            + _solve_nonnegative(
                weighted_features.T @ features, weighted_features.T @ (squares - fixed)
            )
        ) / 2
    return np.asarray(coefficients)


def _solve_nonnegative(matrix: Floats, vector: Floats) -> Floats:
    """Least squares by their normal equations, without the coefficients that would be negative."""
    is_active = np.diag(matrix) > TINY
    coefficients = np.zeros(len(vector))
    while is_active.any():
        part = matrix[np.ix_(is_active, is_active)]
        size = np.sqrt(np.diag(part))
        solved = np.linalg.lstsq(part / np.outer(size, size), vector[is_active] / size, rcond=1e-9)[
            0
        ]
        if (solved >= 0).all():
            coefficients[is_active] = solved / size
            break
        is_active[np.flatnonzero(is_active)[np.argmin(solved)]] = False
    return coefficients


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
MAX_STRETCHES = 20
"""Number of the stretches not to be trusted that the report shows."""


@dataclass(frozen=True)
class OdometryJump:
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


def make_jump(scan: int, pose: Floats, error: Floats, times: Floats | None) -> OdometryJump:
    """The jump to a scan's pose, where odometry errs so."""
    distance, kind = float(np.hypot(error[0], error[1])), "slip"
    steps = np.zeros(1) if times is None else np.diff(times)
    if times is not None and steps[scan - 1] > max(5.0, 10 * float(np.median(steps))):
        kind = "gap"
    elif distance > CARRIED:
        kind = "carried"
    return OdometryJump(scan, kind, float(pose[0]), float(pose[1]), distance, float(error[2]))


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Result, StoredResult):
    """Where a robot was along a recorded drive, at all scans, and how sure that is."""

    kind: ClassVar[str] = "trajectory"
    files: ClassVar[ResultFiles] = ResultFiles(
        "trajectory",
        ("trajectory.json", "trajectory.npz", "trajectory.png", "poses.csv", "poses.tum"),
        purposes={
            "poses.tum": "the poses, for evo",
            "poses.csv": "the poses with standard deviations",
            "trajectory.png": "the picture",
        },
    )

    poses: Floats
    """Poses x, y, heading of the robot in the map's frame, (n, 3) [m, m, rad]."""
    covariances: Floats
    """Their covariances, (n, 3, 3) [m, m, rad]."""
    doubts: NDArray[np.int64]
    """Why each is not to be trusted, (n,): a place in `DOUBTS`, or 0 where it is."""
    fits: Floats
    """Log-likelihood a return of each scan, (n,): 0 where all ends lie on walls; NaN without."""
    jumps: tuple[OdometryJump, ...]
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
    def is_drawable(self) -> bool:
        """Whether the map is known, on which it is drawn."""
        return self.grid is not None

    @property
    def is_trusted(self) -> NDArray[np.bool_]:
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
    def log_distance(self) -> Floats:
        """Distance of the log's own poses from these, (n,) [m]."""
        return np.asarray(np.hypot(*(self.recorded - self.poses)[:, :2].T))

    @cached_property
    def doubtful_stretches(self) -> list[slice]:
        """Scans that follow each other and are not to be trusted."""
        edges = np.flatnonzero(np.diff(np.concatenate([[True], self.is_trusted, [True]])))
        return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]

    def replace_poses(self, recording: Recording) -> Recording:
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
        if not self.is_trusted.any():
            raise RecordingError(
                f"no pose of the trajectory on {self.map or 'the map'} is to be trusted; name the"
                " map that the drive was recorded on"
            )
        poses = self.poses.copy()
        poses.setflags(write=False)
        source = replace(recording.source, poses=SMOOTHED)
        return replace(recording, poses=poses, source=source)[np.flatnonzero(self.is_trusted)]

    @property
    def sentences(self) -> list[str]:
        """What was found, in plain words."""
        if not self.is_trusted.any():
            return [
                f"None of {len(self):,} scans is to be trusted: is it the right map, and odometry"
                " that of the wheels?"
            ]
        count = len(self.doubtful_stretches)
        n_doubtful = int((~self.is_trusted).sum())
        doubtful = (
            f"{count} stretch{'es' * (count > 1)} with {n_doubtful} scans"
            f" ({n_doubtful / len(self):.0%}) not to"
            " be trusted"
            if count
            else "all are to be trusted"
        )
        lines = [f"{len(self):,} scans, known to {100 * self._median:.0f} cm; {doubtful}."]
        names = {"slip": "wheels slip", "carried": "the robot is carried", "gap": "the log lacks"}
        lines += [
            f"At {jump.x:.1f},{jump.y:.1f} (scan {jump.scan}) {names[jump.kind]}"
            f" {jump.distance:.2g} m, {math.degrees(jump.turn):.0f} deg."
            for jump in self.jumps
        ]
        if self.odometry is None:
            lines.append("The log has no odometry: its own poses stand for it.")
        off = self.log_distance[self.is_trusted]
        lost = float((off > LOST_DISTANCE).mean())
        lines.append(
            f"The log's own poses are off by {100 * float(np.median(off)):.0f} cm in the"
            f" median, 95 %: {100 * float(np.quantile(off, 0.95)):.0f} cm"
            + (f"; they are lost, {LOST_TEXT}, at {lost:.0%} of the scans." if lost else ".")
        )
        return lines

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
        off = self.log_distance[self.is_trusted]
        return nan_to_none(
            {
                "map": self.map,
                "drive": self.drive,
                "scans": len(self),
                "sentences": self.sentences,
                "deviation": self._median,
                "not_trusted": int((~self.is_trusted).sum()),
                "stretches": [[jump.start, jump.stop] for jump in self.doubtful_stretches],
                "jumps": [vars(jump) for jump in self.jumps],
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
            Column("off", "m"): self.log_distance,
            Column("doubt"): np.array(DOUBTS)[self.doubts],
        }
        return Table(tuple(values), tuple(zip(*(v.tolist() for v in values.values()), strict=True)))

    def _write(self, folder: Path, *related: Any) -> None:
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
        trusted_scans = np.flatnonzero(self.is_trusted)
        times = np.arange(len(self), dtype=float) if self.times is None else self.times
        half, zeros = self.poses[trusted_scans, 2] / 2, np.zeros(len(trusted_scans))
        rows = (
            times[trusted_scans],
            *self.poses[trusted_scans, :2].T,
            zeros,
            zeros,
            zeros,
            np.sin(half),
            np.cos(half),
        )
        np.savetxt(file, np.column_stack(rows), "%.9f" + 7 * " %.6f")

    def figure(self) -> Figure:
        """The trajectory over the map, coloured by its deviation, and that along the way.

        Crosses are poses that are not to be trusted, and the thin line is the log's own poses.
        """
        from locplan.recordings.figures import trajectory_figure

        return trajectory_figure(self)

    def report(self) -> str:
        """What was found and how odometry errs."""
        return trajectory_report(self)


def trajectory_report(drive_trajectory: Trajectory) -> str:
    """What was found and how odometry errs."""
    rows = [("map", drive_trajectory.map), ("drive", drive_trajectory.drive or "a recording")]
    for n, stretch in enumerate(drive_trajectory.doubtful_stretches[:MAX_STRETCHES]):
        at, doubt = (
            drive_trajectory.poses[stretch.start],
            np.bincount(drive_trajectory.doubts[stretch]).argmax(),
        )
        first, last = stretch.start, stretch.stop - 1
        scan_text = f"scan {first}" if first == last else f"scans {first} to {last}"
        place = f"{scan_text} at {at[0]:.1f},{at[1]:.1f}"
        rows.append(("" if n else "not trusted", f"{place}: {DOUBTS[doubt]}"))
    if (n_hidden := len(drive_trajectory.doubtful_stretches) - MAX_STRETCHES) > 0:
        rows.append(("", f"and {n_hidden} more, which -o writes into poses.csv"))
    if (model := drive_trajectory.odometry) is not None and drive_trajectory.is_trusted.any():
        x, y, yaw = model.mount
        ways = f"{abs(model.scale):.1%} too {'short' if model.scale > 0 else 'long'}"
        turns = f"{abs(model.turn_scale):.1%} too {'small' if model.turn_scale > 0 else 'large'}"
        side = "left" if model.bend > 0 else "right"
        bend = f"{math.degrees(abs(model.bend)):.2f} deg/m to the {side}"
        odometry_text = f"reports ways {ways} and turns {turns}; its straight ways bend by {bend}"
        mount = f"off by {x:+.2f},{y:+.2f} m, {math.degrees(yaw):+.1f} deg"
        rows += [("odometry", odometry_text), ("lidar's mount", mount)]
    return "\n".join([" ".join(drive_trajectory.sentences), format_table([], rows)])
