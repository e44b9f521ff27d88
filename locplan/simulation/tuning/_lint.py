"""Warnings about parameters of AMCL that make it work badly, or not as it seems."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from locplan._util.checks import is_number
from locplan._util.intervals import random_of
from locplan.costs import ROBOT_RADIUS
from locplan.robots import Amcl, Lidar
from locplan.simulation._simulator import BEAMS, Simulator

UNLIMITED = 100.0
"""Nav2's default of `laser_max_range`, which stands for no limit [m]."""
TOLERANCE = 0.01
"""Difference from 1 of weights that count as adding up to it."""
MAX_SIGMA = 0.5
"""Greatest `sigma_hit` that makes sense on a map of a building [m]."""
FEW = 0.5
"""Share of the beams compared below which those that return are few."""
PLACES = 200
"""Number of random places at which the beams that return are counted."""


@dataclass(frozen=True)
class BeamsLeft:
    """Beams of a scan that AMCL compares, and how many of them return, on the average."""

    compared: int
    """Number of beams that are compared."""
    returned: float
    """Mean number of these that return, over random places of the map."""

    def __str__(self) -> str:
        return f"of {self.compared} beams compared, {self.returned:.0f} return on this map"

    def warnings(self) -> list[str]:
        """A warning if fewer than half of the beams return."""
        if self.returned >= FEW * self.compared:
            return []
        return [
            f"{self}: Nav2 skips the others, whose walls are out of the lidar's range or too near;"
            " raise max_beams, or laser_max_range where it is below the lidar's range"
        ]


def filter_warnings(
    amcl: Amcl, lidar: Lidar, others: Mapping[str, object] | None = None
) -> list[str]:
    """Return warnings about a filter's parameters, one line each.

    Parameters
    ----------
    amcl : Amcl
        The parameters.
    lidar : Lidar
        The robot's lidar.
    others : mapping, optional
        Further parameters in the robot's file, such as `z_short`.
    """
    return [*_of_weights(amcl, others or {}), *_of_ranges(amcl, lidar), *_of_field(amcl, lidar)]


def beams_left(
    simulator: Simulator, *, places: int = PLACES, robot_radius: float = ROBOT_RADIUS
) -> BeamsLeft:
    """Count the beams that return at random places of the map where the robot fits.

    Parameters
    ----------
    simulator : Simulator
        The map, the lidar, the filter and the disturbances.
    places : int
        Number of places, each with a random heading.
    robot_radius : float
        Radius of the robot [m]; where it fits nowhere, all free cells count.
    """
    from locplan._kernels.lidar import measured_ends

    random = random_of(simulator.seed, BEAMS)
    grid, arguments = simulator.grid, simulator.arguments
    cells = np.argwhere(grid.free & (grid.clearance >= robot_radius))
    cells = cells if len(cells) else np.argwhere(grid.free)
    ends = np.empty((arguments.lidar.angles.size, 2))
    returned = 0
    for n, cell in enumerate(cells[random.integers(0, len(cells), places)] if len(cells) else []):
        measured_ends(
            random,
            simulator.worlds[n % len(simulator.worlds)],
            grid.resolution,
            np.array([*(cell + 0.5), random.uniform(-np.pi, np.pi)]),
            arguments.lidar,
            arguments.disturbances,
            ends,
        )
        returned += int(np.isfinite(ends[:, 0]).sum())
    return BeamsLeft(len(ends), returned / places)


def _of_weights(amcl: Amcl, others: Mapping[str, object]) -> list[str]:
    found = []
    both = amcl.z_hit + amcl.z_rand
    rest = [float(v) for name in ("z_short", "z_max") if is_number(v := others.get(name))]
    if all(abs(total - 1) > TOLERANCE for total in (both, both + sum(rest))):
        found.append(
            f"z_hit and z_rand add up to {both:g}: likelihood fields use these two weights, which"
            " should add up to 1"
        )
    if amcl.alpha1 == amcl.alpha2 == amcl.alpha3 == amcl.alpha4 == 0:
        found.append(
            "alpha1 to alpha4 are all 0: the particles move as odometry says, and cannot correct it"
        )
    return found


def _of_ranges(amcl: Amcl, lidar: Lidar) -> list[str]:
    found = []
    least, most = amcl.laser_min_range, amcl.laser_max_range
    reach = min(most, lidar.range) if most > 0 else lidar.range
    if lidar.range < most < UNLIMITED:
        found.append(
            f"laser_max_range ({most:g} m) is beyond the lidar's range of {lidar.range:g} m,"
            " which counts instead"
        )
    if least >= reach:
        found.append(
            f"laser_min_range ({least:g} m) is not below the range of {reach:g} m: no beam counts"
        )
    return found


def _of_field(amcl: Amcl, lidar: Lidar) -> list[str]:
    found = []
    sigma, far = amcl.sigma_hit, amcl.laser_likelihood_max_dist
    if sigma > MAX_SIGMA:
        found.append(f"sigma_hit ({sigma:g} m) is wide: walls {2 * sigma:g} m apart look as one")
    if sigma < lidar.range_sigma:
        found.append(
            f"sigma_hit ({sigma:g} m) is below the lidar's own noise of {lidar.range_sigma:g} m:"
            " it rejects beams that are right"
        )
    if far < 2 * sigma:
        found.append(
            f"laser_likelihood_max_dist ({far:g} m) is below twice sigma_hit ({sigma:g} m): beams"
            " that miss the walls cost hardly more than those that hit them"
        )
    return found
