"""Options that say where the robot drives."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import locplan
from locplan.cli._groups import INPUT, XY, Csv, option_group
from locplan.cli._values import read_paths
from locplan.errors import ConfigError


@option_group("Options")
class RouteOptions:
    """The routes of the robot."""

    start: XY = None
    """Start of a shortest path, x,y in metres."""
    goal: XY = None
    """Goal of this path, x,y in metres."""
    path: Csv = ()
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
        ends: dict[str, Any] = {"start": self.start, "goal": self.goal}
        given = [*filter(None, ends.values())]
        own = {"--path": self.path, "--start with --goal": given, "--places": self.places}
        _check_one(own | {f"--{name}": each for name, each in others.items()})
        if len(given) == 1:
            raise ConfigError("--start and --goal belong together")
        if self.path:
            return {"paths": read_paths(self.path)}
        if self.places:
            stations = locplan.planners.read_stations(self.places)
            ends = {each.name: (each.x, each.y) for each in stations}
        return {"places": ends} if given or self.places else {}


def _check_one(options: dict[str, Any]) -> None:
    """Raise a ConfigError unless just one of the options was given."""
    if sum(map(bool, options.values())) != 1:
        *names, last = options
        raise ConfigError(f"give one of {', '.join(names)}, and {last}")
