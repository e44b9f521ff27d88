"""A robot as options of the commands, and as code."""

from __future__ import annotations

import json
from typing import Any

from locplan._util.runs import Spelled
from locplan.robots._lidar import Lidar
from locplan.robots._lidar_presets import PRESETS
from locplan.robots._robot import Robot


def robot_spelled(robot: Robot) -> Spelled:
    """Options and code that make a robot: its lidar's name, and what differs from the defaults.

    Parameters
    ----------
    robot : Robot
        The robot.
    """
    lidar = robot.lidar
    named = lidar.model if lidar and lidar.model in PRESETS else None
    # Any setting of it makes a lidar.
    changes: dict[str, Any] = {"range": lidar.range} if lidar and not named else {}
    changes |= _changes(robot, Robot(Lidar.preset(named) if named else lidar and Lidar()))
    words = ["--lidar", named] if named else []
    for name, value in changes.items():
        words += ["--set", f"{name}={value if isinstance(value, str) else json.dumps(value)}"]
    made = f"locplan.Robot({named!r})" if named else "locplan.Robot()"
    return Spelled(words, f"{made}.changed({changes!r})" if changes else made)


def _changes(robot: Robot, usual: Robot) -> dict[str, Any]:
    """What `Robot.changed` makes the robot of the usual one by."""
    changes: dict[str, Any] = {}
    before = usual.summary()
    for name, value in robot.summary().items():
        was = before[name] if isinstance(before[name], dict) else {name: before[name]}
        now = value if isinstance(value, dict) else {name: value}
        changes |= {key: own for key, own in now.items() if own != was.get(key)}
    changes.pop("model", None)  # it decides nothing
    return changes
