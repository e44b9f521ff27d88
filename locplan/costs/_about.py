"""What results were made of."""

from __future__ import annotations

from locplan import __version__
from locplan._util.tables import finite
from locplan.costs._costmap import Costmap


def about_costs(costs: Costmap) -> dict[str, object]:
    """The version, the map and the costmap's settings, fit for JSON."""
    return {
        "locplan": __version__,
        "map": {"name": costs.grid.name, "digest": costs.grid.digest},
        **finite({"weight": costs.weight, "robot_radius": costs.robot_radius}),
        **(costs.settings.to_json() if costs.settings else {}),
    }
