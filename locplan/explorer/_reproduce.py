"""The shell command and the Python code that plan the path shown, or choose, once more."""

from __future__ import annotations

import dataclasses
import json
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from locplan._util.checks import printable
from locplan.explorer._simulating import PATH_SHOWN
from locplan.explorer._view import MOST_DRIVES, View
from locplan.field import Estimator, FieldConfig, Sad, lidar_of
from locplan.planners import AWARE, AnyAngle
from locplan.robots import PRESETS, Lidar, Robot

if TYPE_CHECKING:
    from locplan.costs import CostSettings
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

SETTINGS = "settings.json"
"""File of a field's settings, where the command's options cannot say them."""
UNSAVED = (
    "{} is not the map on the page, which was edited since (or an edit undone).",
    "For the page's map: save it on the page under a new name, and copy this once more.",
)
NO_FILE = 'No file of this map is known: locplan.save_map(grid, "map.yaml") writes one'


@dataclass(frozen=True)
class Driven:
    """The simulated choice that is to be made once more."""

    drives: int
    """Greatest number of drives of each candidate."""
    own: bool = True
    """Whether the path of the view's weight is a candidate of its own."""

    def words(self) -> list[str]:
        """Options of `locplan choose`; the recommended path is written to a folder."""
        words = ["--planner", AnyAngle.name] if self.own else []
        return [*words, "--drives", str(self.drives), "--output", "chosen"]

    def code(self, ends: str) -> list[str]:
        """Lines of code that choose on a costmap, and print the positions of the path."""
        own = f", candidates={{{PATH_SHOWN!r}: plans[{AWARE!r}]}}" if self.own else ""
        return [
            f"choice = locplan.choose(grid, {ends}, robot, costs=costs, drives={self.drives}{own})",
            "print(choice.path.xy.tolist())",
        ]


@dataclass(frozen=True)
class Reproduction:
    """A command and code that plan the path shown, or choose."""

    shell: str
    """The command, for a POSIX shell; comments above it tell what is to be done first."""
    python: str
    """The code, which prints the positions of the path."""

    def summary(self) -> dict[str, object]:
        """Both texts, fit for JSON."""
        return {"shell": self.shell, "python": self.python}


def reproduced(
    view: View, map_file: str | None, *, edited: bool = False, driven: Driven | None = None
) -> Reproduction:
    """The command and the code for a view.

    Both plan as the page does for a path at rest, through all waypoints, with the planner
    any-angle. The command's field has the spacing of the view's everywhere; without that, `locplan
    plan` takes twice as much away from its paths.

    Parameters
    ----------
    view : View
        The way.
    map_file : str or None
        The map's file as the user typed it; None where there is none.
    edited : bool
        Whether the map shown differs from the file.
    driven : Driven, optional
        The simulated choice to make once more; the path shown is planned without it.
    """
    notes = [NO_FILE] if map_file is None else []
    file = map_file or "map.yaml"
    if map_file and edited:
        notes = [line.format(printable(file)) for line in UNSAVED]
    robot, kept = _named_robot(view), _criterion(view, view.costs.settings)
    options = field_options(view.field.config, robot.lidar, "fused" if driven else "sad")
    notes_of_shell = list(notes)
    if options is None:
        options = ["--config", SETTINGS]
        notes_of_shell.append(f"{SETTINGS} is written by the Python code")
        if robot.lidar and robot.lidar != getattr(view.field.config.estimator, "lidar", None):
            kept["lidar"] = robot.lidar.title
    words = ["locplan", "choose" if driven else "plan", _as_argument(file)]
    words += ["--start", _place(view.start), "--goal", _place(view.goal)]
    for each in view.via:
        words += ["--via", _place(each)]
    words += [*robot_options(robot), *options, "--weight", _number(view.costs.weight)]
    if "criterion" in kept:
        words += ["--criterion", kept.pop("criterion")]
    if driven:
        words += driven.words()
    if kept:
        notes_of_shell.append(f"the command cannot say {', '.join(kept)}: take the Python code")
    shell = "\n".join([*(f"# {note}" for note in notes_of_shell), shlex.join(words)])
    *code, ends, printed = _python(view, robot, file, notes, "--config" in options)
    more = driven.code(ends) if driven else [printed]
    return Reproduction(shell, "\n".join([*code, *more]) + "\n")


def reproduce(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the command and the code of the way shown, or of its simulated choice."""
    drives, driven = ask.whole("drives", 2, MOST_DRIVES), None
    view = session.view(ask)
    if drives is not None and not view.via:
        driven = Driven(drives, ask.flag("own"))
    map_file, edited = session.map_file, session.edited
    return reproduced(view, map_file, edited=edited, driven=driven).summary()


def robot_options(robot: Robot) -> list[str]:
    """Options of the commands that make this robot."""
    named, changes = _changes_of(robot)
    words = ["--lidar", named] if named else []
    for name, value in changes.items():
        text = value if isinstance(value, str) else json.dumps(value)
        words += ["--set", f"{name}={text}"]
    return words


def field_options(config: FieldConfig, lidar: Lidar | None, unnamed: str) -> list[str] | None:
    """Options of the commands that make these settings of a field; None if none do.

    Without a lidar their estimator is the unnamed one.
    """
    estimator: Any = config.estimator
    words = []
    if estimator.name != ("fused" if lidar else unnamed):
        words += ["--estimator", estimator.name]
    makes = _made(type(estimator), lidar, estimator.reach)
    fitting = [more for more, made in makes if made == estimator]
    if not fitting:
        return None
    words += fitting[0]
    if estimator.casts_rays or config.stride != FieldConfig.stride:
        words += ["--stride", _number(config.stride)]
    if config.headings != estimator.headings:
        words += ["--headings", str(config.headings)]
    return words


def _made(
    kind: type[Estimator], lidar: Lidar | None, reach: float
) -> Iterator[tuple[list[str], Estimator]]:
    """Further options, and the estimator that the commands make with each of them."""
    if kind.casts_rays and lidar:
        yield [], kind.of(lidar)
    elif kind is Sad:
        disc = ["--disc", _number(reach)] if lidar or reach != Sad.range else []
        for preset, made in (([], Sad()), (["--preset", "paper"], Sad.paper())):
            yield disc + preset, dataclasses.replace(made, range=reach)
            seen = dataclasses.replace(made, range=reach, template="visible")
            yield [*disc, *preset, "--template", "visible"], seen


def _named_robot(view: View) -> Robot:
    """The robot of a view; without a lidar where commands assume the same one."""
    config = view.field.config
    assumed = not config.estimator.casts_rays and view.robot.lidar == lidar_of(config)
    return dataclasses.replace(view.robot, lidar=None) if assumed else view.robot


def _changes_of(robot: Robot) -> tuple[str | None, dict[str, Any]]:
    """Name of a robot's lidar, if it has one, and what `Robot.changed` makes the robot of it by."""
    lidar = robot.lidar
    named = lidar.model if lidar and lidar.model in PRESETS else None
    usual = Robot(Lidar.preset(named) if named else lidar and Lidar()).summary()
    # Any setting of it makes a lidar.
    changes = {"range": lidar.range} if lidar and not named else {}
    for name, value in robot.summary().items():
        before = usual[name] if isinstance(usual[name], dict) else {name: usual[name]}
        after = value if isinstance(value, dict) else {name: value}
        changes |= {key: own for key, own in after.items() if own != before.get(key)}
    changes.pop("model", None)  # it decides nothing
    return named, changes


def _criterion(view: View, settings: CostSettings | None) -> dict[str, str]:
    """Arguments of `Costmap.from_field` that are not its defaults."""
    if settings is None:
        return {}
    defaults = {"law": "logarithmic", "criterion": view.field.config.estimator.criterion}
    defaults["headings"] = "mean"
    values = {name: getattr(settings, name) for name in defaults}
    return {name: value for name, value in values.items() if value != defaults[name]}


def _python(view: View, robot: Robot, file: str, notes: list[str], keeps: bool) -> list[str]:
    """Lines of code that plan the path; then the ends as arguments, and the line that prints."""
    costs = [f"weight={_number(view.costs.weight)}", "robot_radius=robot.radius"]
    criterion = _criterion(view, view.costs.settings)
    costs += [f"{name}={value!r}" for name, value in criterion.items()]
    ends = [f"({_place(each).replace(',', ', ')})" for each in (view.start, view.goal)]
    via = [f"({_place(each).replace(',', ', ')})" for each in view.via]
    through = f", via=[{', '.join(via)}]" if via else ""
    named, changes = _changes_of(robot)
    made = f"locplan.Robot({named!r})" if named else "locplan.Robot()"
    return [
        *(f"# {note}" for note in notes),
        "import locplan",
        "",
        f"grid = locplan.load_map({file!r})",
        f"robot = {made}.changed({changes!r})" if changes else f"robot = {made}",
        f"config = {_config_code(view.field.config, robot.lidar)}",
        *([f"locplan.save_config({SETTINGS!r}, config)"] if keeps else []),
        "field = locplan.load_or_compute(grid, config)",
        f"costs = locplan.Costmap.from_field(grid, field, {', '.join(costs)})",
        f"plans = locplan.planners.plan_beside_shortest(costs, {', '.join(ends)}{through})",
        ", ".join(ends),
        f"print(plans[{AWARE!r}].path.xy.tolist())",
    ]


def _config_code(config: FieldConfig, lidar: Lidar | None = None) -> str:
    """Code that makes these settings, with robot.lidar for the lidar."""
    if not type(config.estimator).__module__.startswith("locplan."):
        # The user's own, which is registered by its name.
        return f"locplan.FieldConfig.from_json({json.loads(json.dumps(config.to_json()))!r})"
    text = repr(config).replace(repr(lidar), "robot.lidar") if lidar else repr(config)
    text = re.sub(r"\b(Exponential|InverseSquare)\(", r"field.\1(", text)
    return re.sub(r"\b(?=(field\.)?[A-Z]\w+\()(?<!\.)", "locplan.", text)


def _as_argument(file: str) -> str:
    """A file's name as an argument: one that begins with a dash would be an option."""
    return f"./{file}" if file.startswith("-") and not PurePath(file).is_absolute() else file


def _place(xy: Any) -> str:
    """A position as options take it [m]."""
    return ",".join(map(_number, xy[:2]))


def _number(value: float) -> str:
    """The shortest text of just this number: near a cell's edge, rounding could change the cell."""
    text = f"{value:.12g}"
    return text if float(text) == value else repr(float(value))
