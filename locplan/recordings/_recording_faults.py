"""Faults of a recorded drive that no ground truth is needed for: odometry, stamps, and the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Ints
from locplan._util.checks import instance
from locplan._util.poses import way_along, way_between
from locplan.maps import OccupancyGrid
from locplan.recordings._misfit_stretch import MisfitStretch, longest_misfit
from locplan.recordings._recording import Recording
from locplan.recordings._scan_steps import ScanSteps, measure_steps

BACK, FORWARD = -0.075, 0.05
"""Motions from which on the scans move back, and odometry moves forward, in a step [m]."""
FEW = 3
"""Least number of steps with a wrong sign that are a driver's fault; they must be over half."""
SAME_PLACE = 1.0
"""Way between two steps up to which they are at the same place [m]."""
LARGE = 1.3
"""Error of odometry at one place from which on precise settings lose a robot for good [m]: it is
2 m of standstill that do, and slips of 1 m that do not."""
HIDDEN = 0.1
"""Share of the steps that scans do not show from which on the faults may be incomplete."""
JUMP, FASTEST, OFTEN = 1.0, 3.0, 4.0
"""Least step [m] and speed [m/s] of a jump of odometry, which is so many times as large as all but
a twentieth of the others."""
NEAR_ZERO = 0.1
"""Distance from its zero, or its first pose, to which odometry was reset [m]."""
MOVING = 0.02
"""Step [m] and speed [m/s] from which on their signs are compared."""
STRETCH = 2.0
"""Length of the way from which on the map does not fit [m]: sound ones have up to 1 m."""


@dataclass(frozen=True)
class Disagreement:
    """A place of a drive where odometry and scans disagree."""

    x: float
    """Recorded position at its beginning, by odometry if the drive has no poses [m]."""
    y: float
    """Recorded position at its beginning, by odometry if the drive has no poses [m]."""
    error: float
    """Sum of the differences of the motions [m]."""


@dataclass(frozen=True)
class WrongSigns:
    """Steps at which odometry's pose and its velocity have opposite signs."""

    count: int
    """Number of the steps with opposite signs."""
    of: int
    """Number of the steps with a velocity of this sign."""
    is_negative: bool
    """Whether the velocity is negative."""

    @property
    def sentence(self) -> str:
        """The fault for people."""
        pose, velocity = ("forward", "negative") if self.is_negative else ("back", "positive")
        return (
            f"Odometry's pose moves {pose} at {self.count:,} of {self.of:,} steps with a {velocity}"
            " velocity. Its driver confuses the sign: correct it, and record again."
        )


@dataclass(frozen=True, eq=False, repr=False)
class RecordingFaults:
    """Faults of a recorded drive.

    `faulty_steps` do not belong into a fit of odometry's drift, and a recording that is not sound
    is no evidence for settings that trust odometry and map.
    """

    faulty_steps: Bools
    """Mask of the steps from scan to scan at which odometry is wrong, (scans - 1,)."""
    places: tuple[Disagreement, ...]
    """Places where odometry and scans disagree by more than 0.15 m a step, in their order."""
    moved_back: int
    """Number of steps at which the scans move back."""
    reversed_steps: int
    """Number of these at which odometry moves forward."""
    reversed_way: float
    """Length of the way of odometry in these [m]."""
    steps: int
    """Number of the steps of some 0.25 m or 15 deg that were compared."""
    hidden_steps: int
    """Number of the steps at which scans do not show all motions, as along corridors."""
    wrong_signs: tuple[WrongSigns, ...]
    """Odometry's velocity against its pose."""
    jumps: int
    """Number of the steps of odometry that no robot makes, resets among them."""
    resets: int
    """Number of the jumps to odometry's zero, or to its first pose."""
    stamps_back: int
    """Number of the scans whose stamps lie before those of scans before them."""
    stretch: MisfitStretch | None
    """Where the map fits worst; None without a map."""

    def __repr__(self) -> str:
        return f"RecordingFaults({' '.join(self.sentences) or 'none'})"

    @property
    def drops_sign(self) -> bool:
        """True if odometry moves forward at most steps at which the scans move back."""
        return self.reversed_steps >= FEW and 2 * self.reversed_steps > self.moved_back

    @property
    def has_sign_fault(self) -> bool:
        """True if odometry has the wrong sign: against the scans, or against its velocity."""
        return self.drops_sign or bool(self.wrong_signs)

    @property
    def has_misfit(self) -> bool:
        """True if the map does not fit the scans over more than 2 m."""
        return self.stretch is not None and self.stretch.length > STRETCH

    @property
    def is_sound(self) -> bool:
        """True if the recording is evidence for settings that trust odometry and map.

        Slips of up to 1.3 m do no harm, nor do stamps out of order: scans keep the log's order.
        """
        is_large = any(place.error > LARGE for place in self.places)
        is_broken = self.has_sign_fault or self.has_misfit or is_large
        return not (is_broken or self.jumps)

    @property
    def fault_sentences(self) -> tuple[str, ...]:
        """The faults, for people."""
        texts = [signs.sentence for signs in self.wrong_signs]
        if self.drops_sign:
            texts.append(
                f"Odometry moves forward at {self.reversed_steps:,} of {self.moved_back:,} places"
                f" where the scans move back ({self.reversed_way:.2g} m). Probably the driver drops"
                " the sign of the velocity."
            )
        elif self.places:
            worst = max(self.places, key=lambda place: place.error)
            texts.append(
                "Odometry and scans disagree by more than 0.15 m a step at"
                f" {_places_text(len(self.places))}, most at {_position(worst)}, by"
                f" {worst.error:.1f} m."
            )
        if self.jumps:
            resets = f", to its start at {self.resets:,} of them" if self.resets else ""
            texts.append(f"Odometry jumps at {_places_text(self.jumps)}{resets}.")
        if self.stamps_back:
            texts.append(f"The stamps of {self.stamps_back:,} scans are out of order.")
        if self.has_misfit and self.stretch is not None:
            texts.append(
                f"The map does not fit the scans at {_position(self.stretch)}, over"
                f" {self.stretch.length:.2g} m."
            )
        return tuple(texts)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The faults, and what cannot be seen, for people."""
        if self.hidden_steps <= HIDDEN * self.steps:
            return self.fault_sentences
        hidden = (
            f"The scans cannot show motion along corridors at {self.hidden_steps:,} of"
            f" {self.steps:,} steps."
        )
        return (*self.fault_sentences, hidden)


def _places_text(count: int) -> str:
    return "1 place" if count == 1 else f"{count:,} places"


def _position(place: Disagreement | MisfitStretch) -> str:
    return f"({place.x:.1f}, {place.y:.1f})"


def find_recording_faults(
    recording: Recording, grid: OccupancyGrid | None = None
) -> RecordingFaults:
    """Find faults of a recorded drive, without ground truth.

    Odometry is compared with the motion between scans some 0.25 m apart, and with its velocity.
    Faults of a recording along long corridors remain unseen, which `hidden_steps` counts.

    Parameters
    ----------
    recording : Recording
        The drive. Its poses count for the comparison with the map only, and may be off by 0.5 m.
    grid : OccupancyGrid, optional
        The map.

    Returns
    -------
    RecordingFaults
        The faults, as numbers and as sentences.

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
    instance("recording", recording, Recording, "read one with locplan.recordings.read_recording")
    # Poses count for the map alone: odometry and scans are compared with each other.
    stretch = longest_misfit(recording, grid) if grid is not None and recording.has_poses else None
    odometry, count = recording.odometry, len(recording)
    if odometry is None:
        none = np.zeros(count - 1, np.bool_)
        return RecordingFaults(
            none, (), 0, 0, 0.0, 0, 0, (), 0, 0, recording.source.stamps_back, stretch
        )
    jumps, resets = odometry_jumps(odometry, recording.times)
    steps = measure_steps(recording)
    judged = steps.are_judged & ~_with_any(jumps, steps.scans)
    disagree = steps.disagree & judged
    moves_back = (steps.motions[:, 0] < BACK) & judged
    is_reversed = disagree & moves_back & (steps.reported[:, 0] > FORWARD)
    return RecordingFaults(
        faulty_steps=jumps | _from_scan_to_scan(_widened(disagree), steps.scans, count),
        places=_places(recording, steps, disagree),
        moved_back=int(moves_back.sum()),
        reversed_steps=int(is_reversed.sum()),
        reversed_way=float(np.hypot(*steps.reported[is_reversed, :2].T).sum()),
        steps=len(judged),
        hidden_steps=int((steps.hidden | ~judged).sum()),
        wrong_signs=_wrong_signs(recording),
        jumps=int(jumps.sum()),
        resets=int(resets.sum()),
        stamps_back=recording.source.stamps_back,
        stretch=stretch,
    )


def odometry_jumps(odometry: Floats, times: Floats | None) -> tuple[Bools, Bools]:
    """Masks of the steps of odometry that no robot makes, and of those that reset it, (n - 1,)."""
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


def _widened(marked: Bools) -> Bools:
    """Mask of the steps with those before and after: a fault begins and ends within a step."""
    return np.asarray(np.convolve(marked, np.ones(3), "same") > 0) if len(marked) else marked


def _with_any(mask: Bools, ends: Ints) -> Bools:
    """Mask of the steps between ends that contain a marked step from scan to scan."""
    before = np.append(0, np.cumsum(mask))
    return np.asarray(before[ends[1:]] > before[ends[:-1]])


def _from_scan_to_scan(marked: Bools, ends: Ints, scans: int) -> Bools:
    """Mask of the steps from scan to scan that belong to marked steps between ends."""
    of_step = np.searchsorted(ends, np.arange(scans - 1), side="right") - 1
    is_within = of_step < len(marked)
    return np.asarray(is_within & np.append(marked, False)[np.minimum(of_step, len(marked))])


def _places(recording: Recording, steps: ScanSteps, disagree: Bools) -> tuple[Disagreement, ...]:
    """The disagreements; those of steps near each other along the way are one."""
    odometry = recording.odometry
    assert odometry is not None
    numbers, way = np.flatnonzero(disagree), way_along(odometry)[steps.scans]
    poses = recording.poses if recording.has_poses else odometry
    if not len(numbers):
        return ()
    is_apart = way[numbers[1:]] - way[numbers[:-1] + 1] > SAME_PLACE
    places = []
    for group in np.split(numbers, np.flatnonzero(is_apart) + 1):
        x, y, _ = poses[steps.scans[group[0]]].tolist()
        places.append(Disagreement(x, y, float(steps.errors[group].sum())))
    return tuple(places)


def _wrong_signs(recording: Recording) -> tuple[WrongSigns, ...]:
    """Signs of velocities against those of the steps of the pose around them."""
    odometry, speeds = recording.odometry, recording.speeds
    if odometry is None or speeds is None:
        return ()
    ahead, faults = way_between(odometry[:-1], odometry[1:])[:, 0], []
    for sign in (-1.0, 1.0):
        # Of both ends, or the step may be that of another velocity.
        is_clear = (sign * speeds[:-1] > MOVING) & (sign * speeds[1:] > MOVING)
        is_clear &= np.abs(ahead) > MOVING
        count = int((is_clear & (sign * ahead < 0)).sum())
        if count >= FEW and 2 * count > is_clear.sum():
            faults.append(WrongSigns(count, int(is_clear.sum()), sign < 0))
    return tuple(faults)
