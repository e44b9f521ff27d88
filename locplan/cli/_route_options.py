"""Options that say where the robot drives."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from locplan.cli._groups import GENERAL, INPUT, Text, option_group
from locplan.cli._values import read_paths, two_numbers
from locplan.errors import ConfigError


@option_group(GENERAL)
class RouteOptions:
    """The routes of the robot."""

    start: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """Start of a shortest path, x,y in metres."""
    goal: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """Goal of this path, x,y in metres."""
    path: Annotated[tuple[Path, ...], INPUT, Parameter(metavar="CSV")] = ()
    """Path of the robot (x_m,y_m); repeatable."""
    places: Annotated[Path | None, INPUT, Parameter(metavar="CSV")] = None
    """Places (name,x,y) between all of which the robot drives."""

    def given(self, **others: object) -> dict[str, Any]:
        """The arguments paths or places, or nothing if one of the other options was given.

        Raises
        ------
        ConfigError
            If not just one of them all was given.
        """
        from locplan.planners import read_stations

        own = bool(self.path), bool(self.start or self.goal), self.places is not None
        given = [*own, *map(bool, others.values())]
        if given.count(True) != 1 or bool(self.start) != bool(self.goal):
            *names, last = "--path", "--start with --goal", "--places", *(f"--{o}" for o in others)
            raise ConfigError(f"give one of {', '.join(names)}, and {last}")
        if self.path:
            return {"paths": read_paths(self.path)}
        if self.places:
            return {"places": {s.name: (s.x, s.y) for s in read_stations(self.places)}}
        if self.start and self.goal:
            ends = two_numbers("start", self.start), two_numbers("goal", self.goal)
            return {"places": {"start": ends[0], "goal": ends[1]}}
        return {}
