"""The weak spots of a scene, with the names and reasons that the page shows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.kernels.arrays import Bools
from locplan.advice.weak_spots import NO_HEADING, WeakSpot, are_inside, find_weak_spots
from locplan.planning.costmap import Costmap

if TYPE_CHECKING:
    from locplan.app.explorer.check_reports import CheckReport
    from locplan.app.explorer.scene import MapScene

LETTERS = "ABCDEF"
"""Letters of the weak spots that are shown, the worst first."""
LONG = 8.0
"""Minimum length of a long corridor [m]."""


@dataclass(frozen=True, eq=False)
class NamedSpot:
    """A weak spot as the page shows it."""

    spot: WeakSpot
    """The weak spot, with its letter."""
    reach: float
    """Range of the lidar [m]."""

    @property
    def title(self) -> str:
        """Kind and size of the place."""
        spot, missing = self.spot, self.spot.missing
        length, width = max(spot.length, spot.width), min(spot.length, spot.width)
        if not spot.rings:
            return "Drives fail here"
        if missing == NO_HEADING:
            return f"Round place, {length:.0f} m"
        if missing.startswith("no features along"):
            corridor = "Long corridor" if length > LONG else "Corridor"
            return f"{corridor if length > 3 * width else 'Bare place'}, {length:.0f} m"
        kind = "Open space" if missing.startswith("few walls") else "Cluttered place"
        return f"{kind}, {length:.0f} x {width:.0f} m"

    @property
    def reason(self) -> str:
        """Sentence that explains why scans are weak there."""
        spot = self.spot
        missing = f"{spot.missing[:1].upper()}{spot.missing[1:]}"
        if not spot.rings:
            return f"{missing}."
        if "within" not in missing:
            missing += f" within {self.reach:g} m"
        uncertain = "heading" if spot.missing == NO_HEADING else "position"
        return f"{missing}: a scan leaves the {uncertain} uncertain by {spot.deviation}."

    @property
    def facts(self) -> dict[str, Any]:
        """The spot as plain data for JSON."""
        spot = self.spot
        return {
            "letter": spot.letter,
            "x": spot.x,
            "y": spot.y,
            "title": self.title,
            "reason": self.reason,
            "sigma_cm": 100 * spot.position_std,
            "outline": np.round(spot.outline, 3).tolist(),
        }

    def contains(self, xy: tuple[float, float]) -> bool:
        """Return True if a position [m] lies in the spot."""
        within: Bools = are_inside(self.spot, np.array([xy]))
        return bool(within[0])


def name_weak_spots(scene: MapScene, report: CheckReport | None = None) -> list[NamedSpot]:
    """Return the weak spots of a scene with a field, the worst first.

    Parameters
    ----------
    scene : Scene
        The scene.
    report : CheckReport, optional
        Report on the same map and robot. Its weak spots replace those of the scene.
    """
    assert scene.field is not None
    reach = float(scene.field.config.estimator.reach)
    costs = scene.costs
    if costs.zones:  # weak spots do not depend on zones
        costs = Costmap.from_field(scene.field, robot=costs.robot_radius)
    spots: Sequence[WeakSpot] = find_weak_spots(costs, scene.field, reach, {})
    if report is not None:
        spots = [_with_outline(facts, spots) for facts in report.facts["weak_spots"]]
    else:
        spots = [
            dataclasses.replace(spot, letter=letter)
            for letter, spot in zip(LETTERS, spots, strict=False)
        ]
    return [NamedSpot(spot, reach) for spot in spots if spot.letter]


def _with_outline(facts: dict[str, Any], spots: Sequence[WeakSpot]) -> WeakSpot:
    """Return a report's weak spot with the outline of the scene's spot around it."""
    values: dict[str, Any] = {
        name: math.nan if value is None else value for name, value in facts.items()
    }
    values |= {"routes": tuple(facts["routes"]), "outline": np.zeros((0, 2))}
    spot, spot_xy = WeakSpot(**values), np.array([[facts["x"], facts["y"]]])
    if math.isnan(spot.position_std):  # no scan is weak there, whatever surrounds it
        return spot
    around = next((other for other in spots if are_inside(other, spot_xy)[0]), spot)
    return dataclasses.replace(spot, outline=around.outline, holes=around.holes)
