"""Captions of pictures: the settings of a field, and the request behind plans."""

from __future__ import annotations

from collections.abc import Mapping

from locplan.costs import Costmap
from locplan.field import FieldConfig
from locplan.planners import Plan


def how(config: FieldConfig) -> str:
    """Estimator of a field with its most important settings."""
    several = f", mean of {config.headings} headings" if config.headings != 1 else ""
    return f"{config.estimator.summary}{several}"


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
