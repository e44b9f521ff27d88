"""The shell command and the Python code that plan the path shown, or choose, once more."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from locplan._util.checks import printable
from locplan._util.runs import Recipe, Spelled, number_text
from locplan.explorer._view import MAX_DRIVES, View
from locplan.field import config_spelled, lidar_of
from locplan.planners import AWARE
from locplan.robots import Robot, robot_spelled

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

UNSAVED = (
    "{} is not the map on the page, which was edited since (or an edit undone).",
    "For the page's map: save it on the page under a new name, and copy this once more.",
)
NO_FILE = 'No file of this map is known: locplan.save_map(grid, "map.yaml") writes one'


def reproduce(session: Session, ask: Ask, work: Work) -> dict[str, str]:
    """Answer the ask for the command and the code of the way shown, or of its simulated choice."""
    drives = ask.whole("drives", 2, MAX_DRIVES)
    view = session.view(ask)
    return reproduced(
        view,
        session.map_file,
        edited=session.edited,
        drives=drives,
    )


def reproduced(
    view: View,
    map_file: str | None,
    *,
    edited: bool = False,
    drives: int | None = None,
) -> dict[str, str]:
    """The command for a POSIX shell, and the code, that plan the path of a view once more.

    Both plan as the page does for a path at rest, through all waypoints, with the planner
    any-angle, on a field that has the spacing of the view's everywhere. With a number of `drives`
    they choose by drives, for which the field is finer near the paths, as the page does.
    """
    notes, file = [NO_FILE] if map_file is None else [], map_file or "map.yaml"
    if map_file and edited:
        notes = [line.format(printable(file)) for line in UNSAVED]
    # What is driven has the lidar that the page assumes; else commands assume it, too.
    robot = view.robot if drives else _named_robot(view)
    config = config_spelled(view.field.config, robot.lidar, whole=not drives)
    shell = _shell(view, file, notes, robot, config, drives)
    return {"shell": shell, "python": _python(view, file, notes, robot, config, drives)}


def _shell(
    view: View,
    file: str,
    notes: list[str],
    robot: Robot,
    config: Spelled,
    drives: int | None,
) -> str:
    """The command, below notes on what it cannot say."""
    above = list(notes)
    if config.after:
        above.append(f"{config.words[-1]} is written by the Python code")
        if robot.lidar and robot.lidar != getattr(view.field.config.estimator, "lidar", None):
            above.append("the command cannot say the lidar: take the Python code")
    settings: dict[str, Any] = {
        "start": view.start[:2],
        "goal": view.goal[:2],
        "via": [xy[:2] for xy in view.via],
        "robot": robot_spelled(robot),
        "config": config,
        **view.cost_settings,
    }
    settings |= {"drives": drives, "output": "chosen"} if drives else {"drives": 0}
    return Recipe("plan", "plan", file, settings, above).shell


def _python(
    view: View,
    file: str,
    notes: list[str],
    robot: Robot,
    config: Spelled,
    drives: int | None,
) -> str:
    """The code, which prints the positions of the path."""
    given = ", ".join(f"{name}={value!r}" for name, value in view.cost_settings.items())
    start, *via, goal = (
        f"({', '.join(map(number_text, xy[:2]))})" for xy in (view.start, *view.via, view.goal)
    )
    through = f", via=[{', '.join(via)}]" if via else ""
    planned = [
        "field = locplan.load_or_compute(grid, config)",
        f"costs = locplan.Costmap.from_field(grid, field, robot_radius=robot.radius, {given})",
        f"plans = locplan.planners.plan_beside_shortest(costs, {start}, {goal}{through})",
        f"print(plans[{AWARE!r}].path.xy.tolist())",
    ]
    if drives:
        asked = f"grid, {start}, {goal}, robot, costs=config{through}, {given}, drives={drives}"
        planned = [f"choice = locplan.choose({asked})", "print(choice.path.xy.tolist())"]
    lines = [
        *(f"# {note}" for note in notes),
        "import locplan",
        "",
        f"grid = locplan.load_map({file!r})",
        f"robot = {robot_spelled(robot).code}",
        f"config = {config.code}",
        *config.after,
        *planned,
    ]
    return "\n".join(lines) + "\n"


def _named_robot(view: View) -> Robot:
    """The robot of a view; without a lidar where commands assume the same one."""
    config = view.field.config
    assumed = not config.estimator.casts_rays and view.robot.lidar == lidar_of(config)
    return dataclasses.replace(view.robot, lidar=None) if assumed else view.robot
