"""AMCL settings in a check: presets at levels of disturbance, or on recorded drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from locplan.advice.driving import Scenario
from locplan.advice.preset_choice import (
    LevelCase,
    PresetChoice,
    choose_preset,
    find_replay_objection,
)
from locplan.advice.recorded import RecordingEvidence
from locplan.advice.tuning import cut_path, make_simulated_cases
from locplan.simulation.levels import KINKED_MAP, REVERSAL, SLIP, STANDSTILL, TURNS
from locplan.simulation.worlds import make_path_poses

HARMFUL_FIRST = (STANDSTILL, REVERSAL, KINKED_MAP, SLIP, TURNS)
"""Levels at which presets must do no harm. The first harm ends the trial of a preset."""


def choose_settings(
    scenario: Scenario,
    base_case: LevelCase,
    evidence: RecordingEvidence,
    *,
    drives_all: bool,
    seed: int,
    threads: int | None,
) -> PresetChoice:
    """Choose among the user's settings and the presets.

    A preset must be better at the usual level. At each further level it must not be off at the end
    significantly more often; there the robot drives at most 40 m of each route. Recorded drives
    decide instead of the further levels.

    Parameters
    ----------
    scenario : Scenario
        The scenario of the baseline.
    base_case : LevelCase
        The usual level along all routes.
    evidence : RecordingEvidence
        Evidence from recorded drives.
    drives_all : bool
        True simulates all settings at all levels, for the table; False stops at the decision.
    seed, threads
        See `locplan.check`.
    """
    random = np.random.default_rng(seed)
    levels = make_simulated_cases(
        scenario.world,
        scenario.robot,
        [cut_path(path, random.random()) for path in scenario.paths.values()],
        HARMFUL_FIRST,
        filter_map=None if scenario.filter_map is scenario.world else scenario.filter_map,
        stretch=scenario.stretch,
        seed=seed,
        threads=threads,
    )
    return choose_preset(
        scenario.robot.amcl,
        [base_case, *levels],
        [make_path_poses(path, scenario.world) for path in scenario.paths.values()],
        evidence.replays,
        are_recordings_sound=all(evidence.are_sound),
        drives_all=drives_all,
    )


def do_recordings_contradict(
    scenario: Scenario, fixed_scenario: Scenario, evidence: RecordingEvidence
) -> bool:
    """True if a fixed filter loses a recorded drive that the baseline's filter tracks.

    Parameters
    ----------
    scenario, fixed_scenario : Scenario
        The baseline, and the scenario with the fixes.
    evidence : RecordingEvidence
        The recorded drives.
    """
    changed_map = (
        None if fixed_scenario.filter_map is scenario.filter_map else fixed_scenario.filter_map
    )
    return any(
        find_replay_objection(
            drive.replay(scenario.robot.amcl),
            replace(drive, filter_map=changed_map or drive.filter_map).replay(
                fixed_scenario.robot.amcl
            ),
        )
        for drive in evidence.replays
    )
