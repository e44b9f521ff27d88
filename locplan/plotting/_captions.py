"""Captions of pictures: the weak spots of a field, and the request behind plans."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from locplan.costs import DEGENERATE, Costmap
from locplan.field import CovarianceField
from locplan.planners import Plan

HARMLESS = 1 / 3
"""The u up to which no place of a map is a weak spot."""


def weak_spots(field: CovarianceField, values: NDArray[np.float64], name: str | None = None) -> str:
    """Share of a map's values, in the unit that is shown, whose u is 0.5 or more.

    Where no u is as high, the greatest value; where none is above a third, that nothing is weak.
    """
    shown, name = field.quantity(name), name or field.config.estimator.criterion
    known = values[np.isfinite(values)]
    if not known.size:
        return "nothing is known"
    low, high = (shown.factor * anchor for anchor in field.anchors(name))

    def value(u: float) -> float:
        return low + u * (high - low) if name in field.layers else low * (high / low) ** u

    unit = f" {shown.unit}" if shown.unit != "1" else ""
    least = value(DEGENERATE)
    share, greatest = float(np.mean(known >= least)), float(known.max())
    if share == 0:
        none = "no weak spot: " if greatest < value(HARMLESS) else ""
        return f"{none}at most {greatest:.2g}{unit}"
    said = "under 1%" if share < 0.01 else f"{share:.0%}"
    return f"{said} weak ({least:.2g}{unit} or more)"


def request(costs: Costmap, plans: Mapping[str, Plan]) -> str:
    """Weight, limits, footprint and robot radius that the plans were made with."""
    asked = [f"weight {costs.weight:g}"]
    for plan in plans.values():
        if plan.budget is not None:
            asked = [f"budget {plan.budget:g} m"]
        if plan.max_e is not None:
            asked.append(f"e at most {plan.max_e:g}")
        if plan.footprint is not None and "footprint" not in asked:
            asked.append("footprint")
    return ", ".join([*asked, f"robot radius {costs.robot_radius:g} m"])
