"""Detection of faults of a recorded drive without ground truth: odometry, stamps, and the map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from locplan._support.checks import check_instance
from locplan._support.kernels.arrays import Array, Bools, Floats, Ints, Octets
from locplan._support.poses import (
    compute_motions,
    compute_travel_distances,
    move_ends_to_poses,
    wrap_angles,
)
from locplan.errors import RecordingError
from locplan.field.scan import Scan, make_likelihood_field
from locplan.field.search_window import SearchWindow
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.recordings.evaluation import look_up_cells, match_scans
from locplan.recordings.recording import Recording

WAY, TURN, SECONDS, SCANS = 0.25, math.radians(15), 1.0, 10
"""Distance [m], turn [rad] and time [s] that end a step; without times, the number of scans."""
CELL, HALF_STEPS, HALF_TURNS = 0.05, 24, 15
"""Spacing of the lattice of motions [m], and its number of steps and of 1 deg turns to each
side."""
SIGMA, ANYWHERE = 0.1, 0.5
"""Standard deviation of an end from the previous scan [m], and likelihood of an end anywhere."""
REACH, RETURNS = 12.0, 10
"""Maximum compared range [m], and minimum number of returns."""
GRAZING = 10.0
"""Maximum distance of neighbouring ends on a wall, relative to a wall across the beams."""
MAX_STEP_DISTANCE = 2.0
"""Maximum distance of a compared step [m]. Scans on both sides of a gap have little in common."""
MAX_STEP_TURN = math.radians(30)
"""Maximum turn of a compared step, because odometry and scans have different stamps [rad]."""
MIN_DISAGREEMENT, GAIN, FIT = 0.16, 0.07, 0.5
"""Odometry and scans disagree if the best motion differs from odometry by at least this distance
[m], gains at least this score, and has at least this score."""
NEXT_GAIN = 0.02
"""Minimum gain at steps next to a disagreement, because faults usually last several steps."""


@dataclass(frozen=True, eq=False)
class ScanSteps:
    """Motions of the robot in k steps of a drive, by odometry and by scan matching.

    Motions are relative to the pose before the step: forward, left, turn [m, m, rad].
    """

    scans: Ints
    """Scans at which the steps begin and end, (k + 1,)."""
    reported: Floats
    """Motions by odometry, (k, 3)."""
    measured: Floats
    """Motions with the best score, (k, 3); NaN for steps without comparison."""
    scores: Floats
    """Best scores, (k,)."""
    gains: Floats
    """Best scores minus scores of odometry (within a cell, at any turn), (k,)."""
    is_hidden: Bools
    """Mask of steps at which several motions score well, as along corridors, (k,)."""

    @property
    def is_compared(self) -> Bools:
        """Mask of the compared steps, with enough returns and a small motion, (k,)."""
        return np.isfinite(self.scores)

    @property
    def errors(self) -> Floats:
        """Distances between measured and reported motions, (k,) [m]; NaN without comparison."""
        return np.asarray(np.hypot(*(self.measured - self.reported)[:, :2].T))

    @property
    def is_contradicted_by_scans(self) -> Bools:
        """Mask of the steps at which the scans contradict odometry, (k,)."""
        turn_error = np.abs(self.measured[:, 2] - self.reported[:, 2])
        # A motion at the edge of the lattice is unreliable: the true turn lies outside.
        is_inside = turn_error < math.radians(HALF_TURNS - 0.5)
        is_apart = is_inside & (self.errors > MIN_DISAGREEMENT) & (self.scores > FIT)
        is_likely, is_sure = (is_apart & (self.gains > gain) for gain in (NEXT_GAIN, GAIN))
        runs = np.cumsum(np.diff(is_likely, prepend=False))
        return np.asarray(is_likely & np.isin(runs, runs[is_sure]))

    @property
    def motions(self) -> Floats:
        """Motions by the scans if they contradict odometry, otherwise by odometry, (k, 3)."""
        return np.where(self.is_contradicted_by_scans[:, None], self.measured, self.reported)


def measure_steps(recording: Recording) -> ScanSteps:
    """Compare odometry with the motion by scan matching.

    Parameters
    ----------
    recording : Recording
        The drive, with odometry.
    """
    from locplan._support.kernels.likelihood import make_scan_lattice

    odometry = recording.odometry
    assert odometry is not None
    scans = find_step_ends(odometry, recording.times)
    reported = compute_motions(odometry[scans[:-1]], odometry[scans[1:]])
    reported[:, 2] = wrap_angles(reported[:, 2])
    outlines, ends = _find_wall_ends(recording, scans), _select_beam_ends(recording, scans)
    lattice = make_scan_lattice(HALF_STEPS, np.radians(np.arange(-HALF_TURNS, HALF_TURNS + 1.0)))
    measured = np.full_like(reported, np.nan)
    scores, gains = np.full(len(reported), np.nan), np.zeros(len(reported))
    hidden = np.zeros(len(reported), np.bool_)
    for n, motion in enumerate(reported):
        is_seen = min(len(outlines[n][0]), len(ends[n + 1])) >= RETURNS
        is_short = math.hypot(*motion[:2]) <= MAX_STEP_DISTANCE and abs(motion[2]) <= MAX_STEP_TURN
        if not (is_seen and is_short):
            continue
        values = _score_motions(motion, *outlines[n], ends[n + 1], lattice)
        turn, left, ahead = map(int, np.unravel_index(int(np.argmax(values)), values.shape))
        offset = np.array([ahead - HALF_STEPS, left - HALF_STEPS, turn - HALF_TURNS])
        measured[n] = motion + offset * (CELL, CELL, math.radians(1))
        scores[n], any_turn = values[turn, left, ahead], values.max(axis=0)
        # Odometry may err by a cell, and in its turn.
        gains[n] = (
            scores[n]
            - any_turn[_compute_lattice_distances(HALF_STEPS, HALF_STEPS) < 1.2 * CELL].max()
        )
        distances = _compute_lattice_distances(left, ahead)
        hidden[n] = (
            scores[n] - any_turn[(distances > 4.5 * CELL) & (distances < 6.5 * CELL)].max() < GAIN
        )
    return ScanSteps(scans, reported, measured, scores, gains, hidden)


def find_step_ends(odometry: Floats, times: Floats | None) -> Ints:
    """Find the scans at which steps end, by distance, turn, or time."""
    way = compute_travel_distances(odometry)
    turn_sums = np.append(0.0, np.cumsum(np.abs(wrap_angles(np.diff(odometry[:, 2])))))
    passed = np.arange(len(way)) / SCANS if times is None else (times - times[0]) / SECONDS
    progress, scans = np.column_stack([way / WAY, turn_sums / TURN, passed]), [0]
    for n, step_progress in enumerate(progress):
        if (step_progress - progress[scans[-1]] >= 1.0).any():
            scans.append(n)
    return np.array(scans)


def _select_beam_ends(recording: Recording, scans: Ints) -> list[Floats]:
    """Select ends of about 180 beams per scan, in the robot's frame, (b, 2) [m]."""
    beam_slice = slice(None, None, max(1, recording.lidar.beams // 180))
    scan_subset = recording[scans]
    near = scan_subset.ranges[:, beam_slice] < REACH
    ends = scan_subset.ends_on_robot()[:, beam_slice]
    return [part[is_near] for part, is_near in zip(ends, near, strict=True)]


def _find_wall_ends(recording: Recording, scans: Ints) -> list[tuple[Floats, Bools]]:
    """Find the beam ends of each scan that have a neighbour on the same wall.

    Returns the ends, and the mask of ends that are joined to the next one. Isolated ends are
    dropped: in a corridor, they occur at the same angles everywhere, as if the robot stood still.
    """
    scan_subset = recording[scans]
    angles, outlines = recording.lidar.angles, []
    spacing = GRAZING * abs(float(angles[1] - angles[0])) if len(angles) > 1 else 0.0
    for ends, ranges in zip(scan_subset.ends_on_robot(), scan_subset.ranges, strict=True):
        near, gaps = ranges < REACH, np.hypot(*np.diff(ends, axis=0).T)
        widest = np.maximum(2 * CELL, spacing * np.minimum(ranges[1:], ranges[:-1]))
        is_joined = near[1:] & near[:-1] & (gaps < widest)
        has_neighbour = np.append(is_joined, False) | np.append(False, is_joined)
        outlines.append((ends[has_neighbour], np.append(is_joined, False)[has_neighbour]))
    return outlines


def _score_motions(
    reported_motion: Floats, wall_ends: Floats, is_joined: Bools, ends: Floats, lattice: Any
) -> Array:
    """Score motions around a reported one by a scan's ends, (turn, left, forward)."""
    from locplan._support.kernels.likelihood import TOP
    from locplan._support.kernels.posterior import score_scan

    low = wall_ends.min(axis=0) - CELL
    field = make_likelihood_field(
        _draw_scan_map(wall_ends, is_joined, low), CELL, 1, HALF_STEPS, SIGMA, ANYWHERE
    )
    position = (reported_motion[:2] - low) / CELL
    cell = np.floor(position).astype(np.int64)
    cos, sin = math.cos(reported_motion[2]), math.sin(reported_motion[2])
    rotated_ends = ends @ np.array([[cos, sin], [-sin, cos]]) / CELL + (position - cell - 0.5)
    costs = np.empty_like(lattice.empty)
    score_scan(field, lattice, int(cell[1]), int(cell[0]), rotated_ends, costs)
    rows, side = lattice.plane // lattice.width, lattice.offsets
    values = costs.reshape(-1, rows, lattice.width)[:, :side, :side]
    return np.asarray(1.0 - values / (TOP * len(ends)))


def _draw_scan_map(wall_ends: Floats, is_joined: Bools, corner: Floats) -> Octets:
    """Draw a map of a scan, with walls between joined ends."""
    import cv2

    places = np.floor((wall_ends - corner) / CELL).astype(np.int32)
    cols, rows = places.max(axis=0) + 2
    levels = np.full((rows, cols), FREE, np.uint8)
    lines = [places[n : n + 2] for n in np.flatnonzero(is_joined)]
    cv2.polylines(levels, lines, False, (float(OCCUPIED),))
    return levels


def _compute_lattice_distances(row: int, col: int) -> Floats:
    """Compute the distances of the lattice's positions from one of them [m]."""
    rows, cols = np.mgrid[: 2 * HALF_STEPS + 1, : 2 * HALF_STEPS + 1]
    return np.asarray(CELL * np.hypot(rows - row, cols - col))


SPACING, MISFIT_DISTANCE, FARTHEST = 0.25, 0.1, 0.5
"""Distance between scans that are compared with the map, mean distance of their ends from walls
above which the map does not fit, and bound on the distance of an end [m]."""


@dataclass(frozen=True)
class MisfitStretch:
    """The longest stretch of a drive along which the map does not fit the scans."""

    x: float
    """Recorded position at its middle [m]."""
    y: float
    """Recorded position at its middle [m]."""
    length: float
    """Length of the stretch [m]; 0 if the map fits all scans."""


def find_longest_misfit(recording: Recording, grid: OccupancyGrid) -> MisfitStretch:
    """Find the longest stretch of a drive along which beams end away from a map's walls.

    Parameters
    ----------
    recording : Recording
        The drive; pose errors of up to 0.5 m and 4 deg are tolerated.
    grid : OccupancyGrid
        The map.
    """
    check_grid(grid)
    way = compute_travel_distances(recording.poses)
    scans = np.unique(np.searchsorted(way, [*np.arange(0.0, way[-1], SPACING), way[-1]]))
    scan_subset, way = recording[scans], way[scans]
    distances = _compute_wall_distances(scan_subset, scan_subset.poses, grid)
    for n in np.array_split(
        far := np.flatnonzero(distances > MISFIT_DISTANCE), len(far) // 500 + 1
    ):
        if len(n):
            poses = scan_subset.poses[n] + _find_best_offsets(scan_subset[n], grid)
            distances[n] = np.minimum(
                distances[n], _compute_wall_distances(scan_subset[n], poses, grid)
            )
    is_away = np.concatenate([[False], distances > MISFIT_DISTANCE, [False]])
    begins, ends = (np.flatnonzero(np.diff(is_away.astype(int)) == sign) for sign in (1, -1))
    lengths = way[ends - 1] - way[begins]
    if not lengths.any():
        x, y, _ = scan_subset.poses[0].tolist()
        return MisfitStretch(x, y, 0.0)
    longest = int(np.argmax(lengths))
    x, y, _ = scan_subset.poses[(begins[longest] + ends[longest]) // 2].tolist()
    return MisfitStretch(x, y, float(lengths[longest]))


def _compute_wall_distances(recording: Recording, poses: Floats, grid: OccupancyGrid) -> Floats:
    """Compute the mean distance of each scan's ends from walls, (n,) [m]; 0 with few returns."""
    ends = move_ends_to_poses(recording.ends_on_robot(), poses)
    wall_distances = look_up_cells(grid, grid.clearance, ends, math.inf)
    returns = np.isfinite(ends[..., 0])
    count = returns.sum(axis=1)
    total = np.where(returns, np.minimum(wall_distances, FARTHEST), 0.0).sum(axis=1)
    return np.where(count >= RETURNS, total / np.maximum(count, 1), 0.0)


def _find_best_offsets(recording: Recording, grid: OccupancyGrid) -> Floats:
    """Find the offsets from recorded poses at which scans fit best, (n, 3) [m, m, rad]."""
    window = SearchWindow(half_width=0.5, step=0.1, half_rotation_deg=4.0, rotation_step_deg=1.0)
    settings = Scan(recording.lidar, window=window, effective_beams=15.0)
    try:
        return match_scans(recording, grid, settings=settings, threads=1).best
    except RecordingError:  # no pose lies on the map
        return np.zeros((len(recording), 3))


BACK, FORWARD = -0.075, 0.05
"""Backward motion by the scans, and forward motion by odometry, in a reversed step [m]."""
MIN_REVERSED_STEPS = 3
"""Minimum number of steps with a wrong sign for a sign fault; they must be over half."""
SAME_PLACE = 1.0
"""Maximum distance between two steps at the same place [m]."""
LARGE = 1.3
"""Error of odometry at one place above which precise settings lose the robot [m]: standstill over
2 m does, slips of 1 m do not."""
HIDDEN = 0.1
"""Share of hidden steps above which the faults may be incomplete."""
JUMP, FASTEST, OFTEN = 1.0, 3.0, 4.0
"""Minimum distance [m] and speed [m/s] of a jump of odometry, and minimum ratio to the 95 %
quantile of all steps."""
NEAR_ZERO = 0.1
"""Maximum distance from zero, or from the first pose, after a reset of odometry [m]."""
MOVING = 0.02
"""Minimum step [m] and speed [m/s] to compare their signs."""
STRETCH = 2.0
"""Length of a misfit above which the map does not fit [m]; good maps have up to 1 m."""


@dataclass(frozen=True)
class OdometryDisagreement:
    """Disagreement between odometry and scans at a place of a drive."""

    x: float
    """Position x at the beginning, recorded or by odometry [m]."""
    y: float
    """Position y at the beginning, recorded or by odometry [m]."""
    error: float
    """Sum of the differences between the motions [m]."""


@dataclass(frozen=True)
class WrongSigns:
    """Steps at which odometry's pose and velocity have opposite signs."""

    n_opposite: int
    """Number of steps with opposite signs."""
    n_compared: int
    """Number of compared steps with a velocity of this sign."""
    is_negative: bool
    """True if the velocity is negative."""

    @property
    def sentence(self) -> str:
        """Sentence for people."""
        pose, velocity = ("forward", "negative") if self.is_negative else ("back", "positive")
        return (
            f"Odometry's pose moves {pose} at {self.n_opposite:,} of {self.n_compared:,} steps"
            f" with a {velocity} velocity. Correct the sign in its driver, and record again."
        )


@dataclass(frozen=True, eq=False, repr=False)
class RecordingFaults:
    """Faults of a recorded drive.

    Exclude `faulty_steps` from a fit of odometry's drift. A recording that is not sound is no
    evidence for settings that trust odometry and map.
    """

    faulty_steps: Bools
    """Mask of the steps between scans at which odometry is wrong, (scans - 1,)."""
    disagreements: tuple[OdometryDisagreement, ...]
    """Places where odometry and scans disagree by over 0.15 m per step, in order."""
    n_backward_steps: int
    """Number of steps with backward motion by the scans."""
    n_reversed_steps: int
    """Number of backward steps at which odometry moves forward."""
    reversed_way: float
    """Total distance by odometry in reversed steps [m]."""
    n_steps: int
    """Number of compared steps of about 0.25 m or 15 deg."""
    n_hidden_steps: int
    """Number of steps at which scans do not show all motions, as along corridors."""
    wrong_signs: tuple[WrongSigns, ...]
    """Contradictions between odometry's velocity and its pose."""
    n_jumps: int
    """Number of impossible steps of odometry, including resets."""
    n_resets: int
    """Number of jumps to zero, or to the first pose."""
    stamps_back: int
    """Number of scans with a stamp before the stamp of an earlier scan."""
    misfit: MisfitStretch | None
    """The longest stretch where the map does not fit; None without a map."""

    def __repr__(self) -> str:
        return f"RecordingFaults({' '.join(self.sentences) or 'none'})"

    @property
    def drops_sign(self) -> bool:
        """True if odometry moves forward at most backward steps."""
        return (
            self.n_reversed_steps >= MIN_REVERSED_STEPS
            and 2 * self.n_reversed_steps > self.n_backward_steps
        )

    @property
    def has_sign_fault(self) -> bool:
        """True if odometry's sign contradicts the scans, or its velocity."""
        return self.drops_sign or bool(self.wrong_signs)

    @property
    def has_misfit(self) -> bool:
        """True if the map does not fit the scans along over 2 m."""
        return self.misfit is not None and self.misfit.length > STRETCH

    @property
    def is_sound(self) -> bool:
        """True if the recording is evidence for settings that trust odometry and map.

        Slips of up to 1.3 m and stamps out of order are harmless, because scans keep their order.
        """
        is_large = any(place.error > LARGE for place in self.disagreements)
        is_broken = self.has_sign_fault or self.has_misfit or is_large
        return not (is_broken or self.n_jumps)

    @property
    def fault_sentences(self) -> tuple[str, ...]:
        """Faults as sentences for people."""
        texts = [signs.sentence for signs in self.wrong_signs]
        if self.drops_sign:
            texts.append(
                f"Odometry moves forward at {self.n_reversed_steps:,} of {self.n_backward_steps:,}"
                f" places where the scans move back ({self.reversed_way:.2g} m). Probably the"
                " driver drops the sign of the velocity."
            )
        elif self.disagreements:
            worst = max(self.disagreements, key=lambda place: place.error)
            texts.append(
                "Odometry and scans disagree by more than 0.15 m per step at"
                f" {_format_place_count(len(self.disagreements))}, most at"
                f" {_format_position(worst)}, by {worst.error:.1f} m."
            )
        if self.n_jumps:
            resets = f", to its start at {self.n_resets:,} of them" if self.n_resets else ""
            texts.append(f"Odometry jumps at {_format_place_count(self.n_jumps)}{resets}.")
        if self.stamps_back:
            texts.append(f"The stamps of {self.stamps_back:,} scans are out of order.")
        if self.has_misfit and self.misfit is not None:
            texts.append(
                f"The map does not fit the scans at {_format_position(self.misfit)}, over"
                f" {self.misfit.length:.2g} m."
            )
        return tuple(texts)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Faults and limits of their detection, as sentences for people."""
        if self.n_hidden_steps <= HIDDEN * self.n_steps:
            return self.fault_sentences
        hidden = (
            f"The scans cannot show motion along corridors at {self.n_hidden_steps:,} of"
            f" {self.n_steps:,} steps."
        )
        return (*self.fault_sentences, hidden)


def _format_place_count(count: int) -> str:
    """Format a number of places."""
    return "1 place" if count == 1 else f"{count:,} places"


def _format_position(place: OdometryDisagreement | MisfitStretch) -> str:
    """Format the position of a place."""
    return f"({place.x:.1f}, {place.y:.1f})"


def find_recording_faults(
    recording: Recording, grid: OccupancyGrid | None = None
) -> RecordingFaults:
    """Find faults of a recorded drive, without ground truth.

    Odometry is compared with the motion between scans about 0.25 m apart, and with its velocity.
    Scans do not show motion along corridors; `n_hidden_steps` counts such steps.

    Parameters
    ----------
    recording : Recording
        The drive. Its poses are only used for the comparison with the map; errors of up to 0.5 m
        are tolerated.
    grid : OccupancyGrid, optional
        The map.

    Returns
    -------
    RecordingFaults
        The faults, as numbers and sentences.

    Examples
    --------
    >>> import locplan
    >>> from locplan.recordings import record_drive
    >>> grid = locplan.maps.environments.make("office", resolution=0.1)
    >>> robot = locplan.Robot(locplan.Lidar(range=8.0, beams=180))
    >>> drive = record_drive(grid, locplan.Path([[7.0, 7.0], [14.0, 7.0]]), robot)
    >>> find_recording_faults(drive, grid).is_sound
    True
    """
    check_instance(
        "recording", recording, Recording, "read one with locplan.recordings.read_recording"
    )
    # Poses are only used with the map: odometry and scans are compared with each other.
    stretch = (
        find_longest_misfit(recording, grid) if grid is not None and recording.has_poses else None
    )
    odometry, count = recording.odometry, len(recording)
    if odometry is None:
        no_faults = np.zeros(count - 1, np.bool_)
        return RecordingFaults(
            no_faults, (), 0, 0, 0.0, 0, 0, (), 0, 0, recording.source.stamps_back, stretch
        )
    jumps, resets = find_odometry_jumps(odometry, recording.times)
    steps = measure_steps(recording)
    is_judged = steps.is_compared & ~_merge_scan_step_mask(jumps, steps.scans)
    disagree = steps.is_contradicted_by_scans & is_judged
    moves_back = (steps.motions[:, 0] < BACK) & is_judged
    is_reversed = disagree & moves_back & (steps.reported[:, 0] > FORWARD)
    return RecordingFaults(
        faulty_steps=jumps | _split_into_scan_step_mask(_widen_mask(disagree), steps.scans, count),
        disagreements=_find_disagreements(recording, steps, disagree),
        n_backward_steps=int(moves_back.sum()),
        n_reversed_steps=int(is_reversed.sum()),
        reversed_way=float(np.hypot(*steps.reported[is_reversed, :2].T).sum()),
        n_steps=len(is_judged),
        n_hidden_steps=int((steps.is_hidden | ~is_judged).sum()),
        wrong_signs=_find_wrong_signs(recording),
        n_jumps=int(jumps.sum()),
        n_resets=int(resets.sum()),
        stamps_back=recording.source.stamps_back,
        misfit=stretch,
    )


def find_odometry_jumps(odometry: Floats, times: Floats | None) -> tuple[Bools, Bools]:
    """Find impossible steps of odometry, and resets among them; two masks (n - 1,)."""
    lengths = np.hypot(*np.diff(odometry[:, :2], axis=0).T)
    if not len(lengths):
        return lengths > 0, lengths > 0
    is_jump = lengths > max(JUMP, OFTEN * float(np.quantile(lengths, 0.95)))
    if times is not None:
        speeds = lengths / np.maximum(np.diff(times), 1e-3)
        is_jump &= speeds > max(FASTEST, OFTEN * float(np.quantile(speeds, 0.95)))
    ends = odometry[1:, :2]
    from_start = np.minimum(np.hypot(*ends.T), np.hypot(*(ends - odometry[0, :2]).T))
    return is_jump, is_jump & (from_start < NEAR_ZERO)


def _widen_mask(is_marked: Bools) -> Bools:
    """Add the steps before and after marked ones, because faults begin and end within steps."""
    return (
        np.asarray(np.convolve(is_marked, np.ones(3), "same") > 0) if len(is_marked) else is_marked
    )


def _merge_scan_step_mask(is_marked: Bools, step_ends: Ints) -> Bools:
    """Convert a mask of steps between scans to steps between ends that contain a marked step."""
    before = np.append(0, np.cumsum(is_marked))
    return np.asarray(before[step_ends[1:]] > before[step_ends[:-1]])


def _split_into_scan_step_mask(is_marked: Bools, step_ends: Ints, n_scans: int) -> Bools:
    """Convert a mask of steps between ends to all steps between scans within marked ones."""
    of_step = np.searchsorted(step_ends, np.arange(n_scans - 1), side="right") - 1
    is_within = of_step < len(is_marked)
    return np.asarray(is_within & np.append(is_marked, False)[np.minimum(of_step, len(is_marked))])


def _find_disagreements(
    recording: Recording, steps: ScanSteps, is_disagreeing: Bools
) -> tuple[OdometryDisagreement, ...]:
    """Find the disagreements, with steps near each other merged."""
    odometry = recording.odometry
    assert odometry is not None
    numbers, way = np.flatnonzero(is_disagreeing), compute_travel_distances(odometry)[steps.scans]
    poses = recording.poses if recording.has_poses else odometry
    if not len(numbers):
        return ()
    is_apart = way[numbers[1:]] - way[numbers[:-1] + 1] > SAME_PLACE
    places = []
    for group in np.split(numbers, np.flatnonzero(is_apart) + 1):
        x, y, _ = poses[steps.scans[group[0]]].tolist()
        places.append(OdometryDisagreement(x, y, float(steps.errors[group].sum())))
    return tuple(places)


def _find_wrong_signs(recording: Recording) -> tuple[WrongSigns, ...]:
    """Compare the signs of velocities with the signs of the adjacent steps of the pose."""
    odometry, speeds = recording.odometry, recording.speeds
    if odometry is None or speeds is None:
        return ()
    ahead, faults = compute_motions(odometry[:-1], odometry[1:])[:, 0], []
    for sign in (-1.0, 1.0):
        # Both ends need this sign, otherwise the velocity changes within the step.
        is_clear = (sign * speeds[:-1] > MOVING) & (sign * speeds[1:] > MOVING)
        is_clear &= np.abs(ahead) > MOVING
        count = int((is_clear & (sign * ahead < 0)).sum())
        if count >= MIN_REVERSED_STEPS and 2 * count > is_clear.sum():
            faults.append(WrongSigns(count, int(is_clear.sum()), sign < 0))
    return tuple(faults)
