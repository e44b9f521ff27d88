"""Options that say where the robot drives, and which lidar it carries."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from locplan.cli._groups import FIELD, GENERAL, INPUT, Text, option_group
from locplan.cli._values import read_paths, two_numbers
from locplan.errors import ConfigError
from locplan.robots import PRESETS

if TYPE_CHECKING:
    from locplan.robots import Lidar


@option_group(GENERAL)
class RouteOptions:
    """The routes of the robot."""

    start: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """The robot drives the shortest path from here [m]."""
    goal: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """The shortest path leads here [m]."""
    path: Annotated[tuple[Path, ...], INPUT, Parameter(metavar="CSV")] = ()
    """The robot drives this path (x_m,y_m); repeatable."""
    places: Annotated[Path | None, INPUT, Parameter(metavar="CSV")] = None
    """The robot drives between all places in this file (name,x,y)."""

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


@option_group(FIELD)
class LidarOptions:
    """The lidar."""

    lidar: Annotated[str | None, Parameter(choices=tuple(PRESETS))] = None
    """The lidar, or the robot that carries it, is one of these; one of 6 m by default."""
    range: float | None = None
    """The lidar's range [m] is that of its data sheet, or 6 by default where none is named."""
    field_of_view: float | None = None
    """The lidar's field of view [deg] is that of its data sheet, or 360 where none is named."""

    def named(self) -> Lidar:
        """The lidar that was named, or a short one, with its own range and view where given."""
        from locplan.cli._options import _changed
        from locplan.field import SHORT_LIDAR
        from locplan.robots import Lidar

        lidar = Lidar.preset(self.lidar) if self.lidar else SHORT_LIDAR
        return _changed(lidar, self.range, self.field_of_view)
