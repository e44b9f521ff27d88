"""AMCL's settings in a check: the presets at levels of disturbance, or on recorded drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from locplan.advice.driving import Site
from locplan.advice.preset_choice import LevelCase, PresetChoice, choose_preset, find_objection
from locplan.advice.recorded import RecordingEvidence
from locplan.advice.tuning import cut_path, make_simulated_cases
from locplan.simulation.levels import KINKED_MAP, REVERSAL, SLIP, STANDSTILL, TURNS
from locplan.simulation.worlds import make_path_poses

HARMFUL_FIRST = (STANDSTILL, REVERSAL, KINKED_MAP, SLIP, TURNS)
"""The levels at which presets must do no harm. The first harm ends the drives with a preset."""


def choose_settings(
    site: Site,
    base_case: LevelCase,
    recorded: RecordingEvidence,
    *,
    drives_all: bool,
    seed: int,
    threads: int | None,
) -> PresetChoice:
    """Choose among the user's settings and the presets.

    A preset must be better at the usual level, and at no other level off at the end significantly
    more often. There the robot drives at most 40 m of each route. If there are recorded drives,
    they decide instead of the other levels.

    Parameters
    ----------
    site : Site
        The site of the baseline.
    base_case : Case
        The usual level along all routes.
    recorded : Recorded
        What recorded drives show.
    drives_all : bool
        True drives all settings at all levels, for the table; False only those that decide.
    seed, threads
        See `locplan.check`.
    """
    random = np.random.default_rng(seed)
    levels = make_simulated_cases(
        site.world,
        site.robot,
        [cut_path(path, random.random()) for path in site.paths.values()],
        HARMFUL_FIRST,
        filter_map=None if site.filter_map is site.world else site.filter_map,
        stretch=site.stretch,
        seed=seed,
        threads=threads,
    )
    return choose_preset(
        site.robot.amcl,
        [base_case, *levels],
        [make_path_poses(path, site.world) for path in site.paths.values()],
        recorded.replays,
        are_recordings_sound=all(recorded.are_sound),
        drives_all=drives_all,
    )


def is_contradicted(site: Site, fixed_site: Site, recorded: RecordingEvidence) -> bool:
    """True if the filter's settings and map with some fixes do not hold on a recorded drive.

    Parameters
    ----------
    site, fixed_site : Site
        The site of the baseline, and with the fixes.
    recorded : Recorded
        The recorded drives.
    """
    changed_map = None if fixed_site.filter_map is site.filter_map else fixed_site.filter_map
    return any(
        find_objection(
            drive.replay(site.robot.amcl),
            replace(drive, filter_map=changed_map or drive.filter_map).replay(
                fixed_site.robot.amcl
            ),
        )
        for drive in recorded.replays
    )
