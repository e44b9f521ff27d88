"""The lattice planner's motions as Nav2's SmacPlannerLattice reads them."""

from __future__ import annotations

import json
import math
import os
from datetime import date
from pathlib import Path as FilePath

import numpy as np

from locplan._kernels.arrays import Floats
from locplan._util.checks import positive
from locplan._util.files import check_target, replacing
from locplan.costs import divided_poses
from locplan.planners._lattice import Lattice
from locplan.planners._primitives import Primitive, angles_of, primitives
from locplan.robots import Robot

MODELS = {"differential": "diff", "omnidirectional": "omni", "car-like": "ackermann"}
"""Names of the drives in the file."""
TURN_STEP = 0.15
"""Maximum turn between two poses of a motion [rad]; straight on it is a cell."""


def smac_lattice(
    path: str | os.PathLike[str],
    robot: Robot,
    resolution: float,
    *,
    headings: int = 16,
    span: int = 1,
) -> None:
    """Write a robot's motions for the parameter lattice_filepath of Nav2's SmacPlannerLattice.

    They are those of `Lattice`; in reverse Smac takes them by allow_reverse_expansion. Of robots
    that turn on the spot the file names a cell as turning radius, since Smac divides by it.

    Parameters
    ----------
    path : path
        The file, named *.json; one that is there is replaced.
    robot : Robot
        The robot, whose kinematics count.
    resolution : float
        Edge length of the cells of the costmap that Smac plans on, above 0 [m].
    headings : int, default 16
        Number of headings: 8, 16 or 32.
    span : int, default 1
        Number of headings, 1 to 4, that one turn may pass.

    Raises
    ------
    ConfigError
        If a number is out of its range.
    LocplanError
        If the suffix is another, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     smac_lattice(f"{folder}/lattice.json", Robot(), 0.05)
    """
    file = FilePath(path)
    check_target(file, ".json")
    positive("resolution", resolution, "metres")
    Lattice(headings=headings, span=span).check()
    radius, drive = robot.kinematics.turning_radius, robot.kinematics.drive
    found = primitives(headings, radius / resolution, drive == "omnidirectional", span)
    about = {
        "motion_model": MODELS[drive],
        "turning_radius": max(radius, resolution),
        "grid_resolution": resolution,
        "num_of_headings": headings,
        "heading_angles": angles_of(headings).tolist(),
        "number_of_trajectories": len(found),
    }
    motions = [_trajectory(n, each, resolution) for n, each in enumerate(found)]
    made = {"version": 1.0, "date_generated": date.today().isoformat()}
    text = json.dumps({**made, "lattice_metadata": about, "primitives": motions}, indent=1)
    with replacing(file) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _trajectory(number: int, motion: Primitive, edge: float) -> dict[str, object]:
    """A motion as the file has it."""
    poses = np.array(motion.poses) * np.array([edge, edge, 1.0])
    turn, length = np.abs(np.diff(poses[:, 2])), np.hypot(*np.diff(poses[:, :2], axis=0).T)
    arc = float(length[turn > 1e-9].sum())
    return {
        "trajectory_id": number,
        "start_angle_index": motion.source,
        "end_angle_index": motion.target,
        "left_turn": bool(poses[-1, 2] >= poses[0, 2]),
        "trajectory_radius": arc / float(turn.sum()) if arc else 0.0,
        "trajectory_length": float(length.sum()),
        "arc_length": arc,
        "straight_length": float(length.sum()) - arc,
        "poses": [[x, y, heading % (2 * math.pi)] for x, y, heading in _spaced(poses, edge)],
    }


def _spaced(poses: Floats, edge: float) -> list[list[float]]:
    """Poses after the first one about a cell apart, or 0.15 rad, with the last one."""

    def parts(poses: Floats) -> Floats:
        length = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        turn = np.abs(np.diff(poses[:, 2]))
        return np.asarray(np.maximum(length / edge, turn / TURN_STEP))

    dense = divided_poses(poses, 4 * parts(poses))
    passed = np.floor(np.concatenate([[0.0], np.cumsum(parts(dense))]) + 1e-6)
    kept = np.diff(passed, prepend=0.0) > 0
    kept[-1] = True
    spaced: list[list[float]] = dense[kept].tolist()
    return spaced
