"""Benches of several maps, or of several recorded drives, joined into one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from locplan._kernels.arrays import Floats
from locplan.robots import Amcl
from locplan.simulation._drives import Drives
from locplan.simulation.tuning._bench import TuningBench


def joined(benches: Sequence[TuningBench], names: Sequence[str]) -> TuningBench:
    """Several benches as one; a single bench stays as it is.

    Parameters
    ----------
    benches : sequence of TuningBench
        Benches with as many paths and drives each.
    names : sequence of str
        Names of their maps or drives, which their levels have before their own.
    """
    numbers = [names[:n].count(name) + 1 for n, name in enumerate(names)]
    apart = [f"{name} {n}" if n > 1 else name for name, n in zip(names, numbers, strict=True)]
    return benches[0] if len(benches) == 1 else _JoinedBench(benches, apart)


class _JoinedBench(TuningBench):
    """Several benches as one, whose levels are theirs one after the other."""

    def __init__(self, benches: Sequence[TuningBench], names: Sequence[str]) -> None:
        first = benches[0]
        self._benches = benches
        self._at = [(each, n) for each in benches for n in range(len(each.levels))]
        levels = [
            replace(level, name=f"{name} {level.name}")
            for name, bench in zip(names, benches, strict=True)
            for level in bench.levels
        ]
        about = first.grid, first.filter_map, first.lidar, levels, first.lines
        super().__init__(*about, first.drives, first.seed, first.threads)
        self.grids = tuple(dict.fromkeys(each.grid for each in benches))
        self.parts = names
        self.lengths = np.mean([each.lengths for each in benches], axis=0)
        sizes = [len(each.levels) for each in benches]
        self.strongest = [int(n) - 1 for n in np.cumsum(sizes)]

    def arguments(self, amcl: Amcl) -> list[Any]:
        """Those of all benches."""
        return [each for bench in self._benches for each in bench.arguments(amcl)]

    def errors(self, level: int, path: int, drive: int, arguments: Any) -> Floats:
        """Those of the bench that the level is of."""
        bench, n = self._at[level]
        return bench.errors(n, path, drive, arguments)

    def world(self, level: int, path: int, drive: int) -> Any:
        """That of the bench that the level is of."""
        bench, n = self._at[level]
        return bench.world(n, path, drive)

    def updates(self, amcl: Amcl) -> float:
        """Updates on all paths of a bench, on the average."""
        return float(np.mean([each.updates(amcl) for each in self._benches]))

    def whole(self, amcl: Amcl) -> list[Drives]:
        """Replays of all drives."""
        return [each for bench in self._benches for each in bench.whole(amcl)]

    def kidnapped(self, amcl: Amcl, metres: float) -> Floats:
        """Errors of all benches."""
        return np.concatenate([each.kidnapped(amcl, metres) for each in self._benches])


def several(given: Any) -> list[Any]:
    """What was given one of, or a sequence of; at least one.

    Parameters
    ----------
    given : object
        A map, a drive, or a sequence of them.
    """
    many = isinstance(given, Sequence) and not isinstance(given, str) and len(given) > 0
    return [*given] if many else [given]
