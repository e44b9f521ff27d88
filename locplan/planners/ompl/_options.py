"""The options of OMPL's planners, checked without ompl where that can be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from locplan._util.checks import whole
from locplan._util.progress import ProgressCallback
from locplan.errors import ConfigError
from locplan.planners._spaces import check_space
from locplan.planners.ompl._kinds import KINDS, able
from locplan.planners.ompl._stopping import TIME_LIMIT, Limits


@dataclass(frozen=True)
class Options:
    """What one of OMPL's planners shall do."""

    name: str
    """OMPL's name of the planner, such as "RRTstar"."""
    space: str = "R2"
    """"R2"; "SE2", turning on the spot for nothing; "Dubins", curves driven forward;
    "ReedsShepp", curves that may reverse."""
    turning_radius: float | None = None
    """Least radius of the curves [m]."""
    time_limit: float | None = None
    """Time after which the search ends [s]; 5 unless `iterations` are given."""
    iterations: int | None = None
    """Iterations after which the search ends; with the same seed it finds the same path."""
    convergence: float | None = None
    """The search ends when J fell by less than this share over the latter half of iterations."""
    seed: int | None = None
    """Seed of OMPL's random numbers, at least 1; 1 by default."""
    from_grid: bool = False
    """Whether it begins with the grid planner's path: RRTstar and its kin grow their tree along
    it, roadmaps hold it, and what comes of it costs no more. In "R2" only."""
    improve: bool = False
    """Whether the path is straightened at last as any-angle does it. In "R2" only."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """OMPL's own settings of the planner, such as ``{"range": 2.0}`` for its `setRange`."""
    progress: ProgressCallback | None = field(default=None, compare=False, repr=False)
    """Called with what passed of the limit and the limit, in milliseconds or iterations."""

    @property
    def minimises(self) -> str | None:
        """ "J", or None for those that stop at the first path."""
        kind = KINDS.get(self.name)
        return "J" if kind and kind.minimises else None

    @property
    def limits(self) -> Limits:
        """When to end a search that begins now."""
        return Limits(self.time_limit, self.iterations, self.convergence, self.progress)

    @property
    def seconds(self) -> float | None:
        """Time after which the search ends [s], if it does not end by iterations alone."""
        return TIME_LIMIT if self.time_limit is self.iterations is None else self.time_limit

    def check(self) -> None:
        """Raise a ConfigError unless the planner can do what the options say."""
        if self.name not in KINDS:
            raise ConfigError(f"OMPL's planners are {', '.join(KINDS)}, not {self.name!r}")
        kind = KINDS[self.name]
        check_space(self.space, self.turning_radius)
        if self.space not in kind.spaces:
            raise ConfigError(
                f"{self.name} cannot plan in {self.space}; {able(space=self.space)} can"
            )
        if self.from_grid and not (kind.from_grid and self.space == "R2"):
            raise ConfigError(f"from_grid is for {able(from_grid=True)}, in space R2")
        if self.improve and self.space != "R2":
            raise ConfigError("improve is for space R2: straight lines keep no turning radius")
        if self.progress is not None and not callable(self.progress):
            raise ConfigError(f"progress must be a function, not {self.progress!r}")
        _ = self.limits
        if self.convergence is not None and not kind.anytime:
            raise ConfigError(f"convergence is for {able(anytime=True)}")
        if self.seed is not None:
            whole("seed", self.seed)
        if self.settings != {}:
            from locplan.planners.ompl._settings import check_settings

            check_settings(self.name, self.settings)
