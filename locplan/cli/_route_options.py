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
    """Path of the robot (x,y); repeatable."""
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

        ends = [*filter(None, (self.start, self.goal))]
        _check_one(
            {"--path": self.path, "--start with --goal": ends, "--places": self.places}, others
        )
        if len(ends) == 1:
            raise ConfigError("--start and --goal belong together")
        if self.path:
            return {"paths": read_paths(self.path)}
        if self.places:
            return {"places": {s.name: (s.x, s.y) for s in read_stations(self.places)}}
        places = zip(("start", "goal"), ends, strict=False)
        return {"places": {n: two_numbers(n, xy) for n, xy in places}} if ends else {}


def _check_one(own: dict[str, Any], others: dict[str, Any]) -> None:
    """Raise a ConfigError unless just one of the options was given."""
    every = own | {f"--{name}": each for name, each in others.items()}
    if sum(map(bool, every.values())) != 1:
        *names, last = every
        raise ConfigError(f"give one of {', '.join(names)}, and {last}")
