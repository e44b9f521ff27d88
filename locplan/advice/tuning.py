"""Tuning of AMCL: presets simulated at levels of disturbance, or replayed on a recording."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from locplan._support.checks import check_instance, check_integer, check_threads
from locplan._support.intervals import format_metres
from locplan._support.kernels.arrays import Floats
from locplan._support.output import ResultFiles
from locplan._support.progress import ProgressCallback
from locplan._support.records import Result, Table
from locplan._support.tables import REPORT_WIDTH, nan_to_none
from locplan.advice.preset_choice import (
    LEVEL_DRIVES,
    USER_SETTINGS,
    CaseResult,
    LevelCase,
    PresetChoice,
    choose_preset,
    summarize_choice,
)
from locplan.errors import ConfigError, RecordingError
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.planning.plans import plan
from locplan.planning.queries import random_queries
from locplan.recordings.faults import find_recording_faults
from locplan.recordings.recording import Recording
from locplan.recordings.replays import (
    RUNS,
    ReplayedDrive,
    ReplayInputs,
    find_replay_obstacle,
    find_sparse_scan_notes,
)
from locplan.robots.amcl import Amcl
from locplan.robots.presets import AMCL_PRESETS, describe_preset
from locplan.robots.robot import Robot
from locplan.simulation.amcl_parameters import (
    BeamCount,
    find_differing_parameters,
    list_setting_warnings,
    write_tuned_parameters,
)
from locplan.simulation.driver import drive_open
from locplan.simulation.drives import check_drive_count
from locplan.simulation.levels import LEVELS, NO_FAULT, Level, select_affected_paths, select_levels
from locplan.simulation.simulator import Simulator
from locplan.simulation.verdict import DriveSet
from locplan.simulation.worlds import (
    check_filter_map,
    check_single_map,
    make_path_poses,
    summarize_filter_map,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Result):
    """Result of `tune`: AMCL's best settings for a map or a recording, with evidence."""

    files: ClassVar[ResultFiles] = ResultFiles(
        "tuning",
        ("tuning.json", "tuning.png", "nav2_params.yaml"),
        purposes={
            "nav2_params.yaml": "AMCL's settings for Nav2, for --robot",
            "tuning.png": "the picture",
        },
    )

    grids: tuple[OccupancyGrid, ...]
    """The maps."""
    robot: Robot
    """The robot with the user's settings of AMCL."""
    choice: PresetChoice
    """The recommended settings, and the drives that support them."""
    beam_count: BeamCount
    """Number of the compared beams that return."""
    warnings: tuple[str, ...]
    """Warnings of the user's settings."""
    paths: int
    """Number of simulated paths on each map."""
    drives: int
    """Number of drives along each of them at the usual level."""
    seed: int
    """Seed of all random numbers."""
    recording: str = ""
    """Names of the recordings; empty for simulated drives."""
    filter_map: OccupancyGrid | None = None
    """The filter's map, if it differs from `grids`."""
    notes: tuple[str, ...] = ()
    """Limits of the result, in sentences without a full stop."""

    def __repr__(self) -> str:
        return f"Tuning({self.map_names}, {self.choice.name})"

    @property
    def map_names(self) -> str:
        """Names of the maps."""
        return ", ".join(grid.name or "map" for grid in self.grids)

    @property
    def winner(self) -> Amcl:
        """The recommended settings: a preset, or the user's settings."""
        return self.choice.settings

    @property
    def changes(self) -> dict[str, float | str]:
        """Values of the parameters to change, by name; empty without a preset."""
        user_settings, winner = self.robot.amcl, self.winner
        return {
            name: getattr(winner, name) for name in find_differing_parameters(user_settings, winner)
        }

    @property
    def conclusion(self) -> str:
        """The result in one sentence, without a full stop."""
        choice = self.choice
        if not choice.is_preset:
            reasons = "; ".join(choice.objections.values()) or "they are those of the presets"
            return f"Keep {USER_SETTINGS}: {reasons}"
        if choice.recordings:
            before, after = (
                self._find_first_result(name, choice.recordings)
                for name in (USER_SETTINGS, choice.name)
            )
            error, baseline_error = (format_metres(rates.error.value) for rates in (after, before))
            errors = f"{error} on {after.case}, {baseline_error}"
            return f"Use {choice.title}: an error of {errors} with {USER_SETTINGS}"
        less = 100 * (1 - choice.verdicts[choice.name].ratio.value)
        return f"Use {choice.title}: {less:.0f} % less error than with {USER_SETTINGS}"

    def _find_first_result(self, name: str, cases: tuple[str, ...]) -> CaseResult:
        return next(r for r in self.choice.results if r.settings == name and r.case in cases)

    def table(self) -> Table:
        """Return the table of all settings, a row per case."""
        return self.choice.table()

    def figure(self, *_: Any) -> Figure:
        """Draw the errors with the user's settings and with the preset.

        Parameters
        ----------
        *_
            Arguments of `save`; ignored.
        """
        from locplan.advice.figures import tuning_figure

        return tuning_figure(self)

    def _write(self, folder: FilePath, *related_results: Any) -> None:
        write_tuned_parameters(folder / "nav2_params.yaml", self.winner, *related_results)

    def summary(self, *related_results: Any, **details: Any) -> dict[str, object]:
        """Return the result as plain data for JSON.

        Parameters
        ----------
        *related_results, **details
            Arguments of `save`; ignored.
        """
        maps = [{"name": grid.name, "digest": grid.digest} for grid in self.grids]
        return nan_to_none(
            {
                "conclusion": self.conclusion,
                **({"maps": maps} if maps[1:] else {"map": maps[0]}),
                "changes": self.changes,
                "choice": summarize_choice(self.choice),
                "notes": list(self.notes),
                "warnings": list(self.warnings),
                "beams_compared": self.beam_count.compared,
                "beams_returned": self.beam_count.returned,
                **{name: getattr(self, name) for name in ("paths", "drives", "seed")},
                **summarize_filter_map(self.filter_map),
                "robot": self.robot.summary(),
                "recording": self.recording or None,
            }
        )

    def report(self) -> str:
        """Return the answer, the table of all drives, and warnings."""
        return tuning_report(self)


PRESET_MEANINGS = ". ".join(f"{name}: {describe_preset(name)}" for name in AMCL_PRESETS) + "."
"""The meaning of the presets' names."""


def tuning_report(tuning: Tuning) -> str:
    """Return the answer, the table of all drives, and warnings."""
    choice = tuning.choice
    recorded = f" on {tuning.recording}" if tuning.recording else ""
    hint = choice.advise_recording()
    lines = [
        *(_wrap_text(f"note: {note}") for note in tuning.notes),
        _wrap_text(f"{tuning.conclusion}."),
        *([_wrap_text(hint)] if hint else []),
        _wrap_text(PRESET_MEANINGS),
        "",
        str(tuning.table()),
        _wrap_text(choice.describe_table(tuning.seed)),
        *(_wrap_text(f"{text[:1].upper()}{text[1:]}.") for text in _list_minor_objections(tuning)),
        "",
        f"{tuning.robot.known_lidar.title}: {tuning.beam_count}{recorded}",
        *(f"warning: {warning}" for warning in tuning.warnings),
    ]
    if choice.is_preset:
        lines.append("Your file is unchanged. To undo, use it again.")
    elif tuning.recording:
        lines.append(
            _wrap_text(
                f"No preset kept AMCL localized on your drive: keep {USER_SETTINGS}. Check the fit"
                " of the map and the drift of odometry: locplan recording FILE MAP"
            )
        )
    return "\n".join(lines)


def _list_minor_objections(tuning: Tuning) -> list[str]:
    """Return the objections that the conclusion does not name."""
    return [*tuning.choice.objections.values()] if tuning.choice.is_preset else []


def _wrap_text(text: str) -> str:
    return textwrap.fill(text, REPORT_WIDTH, break_on_hyphens=False)


LONGEST = 40.0
"""Maximum length of a driven part of a path [m]."""
LEVEL_LOOKS = (16, 32)
"""Numbers of drives along all paths together at the interim looks of a level."""
DISTANCES = (20.0, 8.0, 4.0, 2.0)
"""Minimum distances between the ends of paths; the first that fits the map is used [m]. After 2 m
of standstill most filters need at least 10 m to recover."""


def plan_random_paths(costs: Costmap, count: int, seed: int) -> list[Path]:
    """Return shortest paths of random queries, of 20 to 40 m if the map is large.

    Parameters
    ----------
    costs : Costmap
        Costmap that blocks cells without room for the robot.
    count : int
        Number of paths.
    seed : int
        Seed of the random numbers.

    Raises
    ------
    ConfigError
        If no two connected positions of the map lie 2 m apart.
    """
    for min_distance in DISTANCES:
        try:
            queries = random_queries(costs, count, seed, min_distance=min_distance)
            break
        except ConfigError as error:
            fault = str(error).split(";")[0]
    else:
        raise ConfigError(f"{fault}. Use a larger map or a smaller robot")
    random = np.random.default_rng(seed)
    paths = (plan(costs, query.start, query.goal).path for query in queries)
    return [cut_path(path, random.random()) for path in paths if path is not None]


def make_simulated_cases(
    grid: OccupancyGrid,
    robot: Robot,
    paths: Sequence[Path],
    levels: Sequence[Level],
    *,
    drives: int = 1,
    label: str = "",
    filter_map: OccupancyGrid | None = None,
    stretch: float = 1.0,
    seed: int = 1,
    threads: int | None = None,
) -> list[LevelCase]:
    """Return the cases of simulated drives, one for each level that can affect the paths.

    Parameters
    ----------
    grid, robot, filter_map, stretch, seed, threads
        See `Simulator`; the robot's filter is replaced by the settings that drive.
    paths : sequence of Path
        The paths.
    levels : sequence of Level
        The levels.
    drives : int, default 1
        Number of drives along each path. Levels of disturbance have at least 64 drives along all
        paths.
    label : str, default ""
        Name of the map for the case's name; empty for a single map.
    """
    paths_by_name = {f"{n}": path for n, path in enumerate(paths, 1)}

    @cache
    def make_simulator(amcl: Amcl) -> Simulator:
        return Simulator(
            grid,
            replace(robot, filter=amcl),
            filter_map=filter_map,
            seed=seed,
            threads=threads,
            stretch=stretch,
        )

    def make_case(level: Level) -> LevelCase:
        is_usual = level == NO_FAULT
        affected = select_affected_paths(level, paths_by_name, grid)
        min_count = 0 if is_usual else math.ceil(LEVEL_DRIVES / len(affected))
        count = max(drives, min_count)
        looks = {min(count, math.ceil(n / len(affected))) for n in LEVEL_LOOKS}

        def drive(amcl: Amcl, numbers: range) -> DriveSet:
            drives_by_path = drive_open(make_simulator(amcl), affected, numbers, level=level)
            return DriveSet.from_drives(drives_by_path.values())

        return LevelCase(
            f"{label} {level.name}".strip(),
            drive,
            (count,) if is_usual else (*sorted(looks - {count}), count),
            "" if is_usual else level.phrase,
        )

    return [make_case(level) for level in select_levels(paths, grid, levels)]


def cut_path(path: Path, fraction: float) -> Path:
    """Return a part of a path of at most 40 m.

    Parameters
    ----------
    path : Path
        The path.
    fraction : float
        Where the part begins: 0 at the start of the path, 1 so that it ends at the goal.
    """
    spare = path.length - LONGEST
    if spare <= 0:
        return path
    first, last = fraction * spare, fraction * spare + LONGEST
    inner = (path.distance > first) & (path.distance < last)

    def cut_values(values: Floats) -> Floats:
        ends = np.interp([first, last], path.distance, values)
        return np.concatenate([ends[:1], values[inner], ends[1:]])

    heading = None if path.heading is None else cut_values(np.unwrap(path.heading))
    return Path(np.column_stack([cut_values(values) for values in path.xy.T]), heading)


PATHS, DRIVES = 16, 4
"""Default number of random paths on each map, and of drives along each."""
FEWEST_PATHS = 5
"""Minimum number of paths: drives along few of them are alike."""


def tune(
    grid: OccupancyGrid | Sequence[OccupancyGrid],
    robot: Robot | None = None,
    *,
    paths: int = PATHS,
    drives: int = DRIVES,
    levels: Sequence[Level] = LEVELS,
    filter_map: OccupancyGrid | None = None,
    further_parameters: Mapping[str, object] | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Find the preset of AMCL's settings that localizes a robot best on its map.

    The user's settings and the presets of `locplan.robots.presets` drive along random shortest
    paths. A preset is recommended if it is better at the usual level of disturbance, and at no
    further level off at the end significantly more often, see `locplan.simulation.verdict`.

    Parameters
    ----------
    grid : OccupancyGrid or sequence of OccupancyGrid
        The map, or several for one parameter file: all count together at the usual level, and a
        preset must do no harm on any of them.
    robot : Robot, optional
        The robot, such as `Robot.load` reads; by default one with Nav2's filter and a lidar
        of 6 m that sees all round.
    paths : int, default 16
        Number of random paths on each map, 5 to 1000.
    drives : int, default 4
        Number of drives along each path, 2 to 100,000. At levels of disturbance all paths of a map
        have 64 drives at least.
    levels : sequence of Level, all by default
        The levels of disturbance, the usual one first; by default all of
        `locplan.simulation.levels`.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, if it differs from `grid`; see
        `locplan.simulation.simulate`.
    further_parameters : mapping of str to object, optional
        Further parameters in the user's file, such as `z_short`, for the warnings.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal results.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives of all settings.

    Returns
    -------
    Tuning
        The settings to use, and the evidence for them.

    Raises
    ------
    LocplanError
        If the map has no two free positions 2 m apart that are joined, or a number is out of its
        range.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> robot = locplan.Robot().with_settings({"min_particles": 20, "max_particles": 20})
    >>> result = tune(grid, robot, paths=5, drives=2, levels=LEVELS[:1])
    >>> result.winner.max_particles
    20
    """
    grids = as_list(grid)
    for map_grid in grids:
        check_grid(map_grid)
    check_single_map(filter_map, grids)
    check_integer("paths", paths, FEWEST_PATHS, 1000)
    check_drive_count(drives)
    simulators = [
        Simulator(map_grid, robot, filter_map=filter_map, seed=seed, threads=threads)
        for map_grid in grids
    ]
    simulated_robot = simulators[0].robot
    ways = [
        plan_random_paths(Costmap.blank(map_grid, robot=simulated_robot), paths, seed)
        for map_grid in grids
    ]
    labels = (
        make_names_unique([map_grid.name or "map" for map_grid in grids]) if grids[1:] else [""]
    )
    cases = [
        case
        for map_grid, map_paths, label in zip(grids, ways, labels, strict=True)
        for case in make_simulated_cases(
            map_grid,
            simulated_robot,
            map_paths,
            levels,
            drives=drives,
            label=label,
            filter_map=filter_map,
            seed=seed,
            threads=threads,
        )
    ]
    lines = [
        make_path_poses(path, map_grid)
        for map_grid, map_paths in zip(grids, ways, strict=True)
        for path in map_paths
    ]
    choice = choose_preset(simulated_robot.amcl, cases, lines, progress=progress)
    beams_left = min(map(BeamCount.on_map, simulators), key=lambda left: left.returned)
    return Tuning(
        grids=tuple(grids),
        robot=simulated_robot,
        choice=choice,
        beam_count=beams_left,
        warnings=list_setting_warnings(
            simulated_robot, choice.settings, beams_left, further_parameters
        ),
        paths=paths,
        drives=drives,
        seed=seed,
        filter_map=filter_map,
    )


def as_list(single_or_many: Any) -> list[Any]:
    """Return one map or recording, or a non-empty sequence of them, as a list.

    Parameters
    ----------
    single_or_many : object
        A map, a recording, or a sequence of them.
    """
    values = single_or_many
    is_sequence = isinstance(values, Sequence) and not isinstance(values, str) and len(values) > 0
    return [*values] if is_sequence else [values]


def make_names_unique(names: Sequence[str]) -> list[str]:
    """Return names with numbers that distinguish equal names.

    Parameters
    ----------
    names : sequence of str
        The names.

    Examples
    --------
    >>> make_names_unique(["hall", "lab", "hall"])
    ['hall', 'lab', 'hall 2']
    """
    counts = [names[:n].count(name) + 1 for n, name in enumerate(names)]
    pairs = zip(names, counts, strict=True)
    return [f"{name} {count}" if count > 1 else name for name, count in pairs]


SIMULATED_PATHS, SIMULATED_DRIVES = 12, 4
"""Number of random paths on each map that settings are simulated on next to recordings, and of
drives along each."""


def tune_on_drive(
    recording: Recording | Sequence[Recording],
    grid: OccupancyGrid | Sequence[OccupancyGrid],
    robot: Robot | None = None,
    *,
    drives: int = RUNS,
    filter_map: OccupancyGrid | None = None,
    further_parameters: Mapping[str, object] | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Find the preset of AMCL's settings that localizes a robot best on its recorded drive.

    The user's settings and the presets of `locplan.robots.presets` are replayed over the whole
    drive. The precise preset is used if the recording has no fault, no run is off at the end, the
    error is no larger than with the user's settings, and the preset is not worse in simulation.
    Otherwise the safe preset is tried in the same way, and otherwise the user's settings stay. The
    recorded poses are the ground truth, so they should not come from the filter to be tuned.

    Parameters
    ----------
    recording : Recording or sequence of Recording
        The drive, with odometry; or several for one parameter file: settings must hold on each.
    grid : OccupancyGrid or sequence of OccupancyGrid
        The map, with the poses in its world frame; for several drives one map, or one for each.
    robot : Robot, optional
        The robot with the user's settings of the filter, and with the deviation of the filter's
        first pose; Nav2's defaults without it.
    drives : int, default 12
        Number of replays of the whole drive, 2 to 100,000.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, if it differs from `grid`.
    further_parameters, seed, threads, progress
        See `locplan.advice.tuning.tune`.

    Returns
    -------
    Tuning
        The settings to use, and the evidence for them.

    Raises
    ------
    RecordingError
        If the drive has no odometry, or is shorter than 30 m.
    ConfigError
        If a number is out of its range.

    Examples
    --------
    >>> import locplan
    >>> from locplan.recordings import record_drive
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> path = locplan.plan(locplan.Costmap.blank(grid), (2.0, 3.0), (36.0, 3.0)).path
    >>> robot = locplan.Robot(locplan.Lidar(range=6.0, beams=60))
    >>> drive = record_drive(grid, path, robot)
    >>> own = robot.with_settings({"min_particles": 20, "max_particles": 20})
    >>> tune_on_drive(drive, grid, own, drives=2).winner.max_particles
    20
    """
    recordings, grids = as_list(recording), as_list(grid)
    for drive in recordings:
        check_instance(
            "recording", drive, Recording, "read one with locplan.recordings.read_recording"
        )
    for map_grid in grids:
        check_grid(map_grid)
    if len(grids) not in (1, len(recordings)):
        raise ConfigError(
            f"{len(recordings)} drives need one map, or one for each in their order, not"
            f" {len(grids)}"
        )
    check_single_map(filter_map, grids)
    check_drive_count(drives)
    check_integer("seed", seed, 0)
    check_threads(threads)
    names = [drive.source.file or "the drive" for drive in recordings]
    labels = make_names_unique(names)
    drive_robot = recordings[0].robot(robot)
    drives_on_maps = [
        ReplayedDrive(label, drive, map_grid, drive.robot(robot), filter_map, drives, seed, threads)
        for drive, map_grid, label in zip(
            recordings, grids * (len(recordings) // len(grids)), labels, strict=True
        )
    ]
    for replayed_drive in drives_on_maps:
        _check_drive(replayed_drive)
    faults = [
        find_recording_faults(replayed_drive.recording, replayed_drive.grid)
        for replayed_drive in drives_on_maps
    ]
    maps = [*dict.fromkeys(grids)]
    map_labels = (
        make_names_unique([map_grid.name or "map" for map_grid in maps]) if maps[1:] else [""]
    )
    cases = []
    for map_grid, label in zip(maps, map_labels, strict=True):
        paths = plan_random_paths(Costmap.blank(map_grid, robot=drive_robot), SIMULATED_PATHS, seed)
        cases += make_simulated_cases(
            map_grid,
            drive_robot,
            paths,
            [NO_FAULT],
            drives=SIMULATED_DRIVES,
            label=label,
            filter_map=filter_map,
            seed=seed,
            threads=threads,
        )
    choice = choose_preset(
        drive_robot.amcl,
        cases,
        [drive.poses for drive in recordings],
        drives_on_maps,
        are_recordings_sound=all(fault.is_sound for fault in faults),
        progress=progress,
    )
    beams_left = min(map(_count_returned_beams, drives_on_maps), key=lambda left: left.returned)
    sparse = dict.fromkeys(
        note for drive in recordings for note in find_sparse_scan_notes(drive, drive_robot.amcl)
    )
    of_faults = [
        f"{replayed_drive.name}: {text.rstrip('.')}"
        for replayed_drive, fault in zip(drives_on_maps, faults, strict=True)
        for text in fault.sentences
    ]
    return Tuning(
        grids=tuple(maps),
        robot=drive_robot,
        choice=choice,
        beam_count=beams_left,
        warnings=list_setting_warnings(
            drive_robot, choice.settings, beams_left, further_parameters
        ),
        paths=SIMULATED_PATHS,
        drives=SIMULATED_DRIVES,
        seed=seed,
        recording=", ".join(labels),
        filter_map=filter_map,
        notes=(*sparse, *of_faults),
    )


def _check_drive(drive: ReplayedDrive) -> None:
    """Raise a RecordingError if a drive cannot be replayed or is too short."""
    ReplayInputs(drive.recording, check_filter_map(drive.filter_map, drive.grid))
    if limit := find_replay_obstacle(drive.recording):
        raise RecordingError(f"{drive.name}: {limit}")


def _count_returned_beams(drive: ReplayedDrive) -> BeamCount:
    """Return the numbers of compared and returned beams on a drive."""
    tracks = ReplayInputs(drive.recording, check_filter_map(drive.filter_map, drive.grid))
    ends = tracks.select_amcl_ends(drive.robot.amcl)
    return BeamCount(ends.shape[1], float(np.isfinite(ends[..., 0]).sum(axis=1).mean()))
