"""Drives of candidates by their numbers, in the part of the map about them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval, of_geometric_mean
from locplan._util.poses import Poses
from locplan._util.progress import ProgressCallback
from locplan.costs import Path
from locplan.simulation._drives import Drives, log_errors, worst_error
from locplan.simulation._simulator import Simulator
from locplan.simulation.choice._ask import lines_along
from locplan.simulation.choice._driven import Driven
from locplan.simulation.choice._race import FINALISTS, KEPT, ROUNDS, Judgement, Scores
from locplan.simulation.choice._settings import ChoiceSettings

STREAM = 1_000_000
"""Stream of the random numbers of these drives, above those of `simulate` and its queries."""
RIVAL_DRIVES = 8
"""Number of drives of the shortest path with the rival's settings."""


class Driver:
    """Drives of candidates by their numbers, and what is kept of them.

    Parameters
    ----------
    simulator : Simulator
        The map, the robot and the seed.
    paths : mapping of str to Path
        The candidates, the shortest first.
    settings : ChoiceSettings
        What counts.
    progress : callable, optional
        Called with (done, total) drives.
    """

    def __init__(
        self,
        simulator: Simulator,
        paths: dict[str, Path],
        settings: ChoiceSettings,
        progress: ProgressCallback | None,
    ) -> None:
        grid = simulator.grid
        self._lines = [*lines_along(paths, grid).values()]
        self._whole, self._simulator = simulator, simulator.about(self._lines)
        self._settings, self._progress = settings, progress
        self._errors: dict[tuple[int, int], NDArray[np.float64]] = {}
        self._worst = math.pi
        if settings.minimise != "heading":
            self._worst = worst_error(grid.shape, grid.resolution)
        kept = min(len(paths), KEPT + 1)
        self._done, self._total = 0, ROUNDS[0] * len(paths) + (ROUNDS[1] - ROUNDS[0]) * kept
        self._total += min(len(paths), FINALISTS + 1) * settings.drives + RIVAL_DRIVES

    def __call__(self, paths: Sequence[int], numbers: range) -> Scores:
        """Drive some paths with the drives of some numbers."""
        for path, errors in zip(paths, self._drive(self._simulator, paths, numbers), strict=True):
            for number, each in zip(numbers, errors, strict=True):
                self._errors[path, number] = each
        return Scores(
            np.array([self._log_errors(path, numbers) for path in paths]),
            np.array([self._drives(path, numbers).lost for path in paths]),
        )

    def shown(self, path: int, found: Judgement) -> Driven:
        """What is shown of a candidate: the confirmation's drives, or those of the race."""
        leads = found.leader and path in (0, found.leader)
        own = found.drives if leads else range(ROUNDS[-1])
        numbers = range(own.start, max(n + 1 for p, n in self._errors if p == path and n in own))
        ratio = Interval(math.nan, math.nan, math.nan)
        if path:
            apart = self._log_errors(path, numbers) - self._log_errors(0, numbers)
            ratio = found.ratio if leads else of_geometric_mean(np.exp(apart))
        errors = self._log_errors(path, numbers)
        return Driven.of(self._drives(path, numbers), numbers, errors, ratio)

    def rival(self, found: Judgement) -> Driven | None:
        """Drives of the shortest path with the rival's filter, beside those that are shown."""
        rival = self._settings.rival
        if rival is None or rival == self._simulator.robot.filter:
            return None
        numbers = found.drives[:RIVAL_DRIVES]
        robot = dataclasses.replace(self._simulator.robot, filter=rival)
        simulator = self._whole.about(self._lines, robot)
        line = self._lines[0]
        drives = Drives(line, self._drive(simulator, [0], numbers)[0])
        errors = self._scored(drives)
        ratio = of_geometric_mean(np.exp(errors - self._log_errors(0, numbers)))
        if self._progress:
            self._progress(self._total, self._total)
        return Driven.of(drives, numbers, errors, ratio)

    def _drive(
        self, simulator: Simulator, paths: Sequence[int], numbers: range
    ) -> list[NDArray[np.float64]]:
        def step(done: int, _: int) -> None:
            if self._progress:
                self._progress(self._done + done, self._total)

        lines: list[Poses] = [self._lines[path] for path in paths]
        errors = simulator.drive_together(lines, numbers, stream=STREAM, progress=step)
        self._done += len(paths) * len(numbers)
        return errors

    def _drives(self, path: int, numbers: range) -> Drives:
        return Drives(self._lines[path], np.array([self._errors[path, n] for n in numbers]))

    def _log_errors(self, path: int, numbers: range) -> NDArray[np.float64]:
        return self._scored(self._drives(path, numbers))

    def _scored(self, drives: Drives) -> NDArray[np.float64]:
        minimise = self._settings.minimise
        return log_errors(drives.distance, drives.errors, minimise, self._worst)
