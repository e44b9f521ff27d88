"""A planner in a file of its own, as one would be added to the registry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from locplan.errors import ConfigError
from locplan.planning import Costmap, Path, PlannerResult
from locplan.planning.protocol import Position


@dataclass(frozen=True)
class ToyPlanner:
    """Two lines with a right angle between them, whatever is in their way."""

    rows_first: bool = False
    """Whether the first line goes along y."""
    seed: int | None = None
    """Seed that counts for nothing."""
    name: ClassVar[str] = "toy"
    minimises: ClassVar[str | None] = None
    space: ClassVar[str] = "R2"

    def check(self) -> None:
        if not isinstance(self.rows_first, bool):
            raise ConfigError(f"rows_first must be true or false, not {self.rows_first!r}")

    def prepare(self) -> None:
        pass

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        corner = (start[0], goal[1]) if self.rows_first else (goal[0], start[1])
        return PlannerResult(Path([start, corner, goal]), note=f"seed {self.seed}")
