"""What pictures say in words: what is drawn, in which unit, and what was asked."""

from __future__ import annotations

from collections.abc import Mapping

from locplan.costs import Costmap
from locplan.field import CovarianceField, FieldConfig
from locplan.field._covariance import UNITS
from locplan.planners import Plan

LABELS = {
    "e": "pose uncertainty e",
    "position_std": "largest position std. deviation",
    "position_rms": "rms position deviation",
    "heading_std": "heading std. deviation",
    "ambiguity": "probability outside the central mode",
    "entropy": "entropy of the posterior",
}


def unit_of(field: CovarianceField, name: str) -> str:
    """Of a scalar of the field."""
    return ({"e": field.e_unit, "ambiguity": "1", "entropy": "nat"} | UNITS)[name]


def how(config: FieldConfig) -> str:
    """The estimator and what decides its values most."""
    if config.sensor is None:
        return f"{config.estimator}, {config.template}, {config.weight_law}"
    several = f", mean of {config.headings} headings" if config.headings != 1 else ""
    return f"{config.estimator}, {config.sensor.field_of_view_deg:g}°{several}"


def request(costs: Costmap, plans: Mapping[str, Plan]) -> str:
    """What was asked of the plans."""
    asked = [f"weight {costs.weight:g}"]
    for plan in plans.values():
        if plan.budget is not None:
            asked = [f"budget {plan.budget:g} m"]
        if plan.max_e is not None:
            asked.append(f"e at most {plan.max_e:g}")
        if plan.footprint is not None and "footprint" not in asked:
            asked.append("footprint")
    return ", ".join([*asked, f"robot radius {costs.robot_radius:g} m"])
