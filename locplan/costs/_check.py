"""The check that something is a costmap."""

from __future__ import annotations

from locplan._util.checks import instance
from locplan.costs._costmap import Costmap


def check_costs(costs: object) -> None:
    """Raise a ConfigError unless this is a costmap.

    Parameters
    ----------
    costs : object
        What a function was given for a costmap.
    """
    instance("costs", costs, Costmap, "make one with locplan.Costmap.from_field(grid, field)")
