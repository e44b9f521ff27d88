"""The default planner for a robot, and notes on constraints that a planner ignores."""

from __future__ import annotations

from typing import TYPE_CHECKING

from locplan.planning.path_check import TIGHT, find_path_faults
from locplan.planning.protocol import CURVED, LATTICE
from locplan.planning.registry import DEFAULT

if TYPE_CHECKING:
    from locplan.planning.costmap import Costmap
    from locplan.planning.path import Path
    from locplan.planning.protocol import Planner
    from locplan.robots.robot import Robot


def needs_lattice(robot: Robot | None) -> bool:
    """True if a robot has an outline or a turning radius, so that a circle cannot stand for it.

    Parameters
    ----------
    robot : Robot or None
        The robot; None if only its radius is known.
    """
    return robot is not None and (robot.outline is not None or robot.kinematics.turning_radius > 0)


def default_planner(robot: Robot | None) -> str:
    """Return the name of the planner that is used for a robot if none is named.

    Parameters
    ----------
    robot : Robot or None
        The robot of the costmap; None if only its radius is known.

    Returns
    -------
    str
        "lattice" for a robot with an outline or a turning radius, otherwise "any-angle".
    """
    return "lattice" if needs_lattice(robot) else DEFAULT


def describe_robot_conflict(planner: Planner, costs: Costmap, path: Path) -> str:
    """Return a note on the constraints of the costmap's robot that a planner's path ignores.

    Parameters
    ----------
    planner : Planner
        The planner, with its limits.
    costs : Costmap
        The costmap that was planned on.
    path : Path
        The planner's path.

    Returns
    -------
    str
        The note; empty if the planner respects the robot. A planner that locplan does not know is
        judged by its path.
    """
    robot = costs.robot
    if robot is None or not needs_lattice(robot):
        return ""
    keeps_outline, inner = False, planner
    while (inner_planner := getattr(inner, "planner", None)) is not None:
        keeps_outline |= getattr(inner, "outline", None) is not None
        inner = inner_planner
    if not type(inner).__module__.startswith("locplan.planning.") or _is_function(inner):
        faults = find_path_faults(costs.grid, path, robot)
        fault_text = f"{faults[0].kind} near {faults[0].x:.2f},{faults[0].y:.2f}" if faults else ""
        return f"the robot cannot drive this path: {fault_text}" if faults else ""
    if inner.space == LATTICE:
        return ""
    keeps_outline |= inner.space != "R2"
    kinematics = robot.kinematics
    radius = getattr(inner, "turning_radius", None) if inner.space in CURVED else None
    keeps_radius = (radius or 0.0) >= kinematics.turning_radius * (1 - TIGHT)
    backs_up = inner.space == "ReedsShepp" and not kinematics.reverse
    return describe_ignored_constraints(
        planner.name, robot, outline=keeps_outline, radius=keeps_radius, reverse=not backs_up
    )


def describe_ignored_constraints(
    name: str,
    robot: Robot | None,
    *,
    outline: bool = False,
    radius: bool = False,
    reverse: bool = True,
) -> str:
    """Return a note on a robot's constraints that a planner of this name ignores.

    Parameters
    ----------
    name : str
        The planner's name.
    robot : Robot or None
        The robot.
    outline, radius, reverse : bool
        True if the planner respects the robot's outline, its turning radius, and whether it drives
        in reverse.
    """
    if robot is None:
        return ""
    ignored = [] if outline or robot.outline is None else ["outline"]
    ignored += [] if radius or not robot.kinematics.turning_radius else ["turning radius"]
    ignored += [] if reverse else ["lack of a reverse gear"]
    if not ignored:
        return ""
    ignored_text = " and ".join(ignored)
    remedy = "check the path with check_path, or plan by lattice"
    return f"{name} ignores the robot's {ignored_text}: {remedy}"


def _is_function(planner: object) -> bool:
    """True if a planner is a user's function."""
    return hasattr(planner, "function")
