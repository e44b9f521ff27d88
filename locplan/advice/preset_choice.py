"""Choice among the presets of AMCL's settings, by simulated or recorded drives.

`check` and `tune` both use `choose_preset`, on different paths.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from locplan._support.intervals import Interval, format_metres, format_rate
from locplan._support.poses import Poses, find_update_poses
from locplan._support.progress import ProgressCallback
from locplan._support.records import Table, TableColumn
from locplan._support.saved import to_plain_data
from locplan.advice.trials import is_futile
from locplan.robots.amcl import Amcl
from locplan.robots.presets import PRECISE, describe_preset, list_applicable_presets
from locplan.simulation.drives import LOST_TEXT, Drives, make_rate_column
from locplan.simulation.levels import NO_FAULT
from locplan.simulation.verdict import BETTER, WORSE, DriveSet, Verdict, compare_drives

USER_SETTINGS, BASELINE = "your settings", "baseline"
"""Name of the user's settings, and their verdict in tables."""
LEVEL_DRIVES = 64
"""Minimum number of drives at each level, unless fewer decide.

A preset with 16 points more drives off at the end is detected in 88 % of cases, with 11 points more
in 55 %, and with 6 points more in 8 %."""
RESULT_COLUMNS = (
    TableColumn("settings", title="settings"),
    TableColumn("case", title="drives"),
    TableColumn("error", "m", "error", interval=True),
    make_rate_column("lost", "lost"),
    make_rate_column("off_at_end", "off at the end"),
    TableColumn("verdict", title="verdict"),
    TableColumn("n_drives"),
)
"""Columns of the drives with each settings."""


@dataclass(frozen=True, eq=False)
class LevelCase:
    """Simulated drives with any settings at one level of disturbance."""

    name: str
    """Name of the level, after the map's name if there are several maps."""
    drive: Callable[[Amcl, range], DriveSet]
    """Simulates drives of some numbers along each path. Drives at the same index of two sets have
    the same world and random numbers."""
    looks: tuple[int, ...]
    """Numbers of drives along each path at the interim looks and at the last look."""
    fault: str = ""
    """The fault of the level in words, such as "odometry reports no motion over 2 m"; empty at the
    usual level. There presets must be better, and at others they must do no harm."""

    @property
    def is_usual(self) -> bool:
        """True for the usual level."""
        return not self.fault


class RecordedCase(Protocol):
    """A recorded drive on which settings are replayed."""

    @property
    def name(self) -> str:
        """Name in tables."""

    def replay(self, amcl: Amcl) -> Drives:
        """Replay settings over the whole drive."""


@dataclass(frozen=True)
class CaseResult:
    """Results of one setting in one case."""

    settings: str
    """"your settings", "safe" or "precise"."""
    case: str
    """Name of the case."""
    error: Interval
    """Error of a typical simulated drive, or RMSE of all runs on a recording [m]."""
    lost: Interval
    """Share of the drives that were lost, 0..1."""
    off_at_end: Interval
    """Share of the drives that are off at the end, 0..1."""
    n_drives: int
    """Number of drives, or of runs on a recording."""
    verdict: str = ""
    """Verdict on a preset against the user's settings, the baseline; on a recording, confirmed or
    contradicted. Empty if the user's settings were not simulated."""
    fault: str = ""
    """The fault of the level in words; empty at the usual level and on a recording."""


@dataclass(frozen=True)
class PresetChoice:
    """The recommended settings, and the drives that support them."""

    user_settings: Amcl
    """The user's settings."""
    name: str
    """Name of the settings to use: "your settings", "safe" or "precise"."""
    results: tuple[CaseResult, ...]
    """The drives with each settings, case by case."""
    verdicts: Mapping[str, Verdict]
    """Verdict on each simulated preset at the usual level, by its name."""
    objections: Mapping[str, str]
    """Reason against each rejected preset, by its name, without a full stop."""
    cost_ratio: float
    """Ratio of compared beams to the user's settings, which the filter's CPU time follows."""
    recordings: tuple[str, ...] = ()
    """Names of the recordings that decided; empty if simulated drives did."""

    @property
    def settings(self) -> Amcl:
        """The settings to use."""
        return list_applicable_presets(self.user_settings).get(self.name, self.user_settings)

    @property
    def is_preset(self) -> bool:
        """True if a preset is recommended."""
        return self.name != USER_SETTINGS

    @property
    def untested_error(self) -> float | None:
        """Simulated error of the precise preset [m] if it only lacks a recording, or None."""
        if self.recordings or self.name == PRECISE or PRECISE not in self.verdicts:
            return None
        errors = {
            result.settings: result.error.value
            for result in self.results
            if result.case == self.results[0].case
        }
        is_promising = self.verdicts[PRECISE].word == BETTER
        return errors[PRECISE] if is_promising and errors[PRECISE] < errors[self.name] else None

    @property
    def changes(self) -> str:
        """Changes and CPU cost of the recommended preset; empty without one."""
        if not self.is_preset:
            return ""
        is_costly = self.cost_ratio >= 1.05
        cost = f", {self.cost_ratio:.1f} times the filter's CPU" if is_costly else ""
        return f"{describe_preset(self.name)}{cost}"

    @property
    def title(self) -> str:
        """The recommended settings with their changes and cost."""
        return f"{self.name}: {self.changes}" if self.is_preset else self.name

    @property
    def hardest_level(self) -> str:
        """Sentence on the level with most drives off at the end, for both settings.

        Empty if the user's settings stay, if no drive is off, or if recordings decided.
        """
        levels = [
            result
            for result in self.results
            if result.settings == self.name
            and not result.case.endswith(NO_FAULT.name)
            and result.off_at_end.value > 0
        ]
        if self.recordings or not self.is_preset or not levels:
            return ""
        hardest = max(levels, key=lambda result: result.off_at_end)
        baseline = [
            format_rate(result.off_at_end)
            for result in self.results
            if (result.settings, result.case) == (USER_SETTINGS, hardest.case)
        ]
        other = f", {USER_SETTINGS} in {baseline[0]}" if baseline else ""
        return (
            f"Hardest test: if {hardest.fault}, drives with {self.name} settings are off at the end"
            f" in {format_rate(hardest.off_at_end)}{other}."
        )

    def advise_recording(self) -> str:
        """Return the advice to test the precise preset on a recording, or an empty text."""
        if self.untested_error is None:
            return ""
        return (
            f"Precise settings lower the error to {format_metres(self.untested_error)}, but a robot"
            " that gets lost with them rarely recovers. To test them on a recorded drive, add"
            " `--recording FILE`."
        )

    def table(self) -> Table:
        """Return the table of all settings, a row per case."""
        return Table.from_records(RESULT_COLUMNS, self.results)

    def describe_table(self, seed: int) -> str:
        """Return the sentences that explain the table.

        Parameters
        ----------
        seed : int
            Seed of the random numbers.
        """
        runs = max((r.n_drives for r in self.results if r.case in self.recordings), default=0)
        if runs:
            return (
                f"Lost: {LOST_TEXT} at some time. On a recording: {runs} runs over the"
                f" whole drive (seed {seed}), with the RMSE of all runs against the recorded poses."
                " The recording decides."
            )
        return (
            f"Lost: {LOST_TEXT} at some time. The usual level decides. At every further level the"
            f" safe preset must not be off at the end significantly more often than"
            f" {USER_SETTINGS}, and the precise preset only rarely."
        )


def summarize_choice(choice: PresetChoice) -> dict[str, object]:
    """Return a choice as plain data for JSON.

    Parameters
    ----------
    choice : PresetChoice
        The choice.
    """
    return {
        "settings": choice.name,
        "changes": choice.changes,
        "cost_ratio": choice.cost_ratio,
        "objections": dict(choice.objections),
        "verdicts": {name: to_plain_data(verdict) for name, verdict in choice.verdicts.items()},
        "results": choice.table().records(),
        "recordings": list(choice.recordings),
    }


def choose_preset(
    user_settings: Amcl,
    cases: Sequence[LevelCase],
    driven_poses: Sequence[Poses],
    recordings: Sequence[RecordedCase] = (),
    *,
    are_recordings_sound: bool = True,
    drives_all: bool = True,
    progress: ProgressCallback | None = None,
) -> PresetChoice:
    """Choose among the presets: the precise one, the safe one, or the user's settings.

    Without a recorded drive, a preset must be better at the usual level and do no harm at further
    levels: the safe preset must not be off at the end significantly more often than the user's
    settings, and the precise preset only rarely. Small harm passes, see `LEVEL_DRIVES`. A recorded
    drive decides instead of the further levels.

    Parameters
    ----------
    user_settings : Amcl
        The user's settings.
    cases : sequence of LevelCase
        The levels of disturbance, the usual one first; with a recording only this one is simulated.
    driven_poses : sequence of (n, 3) array
        Poses of drives, for the comparison of CPU times [m, m, rad].
    recordings : sequence of RecordedCase, default ()
        Recorded drives for replays of the settings.
    are_recordings_sound : bool, default True
        True if odometry, map and scans of all recordings agree. Otherwise the precise preset is
        rejected, since it trusts odometry and map.
    drives_all : bool, default True
        True simulates all settings at all levels, for the table; False stops at the decision.
    progress : callable, optional
        Called with (done, total) settings and cases.

    Returns
    -------
    PresetChoice
        The settings to use, and the evidence.
    """
    trial = _PresetTrial(user_settings, cases, recordings, drives_all, progress)
    if not recordings:  # they decide first if there are some
        for name in trial.presets:
            trial.compare_at_usual_level(name)
        if drives_all:
            trial.drive_all()
    for name in trial.presets:
        if name == PRECISE and not are_recordings_sound:
            objection = f"{name} settings need a recording whose odometry and map fit the scans"
        elif recordings:
            objection = trial.find_recording_objection(name)
        else:
            objection = trial.find_level_objection(name)
        if not objection:
            return trial.make_choice(name, driven_poses)
        trial.objections[name] = objection
    return trial.make_choice(USER_SETTINGS, driven_poses)


class _PresetTrial:
    """Runner of the drives of one choice; it caches the drives of each setting and case."""

    def __init__(
        self,
        user_settings: Amcl,
        cases: Sequence[LevelCase],
        recordings: Sequence[RecordedCase],
        drives_all: bool,
        progress: ProgressCallback | None,
    ) -> None:
        self.presets = list_applicable_presets(user_settings)
        self.objections = dict[str, str]()
        self._settings = {USER_SETTINGS: user_settings, **self.presets}
        self._base_cases = [case for case in cases if case.is_usual]
        self._fault_cases = [case for case in cases if not case.is_usual]
        self._recordings = recordings
        self._drive_sets = defaultdict[tuple[str, str], list[DriveSet]](list)  # up to each look
        self._drives_all = drives_all
        self._replays = dict[tuple[str, str], Drives]()
        self._verdicts = dict[str, Verdict]()
        self._progress = progress
        n_cases = len(self._base_cases) + len(recordings or self._fault_cases)
        self._n_steps = n_cases * len(self._settings)

    def compare_at_usual_level(self, name: str) -> None:
        """Compare a preset with the user's settings in all cases of the usual level together.

        A preset that does not lead at an interim look is stopped.
        """
        last = max(len(case.looks) for case in self._base_cases)
        for n_looks in range(last if self._drives_all else 1, last + 1):
            pairs = [
                [
                    self._drive_up_to_look(settings, case, n_looks)
                    for settings in (USER_SETTINGS, name)
                ]
                for case in self._base_cases
            ]
            baseline, alternative = (DriveSet.join(sets) for sets in zip(*pairs, strict=True))
            if is_futile(baseline, alternative):
                break
        # Both presets share the error probability. Looks that only stop drives spend none of it.
        self._verdicts[name] = compare_drives(
            baseline, alternative, looks_left=None, n_alternatives=len(self.presets)
        )

    def drive_all(self) -> None:
        """Simulate all settings in all cases."""
        for case in (*self._base_cases, *self._fault_cases):
            for name in self._settings:
                self._drive_up_to_look(name, case)

    def find_level_objection(self, name: str) -> str:
        """Return the reason of simulated drives against a preset; empty without one."""
        base_verdict = self._verdicts[name]
        if base_verdict.word != BETTER:
            return f"{name} settings are not better than {USER_SETTINGS}: {base_verdict.word}"
        for case in self._base_cases:
            if self._compare(name, case).word == WORSE:
                return f"{name} settings are worse at {case.name}"
        return next(filter(None, (self._find_harm(name, case) for case in self._fault_cases)), "")

    def _find_harm(self, name: str, case: LevelCase) -> str:
        """Return the harm of a preset at a level, from as few drives as possible; or empty."""
        for n_looks in self._iterate_look_numbers(case):
            drives = self._drive_up_to_look(name, case, n_looks)
            if drives.is_rarely_off:
                return ""  # the user's settings need no drives
            n_drives, looks_left = len(drives.lost), len(case.looks) - n_looks
            harm = (
                f"{name} settings are off at the end in {format_rate(drives.off_at_end_rate)} of"
                " the"
                f" drives if {case.fault}"
            )
            if name == PRECISE:
                # A robot does not return with it. With other settings robots do, but on short
                # routes not before the end, so that a comparison would show no harm.
                n_all = n_drives * case.looks[-1] // case.looks[n_looks - 1]
                if not drives.can_be_rarely_off(n_all):
                    return harm
            elif n_drives >= LEVEL_DRIVES / 2 or drives.can_be_off_more_often(looks_left):
                verdict = self._compare(name, case, n_looks)
                off = verdict.off_at_end
                if verdict.has_more_off and off:
                    return f"{harm}, {USER_SETTINGS} in {format_rate(off.baseline)}"
                is_half = n_drives >= LEVEL_DRIVES / 2
                if is_half and off and off.alternative.value <= off.baseline.value:
                    return ""  # all drives would hardly show that more are off
        return ""

    def _iterate_look_numbers(self, case: LevelCase) -> Iterator[int]:
        """Yield the numbers of looks at which a level may be decided."""
        yield from range(len(case.looks) if self._drives_all else 1, len(case.looks) + 1)

    def find_recording_objection(self, name: str) -> str:
        """Return why recorded drives, or then simulated ones, speak against a preset."""
        for recording in self._recordings:
            before, after = (
                self._replay(settings, recording) for settings in (USER_SETTINGS, name)
            )
            if objection := find_replay_objection(before, after):
                return f"{name} settings: {objection} on {recording.name}"
        self.compare_at_usual_level(name)
        if self._verdicts[name].word == WORSE:
            return f"{name} settings are worse than {USER_SETTINGS} in simulation"
        return ""

    def make_choice(self, name: str, lines: Sequence[Poses]) -> PresetChoice:
        """Return the choice of some settings with all that was driven."""
        results = [
            self._make_result(settings, case)
            for case in (*self._base_cases, *self._fault_cases)
            for settings in self._settings
            if (settings, case.name) in self._drive_sets
        ] + [
            self._make_recording_result(settings, recording.name)
            for recording in self._recordings
            for settings in self._settings
            if (settings, recording.name) in self._replays
        ]
        if self._progress:
            self._progress(self._n_steps, self._n_steps)
        return PresetChoice(
            user_settings=self._settings[USER_SETTINGS],
            name=name,
            results=tuple(results),
            verdicts=self._verdicts,
            objections=self.objections,
            cost_ratio=_compute_cost_ratio(
                self._settings[USER_SETTINGS], self._settings[name], lines
            ),
            recordings=tuple(recording.name for recording in self._recordings),
        )

    def _drive_up_to_look(self, name: str, case: LevelCase, n_looks: int | None = None) -> DriveSet:
        """Return the drives with some settings up to a look, by default all."""
        parts = self._drive_sets[name, case.name]
        for first, last in [*itertools.pairwise((0, *case.looks))][len(parts) : n_looks]:
            parts.append(case.drive(self._settings[name], range(first, last)))
            self._report_step()
        return DriveSet.join(parts[:n_looks])

    def _replay(self, name: str, recording: RecordedCase) -> Drives:
        key = name, recording.name
        if key not in self._replays:
            self._replays[key] = recording.replay(self._settings[name])
            self._report_step()
        return self._replays[key]

    def _report_step(self) -> None:
        if self._progress:
            self._progress(len(self._drive_sets) + len(self._replays), self._n_steps)

    def _compare(self, name: str, case: LevelCase, n_looks: int | None = None) -> Verdict:
        sets = (
            self._drive_up_to_look(settings, case, n_looks) for settings in (USER_SETTINGS, name)
        )
        return compare_drives(*sets, looks_left=len(case.looks) - n_looks if n_looks else 0)

    def _make_result(self, name: str, case: LevelCase) -> CaseResult:
        drives = DriveSet.join(self._drive_sets[name, case.name])
        n_looks = min(
            len(self._drive_sets.get((settings, case.name), ()))
            for settings in (USER_SETTINGS, name)
        )
        if name == USER_SETTINGS:
            word = BASELINE
        elif [case] == self._base_cases:
            word = self._verdicts[name].word
        else:
            word = self._compare(name, case, n_looks).word if n_looks else ""
        rates = drives.error, drives.lost_rate, drives.off_at_end_rate
        return CaseResult(name, case.name, *rates, len(drives.lost), word, case.fault)

    def _make_recording_result(self, name: str, recording: str) -> CaseResult:
        runs, before = (
            self._replays[name, recording],
            self._replays.get((USER_SETTINGS, recording)),
        )
        if name == USER_SETTINGS:
            word = BASELINE
        else:
            word = "contradicted" if before and find_replay_objection(before, runs) else "confirmed"
        rates = runs.rmse, runs.lost_rate, runs.off_at_end_rate
        return CaseResult(name, recording, *rates, len(runs.errors), word)


def find_replay_objection(before: Drives, after: Drives) -> str:
    """Return the reason of a replay against settings; empty without one.

    Parameters
    ----------
    before, after : Drives
        Replays of the whole recording with the user's settings, and with new settings.
    """
    if after.off_at_end.any():
        return f"{after.off_at_end.sum()} of {len(after.errors)} runs are off at the end"
    n_lost = [int(drives.lost.sum()) for drives in (before, after)]
    if n_lost[1] > n_lost[0]:
        return (
            f"{n_lost[1]} of {len(after.errors)} runs get lost, {n_lost[0]} with {USER_SETTINGS},"
        )
    errors = [drives.rmse.value for drives in (before, after)]
    if errors[1] > errors[0]:
        user_error, error = map(format_metres, errors)
        return f"the error is {error}, {user_error} with {USER_SETTINGS},"
    return ""


def _compute_cost_ratio(before: Amcl, after: Amcl, lines: Sequence[Poses]) -> float:
    """Return the ratio of beams that two settings compare along the same poses."""
    beams = [
        amcl.max_beams
        * sum(len(find_update_poses(line, amcl.update_min_d, amcl.update_min_a)) for line in lines)
        for amcl in (before, after)
    ]
    return beams[1] / max(1, beams[0])
