"""Descriptions of the input that results were made from, and the check that it is a costmap."""

from __future__ import annotations

from locplan import __version__
from locplan._util.checks import instance
from locplan._util.tables import finite
from locplan.costs._costmap import Costmap


def about_costs(costs: Costmap) -> dict[str, object]:
    """Version, map and settings of a costmap, fit for JSON.

    Parameters
    ----------
    costs : Costmap
        The costmap, whether or not it has a field.
    """
    return {
        "locplan": __version__,
        "map": {"name": costs.grid.name, "digest": costs.grid.digest},
        **finite({"weight": costs.weight, "robot_radius": costs.robot_radius}),
        **(costs.settings.to_json() if costs.settings else {}),
    }


def costs_caption(costs: Costmap) -> str:
    """A further line of a title about the field and the robot of a costmap.

    Parameters
    ----------
    costs : Costmap
        The costmap.

    Returns
    -------
    str
        The line, which begins with a line break; empty for a costmap without a field.
    """
    if costs.settings is None:
        return ""
    return f"\n{costs.settings.config.summary}, robot radius {costs.robot_radius:g} m"


def check_costs(costs: object) -> None:
    """Raise a ConfigError unless this is a costmap.

    Parameters
    ----------
    costs : object
        What a function was given for a costmap.
    """
    instance("costs", costs, Costmap, "make one with locplan.Costmap.from_field(grid, field)")
