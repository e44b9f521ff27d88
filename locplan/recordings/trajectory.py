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
from locplan._support.records import POSE, Result, Table, TableColumn
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
    """Moves between n scans by odometry; the first one is zero."""

    ways: Floats
    """Pose of each scan relative to the previous one, (n, 3) [m, m, rad]."""
    lengths: Floats
    """Length of the path between the scans [m], (n,)."""
    turn_sums: Floats
    """Sum of the absolute turns between the scans [rad], (n,)."""

    @classmethod
    def from_odometry(cls, odometry: Floats, scans: NDArray[np.int64]) -> OdometryMoves:
        """Compute the moves between selected scans of a drive."""
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
        """Regressors of the error variances, (n, 3)."""
        return np.column_stack([self.lengths, self.turn_sums, np.ones(len(self.lengths))])


@dataclass(frozen=True, eq=False)
class OdometryModel(EqualByValue):
    """Error model of the odometry of one drive: systematic corrections, and random errors.

    Errors follow Student's distribution with 4 degrees of freedom, independent between scans.
    """

    scale: float
    """Ratio of true to reported distances, minus 1."""
    bend: float
    """Curvature to the left of paths that odometry reports as straight [rad/m]."""
    turn_scale: float
    """Ratio of true to reported turns, minus 1."""
    mount: tuple[float, float, float]
    """Correction of the lidar's mount that the drive shows [m, m, rad]."""
    variances: Floats
    """Squared scales of the errors, (3, 3) [m^2, m^2, rad^2]: rows are forward, left and turn;
    columns are per metre, per radian, and per scan."""

    @classmethod
    def make_prior(cls, odometry: Odometry) -> OdometryModel:
        """Make the initial model, with wide errors, or the wider errors of the robot's odometry.

        Parameters
        ----------
        odometry : Odometry
            The odometry of the robot.
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
        """Correct the systematic errors of reported moves, (n, 3) [m, m, rad].

        Parameters
        ----------
        moves : OdometryMoves
            The reported moves.
        """
        ahead, left, turn = moves.ways.T
        turn = turn * (1 + self.turn_scale) + self.bend * moves.lengths
        robot = np.column_stack([ahead * (1 + self.scale), left * (1 + self.scale), turn])
        lidar = np.broadcast_to(np.array(self.mount), robot.shape)
        return compute_motions(lidar, apply_motions(robot, lidar))

    def compute_deviations(self, moves: OdometryMoves) -> Floats:
        """Compute the scales of the random errors of moves, (n, 3) [m, m, rad].

        Parameters
        ----------
        moves : OdometryMoves
            The reported moves.
        """
        return np.asarray(np.sqrt(moves.features @ self.variances.T))

    def refit(
        self, moves: OdometryMoves, true_ways: Floats, way_variances: Floats, move_weights: Floats
    ) -> OdometryModel:
        """Fit the model to true moves by expectation maximisation.

        Parameters
        ----------
        moves : OdometryMoves
            The reported moves.
        true_ways : (n, 3) array
            The true moves [m, m, rad].
        way_variances : (n, 3) array
            Variances of the true moves; without them, the variances of odometry would vanish.
        move_weights : (n,) array
            Weight of each move: 1, or 0 for a jump.
        """
        model = self
        for _ in range(3):
            model = model._refit_biases(moves, true_ways, move_weights)
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
                variances[axis] = fit_variances(squares, moves.features, zeros, move_weights)
            # Keep a minimum, because no odometry is without errors.
            min_variances = np.array([0.005, 0.005, math.radians(0.1)]) ** 2
            variances[:, 2] = np.maximum(variances[:, 2], min_variances)
            model = replace(model, variances=variances)
        return model

    def _refit_biases(
        self, moves: OdometryMoves, true_ways: Floats, move_weights: Floats
    ) -> OdometryModel:
        """Return the model with systematic errors fitted by robust regression."""
        ahead, left, turn = moves.ways.T
        cos, sin = np.cos(turn) - 1, np.sin(turn)
        deviations = self.compute_deviations(moves)
        off = true_ways - moves.ways
        off[:, TURN] = wrap_angles(off[:, TURN])
        # A wrong mount of the lidar shows in turns, in which the lidar circles around the robot.
        features = [
            np.column_stack([ahead, left, cos, -sin]),
            np.column_stack([left, -ahead, sin, cos]),
        ]
        scaled_features = np.concatenate(
            [axis_features / deviations[:, [n]] for n, axis_features in enumerate(features)]
        )
        places = np.concatenate([off[:, AHEAD] / deviations[:, 0], off[:, LEFT] / deviations[:, 1]])
        scale, yaw, x, y = _fit_robust_coefficients(
            scaled_features, places, np.tile(move_weights, 2), (0.1, 0.1, 0.2, 0.2)
        )
        turns = np.column_stack([turn, moves.lengths]) / deviations[:, [TURN]]
        scaled_turns = off[:, TURN] / deviations[:, TURN]
        turn_scale, bend = _fit_robust_coefficients(turns, scaled_turns, move_weights, (0.2, 0.1))
        return OdometryModel(scale, bend, turn_scale, (x, y, yaw), self.variances)


def _fit_robust_coefficients(
    features: Floats, values: Floats, sample_weights: Floats, prior_deviations: tuple[float, ...]
) -> list[float]:
    """Fit coefficients by least squares with Student's weights, and a prior around zero."""
    prior = np.diag(1 / np.square(prior_deviations))
    coefficients: Floats = np.zeros(len(prior_deviations))
    for _ in range(6):
        weights = (
            sample_weights * (FREEDOM + 1) / (FREEDOM + (values - features @ coefficients) ** 2)
        )
        weighed = (features * weights[:, None]).T
        coefficients = np.asarray(np.linalg.solve(weighed @ features + prior, weighed @ values))
    return list(map(float, coefficients))


def compute_moves_with_variances(
    poses: Floats, covariances: Floats, cross_covariances: Floats
) -> tuple[Floats, Floats]:
    """Compute the moves between n poses, and their variances; the first move is zero.

    Parameters
    ----------
    poses : (n, 3) array
        The poses [m, m, rad].
    covariances, cross_covariances : (n, 3, 3) arrays
        Covariances of the poses, and of each pose with the previous one.
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
        [
            [covariances[:-1], cross_covariances[1:].transpose(0, 2, 1)],
            [cross_covariances[1:], covariances[1:]],
        ]
    )
    variances[1:] = np.einsum("nij,njk,nik->ni", jacobian, joint, jacobian)
    return ways, variances


def fit_variances(
    squares: Floats,
    features: Floats,
    known_variances: Floats,
    weights: Floats,
    first_coefficients: Floats | None = None,
) -> Floats:
    """Fit non-negative variance coefficients of Gaussian values by maximum likelihood.

    The variance of a value is ``features @ coefficients + fixed``. Each round is a step of Fisher's
    scoring: least squares of the squared values, weighted by their current precision.
    """
    scale = np.maximum(weights @ features, TINY)
    coefficients = weights @ squares / scale if first_coefficients is None else first_coefficients
    # Bound the weight of values with a tiny variance.
    min_variance = 1e-3 * float(weights @ squares / max(weights.sum(), TINY)) + TINY
    for _ in range(12):
        variance = np.maximum(features @ coefficients + known_variances, min_variance)
        weighted_features = (weights / variance**2)[:, None] * features
        coefficients = (
            coefficients
            + _solve_nonnegative(
                weighted_features.T @ features, weighted_features.T @ (squares - known_variances)
            )
        ) / 2
    return np.asarray(coefficients)


def _solve_nonnegative(matrix: Floats, vector: Floats) -> Floats:
    """Solve normal equations of least squares; negative coefficients are set to zero."""
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
    "the standard deviation is over 15 cm or 4 deg",
    "other places explain the scans equally well",
    "the scan does not fit the map",
    "odometry jumps",
    "the map is probably displaced",
)
"""Reasons to doubt a pose; 0 means that the pose is trusted."""
CARRIED = 3.0
"""Maximum distance of a jump of odometry that wheel slip can explain [m]."""
SMOOTHED = "smoothed"
"""Source of poses that come from a trajectory."""
MAX_STRETCHES = 20
"""Maximum number of doubtful stretches in the report."""


@dataclass(frozen=True)
class OdometryJump:
    """A jump of odometry relative to the true motion."""

    scan: int
    """Index of the first scan after the jump."""
    kind: str
    """Kind: "slip" of wheels up to 3 m, "carried" robot beyond 3 m, or "gap" in the log."""
    x: float
    """World x of the robot after the jump [m]."""
    y: float
    """World y of the robot after the jump [m]."""
    distance: float
    """Distance between the true position and the position by odometry [m]."""
    turn: float
    """Difference between the true heading and the heading by odometry [rad]."""


def classify_jump(
    scan_number: int, pose: Floats, error: Floats, times: Floats | None
) -> OdometryJump:
    """Classify the error of odometry before a scan, and return it as a jump."""
    distance, kind = float(np.hypot(error[0], error[1])), "slip"
    steps = np.zeros(1) if times is None else np.diff(times)
    if times is not None and steps[scan_number - 1] > max(5.0, 10 * float(np.median(steps))):
        kind = "gap"
    elif distance > CARRIED:
        kind = "carried"
    return OdometryJump(
        scan_number, kind, float(pose[0]), float(pose[1]), distance, float(error[2])
    )


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Result, StoredResult):
    """Trajectory of a recorded drive: the pose of every scan, its covariance, and doubts."""

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
    """Covariances of the poses, (n, 3, 3) [m, m, rad]."""
    doubts: NDArray[np.int64]
    """Index of the doubt about each pose in `DOUBTS`, (n,); 0 for trusted poses."""
    fits: Floats
    """Log-likelihood per return of each scan, (n,); 0 if all ends lie on walls, NaN without any."""
    jumps: tuple[OdometryJump, ...]
    """The jumps of odometry."""
    odometry: OdometryModel | None
    """Error model of odometry; None without odometry."""
    recorded: Floats
    """The poses of the log, (n, 3) [m, m, rad]."""
    times: Floats | None
    """Times of the scans, (n,) [s]; None without times."""
    drive: str
    """Name of the drive's file."""
    map: str
    """Name of the map."""
    grid: OccupancyGrid | None = field(default=None, compare=False)
    """The map, for the figure; None in a loaded trajectory."""

    def __repr__(self) -> str:
        return (
            f"Trajectory({len(self)} scans, median deviation {100 * self._median_deviation:.1f} cm)"
        )

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def is_drawable(self) -> bool:
        """True if the trajectory has a map to draw on."""
        return self.grid is not None

    @property
    def is_trusted(self) -> NDArray[np.bool_]:
        """Mask of the trusted poses, (n,)."""
        return np.asarray(self.doubts == 0)

    @cached_property
    def deviation(self) -> Floats:
        """Largest standard deviation of each position, (n,) [m]."""
        return position_axes(self.covariances)[0]

    @property
    def _median_deviation(self) -> float:
        return float(np.median(self.deviation))

    @cached_property
    def log_distance(self) -> Floats:
        """Distance between recorded poses and the trajectory, (n,) [m]."""
        return np.asarray(np.hypot(*(self.recorded - self.poses)[:, :2].T))

    @cached_property
    def doubtful_stretches(self) -> list[slice]:
        """Ranges of consecutive doubtful scans."""
        edges = np.flatnonzero(np.diff(np.concatenate([[True], self.is_trusted, [True]])))
        return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]

    def replace_poses(self, recording: Recording) -> Recording:
        """Return the recording with these poses; scans with doubtful poses are dropped.

        Parameters
        ----------
        recording : Recording
            The drive of this trajectory.

        Raises
        ------
        RecordingError
            If no pose is trusted.
        """
        if not self.is_trusted.any():
            raise RecordingError(
                f"all poses on {self.map or 'the map'} are doubtful; use the map of the building"
                " where the drive was recorded"
            )
        poses = self.poses.copy()
        poses.setflags(write=False)
        source = replace(recording.source, poses=SMOOTHED)
        return replace(recording, poses=poses, source=source)[np.flatnonzero(self.is_trusted)]

    @property
    def sentences(self) -> list[str]:
        """Sentences for people on accuracy, doubtful poses and jumps."""
        if not self.is_trusted.any():
            return [
                f"The poses of all {len(self):,} scans are doubtful: check the map, and the topic"
                " of odometry."
            ]
        count = len(self.doubtful_stretches)
        n_doubtful = int((~self.is_trusted).sum())
        doubtful = (
            f"{count} stretch{'es' * (count > 1)} with {n_doubtful} scans"
            f" ({n_doubtful / len(self):.0%}) are doubtful"
            if count
            else "no pose is doubtful"
        )
        lines = [
            f"{len(self):,} scans, known to {100 * self._median_deviation:.0f} cm; {doubtful}."
        ]
        names = {"slip": "wheels slip", "carried": "the robot is carried", "gap": "the log lacks"}
        lines += [
            f"At {jump.x:.1f},{jump.y:.1f} (scan {jump.scan}) {names[jump.kind]}"
            f" {jump.distance:.2g} m, {math.degrees(jump.turn):.0f} deg."
            for jump in self.jumps
        ]
        if self.odometry is None:
            lines.append("The log has no odometry, so its poses were used as odometry.")
        off = self.log_distance[self.is_trusted]
        lost = float((off > LOST_DISTANCE).mean())
        lines.append(
            f"The poses of the log are off by {100 * float(np.median(off)):.0f} cm (median) and"
            f" {100 * float(np.quantile(off, 0.95)):.0f} cm (95 %)"
            + (f"; they are {LOST_TEXT} at {lost:.0%} of the scans." if lost else ".")
        )
        return lines

    def summary(self) -> dict[str, object]:
        """Return the results for JSON."""
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
                "deviation": self._median_deviation,
                "not_trusted": int((~self.is_trusted).sum()),
                "stretches": [[scans.start, scans.stop] for scans in self.doubtful_stretches],
                "jumps": [vars(jump) for jump in self.jumps],
                "log_off": float(np.median(off)) if len(off) else math.nan,
                "odometry": of_odometry,
            }
        )

    def table(self) -> Table:
        """Return a row per scan: pose, standard deviations, and distance of the recorded pose."""
        major, minor, direction = position_axes(self.covariances)
        values: dict[TableColumn, NDArray[Any]] = {
            TableColumn("scan"): np.arange(len(self)),
            TableColumn("time", "s"): np.full(len(self), np.nan)
            if self.times is None
            else self.times,
            **dict(zip(POSE, self.poses.T, strict=True)),
            TableColumn("major_std", "m"): major,
            TableColumn("minor_std", "m"): minor,
            TableColumn("major_axis", "rad"): direction,
            TableColumn("heading_std", "rad"): np.sqrt(self.covariances[:, 2, 2]),
            TableColumn("fit"): self.fits,
            TableColumn("off", "m"): self.log_distance,
            TableColumn("doubt"): np.array(DOUBTS)[self.doubts],
        }
        return Table(tuple(values), tuple(zip(*(v.tolist() for v in values.values()), strict=True)))

    def _write(self, folder: Path, *related_results: Any) -> None:
        self.write(folder / "trajectory.npz")
        self.table().write_csv(folder / "poses.csv")
        self.write_tum(folder / "poses.tum")

    def write_tum(self, file: Path) -> None:
        """Write the trusted poses in TUM format, for evo: time, x, y, z, quaternion.

        Parameters
        ----------
        file : path
            The file; an existing file is replaced.
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
        with file.open("w", encoding="utf-8", newline="\n") as target:
            np.savetxt(target, np.column_stack(rows), "%.9f" + 7 * " %.6f")

    def figure(self) -> Figure:
        """Draw the trajectory on its map, coloured by standard deviation, and the deviation along
        it.

        Crosses mark doubtful poses; the thin line shows the poses of the log.
        """
        from locplan.recordings.figures import trajectory_figure

        return trajectory_figure(self)

    def report(self) -> str:
        """Return a text on accuracy, doubtful stretches, and errors of odometry."""
        return trajectory_report(self)


def trajectory_report(drive_trajectory: Trajectory) -> str:
    """Return a text on accuracy, doubtful stretches, and errors of odometry."""
    rows = [("map", drive_trajectory.map), ("drive", drive_trajectory.drive or "a recording")]
    for n, stretch in enumerate(drive_trajectory.doubtful_stretches[:MAX_STRETCHES]):
        at = drive_trajectory.poses[stretch.start]
        doubt = np.bincount(drive_trajectory.doubts[stretch]).argmax()
        first, last = stretch.start, stretch.stop - 1
        scan_text = f"scan {first}" if first == last else f"scans {first} to {last}"
        place = f"{scan_text} at {at[0]:.1f},{at[1]:.1f}"
        rows.append(("" if n else "doubtful", f"{place}: {DOUBTS[doubt]}"))
    if (n_hidden := len(drive_trajectory.doubtful_stretches) - MAX_STRETCHES) > 0:
        rows.append(("", f"and {n_hidden} more; -o writes all to poses.csv"))
    if (model := drive_trajectory.odometry) is not None and drive_trajectory.is_trusted.any():
        x, y, yaw = model.mount
        ways = f"{abs(model.scale):.1%} too {'short' if model.scale > 0 else 'long'}"
        turns = f"{abs(model.turn_scale):.1%} too {'small' if model.turn_scale > 0 else 'large'}"
        side = "left" if model.bend > 0 else "right"
        bend = f"{math.degrees(abs(model.bend)):.2f} deg/m to the {side}"
        odometry_text = f"distances are {ways}, turns {turns}; straight paths bend by {bend}"
        mount = f"off by {x:+.2f},{y:+.2f} m, {math.degrees(yaw):+.1f} deg"
        rows += [("odometry", odometry_text), ("lidar's mount", mount)]
    return "\n".join([" ".join(drive_trajectory.sentences), format_table([], rows)])
