"""Names that navigation stacks use, without heavy imports."""

from __future__ import annotations

from typing import Literal

Distro = Literal["humble", "jazzy", "kilted", "lyrical", "rolling"]
"""A distribution of ROS 2."""
NavPlannerName = Literal["smac2d", "smac-hybrid", "navfn", "thetastar"]
"""A planner of Nav2."""
