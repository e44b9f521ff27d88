"""What is taken away from the page: exports, and the command and the code of the path shown."""

from __future__ import annotations

import dataclasses
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locplan._util.checks import printable
from locplan._util.files import make_folder
from locplan._util.runs import Recipe, Spelled
from locplan.errors import ConfigError, LocplanError
from locplan.explorer._scene import MAX_DRIVES
from locplan.export import ExportJob, distribution, formats
from locplan.field import config_spelled, lidar_of
from locplan.planners import AWARE
from locplan.robots import robot_spelled

if TYPE_CHECKING:
    from locplan.explorer._asks import Ask, Work
    from locplan.explorer._session import Session


def export(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Write an export of the view, as `locplan export` does; only "path" exports its way.

    Nothing that is there is replaced without `force`: the export gets a number behind its name.
    With it, a file is replaced, and a folder if it is an export of ours without changes.
    """
    offered = ("nav2-keepout", "nav2-static", "nav2-speed", "route-graph", "path")
    to = ask.one_of("to", offered, offered[0])
    distro, opening = ask.text("distro", None), session.opening
    folder, force = opening.folder, opening.force
    view = session.view(ask)
    work.progress(0, 1, "writing")
    if folder is None:
        raise ConfigError("exports need a folder: start the explorer with --folder FOLDER")
    format = formats()[to]
    if distro is not None:
        distribution(distro)
    has_distro = any(each.name == "distro" for each in dataclasses.fields(format.options))
    options: Any = format.options(**({"distro": distro} if distro and has_distro else {}))
    suffix = "".join(format.suffixes[:1])
    stem = f"{plain_name(view.grid.name)}-{to}"
    target = folder / f"{stem}{suffix}" if force else _unused(folder, stem, suffix)
    paths = {AWARE: view.paths()[0]} if format.paths == "one" else {}
    make_folder(folder)
    format.check_target(target, force=force)
    job = ExportJob(view.costs, view.field, paths, work.progress, view.robot)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        summary = format.write(target, job, options)
    written = [target] if target.is_file() else sorted(target.rglob("*"))
    return {
        "folder": str(folder),
        "files": [each.relative_to(folder).as_posix() for each in written if each.is_file()],
        "facts": dict(summary.rows),
        "warnings": [*dict.fromkeys(str(each.message) for each in caught)],
    }


def plain_name(name: str) -> str:
    """A map's name as the name of a file: letters, digits, dots, dashes and underlines."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._-")[:80] or "map"


def _unused(folder: Path, stem: str, suffix: str) -> Path:
    """A name in the folder that nothing has, with a number where others are there."""
    for number in range(1, 1001):
        target = folder / f"{stem}{f'-{number}' if number > 1 else ''}{suffix}"
        if not target.exists() and not target.is_symlink():
            return target
    raise LocplanError(f"{folder}: holds 1000 such exports; remove some")


def reproduce(session: Session, ask: Ask, work: Work) -> dict[str, str]:
    """Answer with the command and the code that plan the path shown, or choose, once more.

    Both plan as the page does for a path at rest, through all waypoints, with the planner
    any-angle, on a field that has the spacing of the page's everywhere. With a number of drives
    they choose by drives, for which the field is finer near the paths, as the page does.
    """
    drives = ask.whole("drives", 2, MAX_DRIVES, 0)
    view, file = session.view(ask), session.map_file
    config, robot = view.field.config, view.robot
    assumed = not config.estimator.casts_rays and robot.lidar == lidar_of(config)
    if assumed and not drives:  # commands assume the same lidar; what is driven has a known one
        robot = dataclasses.replace(robot, lidar=None)
    spelled = config_spelled(config, robot.lidar, whole=not drives)
    settings: dict[str, Any] = {
        "start": view.start[:2],
        "goal": view.goal[:2],
        "robot": robot_spelled(robot),
        "config": spelled._replace(argument="costs"),
        **view.cost_settings,
        "drives": drives,
    }
    if view.via:
        settings["via"] = [xy[:2] for xy in view.via]
    if config.estimator.casts_rays and not drives:  # options say that by the spacing
        whole = "lambda grid, points=None: locplan.load_or_compute(grid, config)"
        settings["compute"] = Spelled((), whole)
    notes = []
    if file is None:
        notes = ['No file of this map is known: locplan.save_map(grid, "map.yaml") writes one']
    elif session.edited:
        notes = [
            f"{printable(file)} is not the map on the page, which was edited since (or an edit"
            " undone).",
            "For the page's map: save it on the page under a new name, and copy this once more.",
        ]
    unsaid = []
    if spelled.after:
        unsaid = [f"{spelled.words[-1]} is written by the Python code"]
        if robot.lidar and robot.lidar != getattr(config.estimator, "lidar", None):
            unsaid += ["the command cannot say the lidar: take the Python code"]
    recipe = Recipe("plan", "choose", file or "map.yaml", settings, notes)
    shell = dataclasses.replace(recipe, notes=[*notes, *unsaid]).shell
    if drives:
        shell += " --output chosen"
    return {"shell": shell, "python": f"{recipe.python}\nprint(result.table())\n"}
