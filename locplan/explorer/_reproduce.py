"""The shell command and the Python code that plan the path shown, or choose, once more."""

from __future__ import annotations

import dataclasses
import json
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from locplan._util.checks import printable
from locplan.costs import ROBOT_RADIUS
from locplan.explorer._simulating import MOST_DRIVES, PATH_SHOWN
from locplan.explorer._view import View
from locplan.field import SHORT_LIDAR, Estimator, FieldConfig, Sad, lidar_of
from locplan.planners import AnyAngle
from locplan.planners._plan import AWARE
from locplan.robots import PRESETS, Amcl, Disturbances, Lidar

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
EXPORTED = {
    "locplan": ("FieldConfig", "Fisher", "Fused", "Lidar", "Sad", "Scan", "SearchWindow"),
    "locplan.field": ("Exponential", "InverseSquare"),
    "locplan.simulation": ("Amcl", "Disturbances"),
}
"""Packages of the classes of settings, by whose names code can make them."""


@dataclass(frozen=True)
class Driven:
    """The simulated choice that is to be made once more."""

    drives: int
    """Greatest number of drives of each candidate."""
    own: bool = True
    """Whether the path of the view's weight is a candidate of its own."""
    amcl: Amcl = field(default_factory=Amcl)
    """The robot's filter."""
    disturbances: Disturbances = field(default_factory=Disturbances)
    """The disturbances."""

    def words(self) -> list[str]:
        """Options of `locplan choose`; the recommended path is written to a folder."""
        words = ["--planner", AnyAngle.name] if self.own else []
        words += ["--drives", str(self.drives)]
        for settings in (self.amcl, self.disturbances):
            for each in dataclasses.fields(settings):
                value = getattr(settings, each.name)
                if value != each.default:
                    text = value if isinstance(value, str) else json.dumps(value)
                    words += ["--set", f"{each.name}={text}"]
        return [*words, "--output", "chosen"]

    def code(self, ends: str, lidar: Lidar | None) -> list[str]:
        """Lines of code that choose on a costmap, and print the positions of the path."""
        given = [f"drives={self.drives}", *([f"lidar={_code(lidar)}"] if lidar else [])]
        given += [f"candidates={{{PATH_SHOWN!r}: plans[{AWARE!r}]}}"] if self.own else []
        for name, settings in (("amcl", self.amcl), ("disturbances", self.disturbances)):
            if settings != type(settings)():
                given.append(f"{name}={_code(settings)}")
        return [
            f"choice = locplan.choose(grid, {ends}, costs=costs, {', '.join(given)})",
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
    settings = view.costs.settings
    options = options_for(view.field.config)
    if options is None:
        options = ["--config", SETTINGS]
        notes_of_shell = [*notes, f"{SETTINGS} is written by the Python code"]
    else:
        notes_of_shell = list(notes)
    words = ["locplan", "choose" if driven else "plan", _as_argument(file)]
    words += ["--start", _place(view.start), "--goal", _place(view.goal)]
    for each in view.via:
        words += ["--via", _place(each)]
    if driven and not {"--estimator", "--lidar", "--config"} & set(options):
        options = ["--estimator", view.field.config.estimator.name, *options]  # fused without it
    words += [*options, "--weight", _number(view.costs.weight)]
    if view.costs.robot_radius != ROBOT_RADIUS:
        words += ["--robot-radius", _number(view.costs.robot_radius)]
    kept = _criterion(view, settings)
    if "criterion" in kept:
        words += ["--criterion", kept.pop("criterion")]
    lidar = view.simulated_lidar
    own = None if lidar == lidar_of(view.field.config) else lidar
    if driven:
        words += driven.words()
        kept |= {"lidar": lidar.model} if own else {}
    if kept:
        notes_of_shell.append(f"the command cannot say {', '.join(kept)}: take the Python code")
    shell = "\n".join([*(f"# {note}" for note in notes_of_shell), shlex.join(words)])
    *code, ends, printed = _python(view, file, notes, "--config" in options)
    more = driven.code(ends, own) if driven else [printed]
    return Reproduction(shell, "\n".join([*code, *more]) + "\n")


def reproduce(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the command and the code of the way shown, or of its simulated choice."""
    drives, driven = ask.whole("drives", 2, MOST_DRIVES), None
    view = session.view(ask)
    if drives is not None and not view.via:
        robot = session.opening.amcl or Amcl(), session.opening.disturbances or Disturbances()
        driven = Driven(drives, ask.flag("own"), *robot)
    map_file, edited = session.map_file, session.edited
    return reproduced(view, map_file, edited=edited, driven=driven).summary()


def options_for(config: FieldConfig) -> list[str] | None:
    """Options of the commands that make these settings of a field; None if none do."""
    estimator: Any = config.estimator
    own: Lidar | None = getattr(estimator, "lidar", None)
    named = own.model if own and own.model in PRESETS else None
    words = ["--lidar", named] if named else []
    lidar = Lidar.preset(named) if named else SHORT_LIDAR
    reach = own.range if own else estimator.reach
    if reach != lidar.range:
        words += ["--range", _number(reach)]
    view = own.field_of_view_deg if own else lidar.field_of_view_deg
    if view != lidar.field_of_view_deg:
        words += ["--field-of-view", _number(view)]
    if estimator.name != ("fused" if named else "sad"):
        words += ["--estimator", estimator.name]
    lidar = dataclasses.replace(lidar, range=reach, field_of_view_deg=view)
    if own and own != lidar:
        return None
    makes = _made(type(estimator), lidar, bool(named))
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
    kind: type[Estimator], lidar: Lidar, named: bool
) -> Iterator[tuple[list[str], Estimator]]:
    """Further options, and the estimator that the commands make with each of them."""
    if kind.casts_rays:
        yield [], kind.of(lidar)
    elif kind is Sad:
        for preset, made in (([], Sad()), (["--preset", "paper"], Sad.paper())):
            for template in ("disc", "visible"):
                each: Sad = dataclasses.replace(made, range=lidar.range, template=template)
                each = each.with_lidar(lidar) if named else each
                yield preset + (["--template", template] if template != "disc" else []), each


def _criterion(view: View, settings: CostSettings | None) -> dict[str, str]:
    """Arguments of `Costmap.from_field` that are not its defaults."""
    if settings is None:
        return {}
    defaults = {"law": "logarithmic", "criterion": view.field.config.estimator.criterion}
    defaults["headings"] = "mean"
    values = {name: getattr(settings, name) for name in defaults}
    return {name: value for name, value in values.items() if value != defaults[name]}


def _python(view: View, file: str, notes: list[str], keeps: bool) -> list[str]:
    """Lines of code that plan the path; then the ends as arguments, and the line that prints."""
    costs = [f"weight={_number(view.costs.weight)}"]
    costs.append(f"robot_radius={_number(view.costs.robot_radius)}")
    criterion = _criterion(view, view.costs.settings)
    costs += [f"{name}={value!r}" for name, value in criterion.items()]
    ends = [f"({_place(each).replace(',', ', ')})" for each in (view.start, view.goal)]
    via = [f"({_place(each).replace(',', ', ')})" for each in view.via]
    through = f", via=[{', '.join(via)}]" if via else ""
    return [
        *(f"# {note}" for note in notes),
        "import locplan",
        "",
        f"grid = locplan.load_map({file!r})",
        f"config = {_config_code(view.field.config)}",
        *([f"locplan.save_config({SETTINGS!r}, config)"] if keeps else []),
        "field = locplan.load_or_compute(grid, config)",
        f"costs = locplan.Costmap.from_field(grid, field, {', '.join(costs)})",
        f"plans = locplan.planners.plan_beside_shortest(costs, {', '.join(ends)}{through})",
        ", ".join(ends),
        f"print(plans[{AWARE!r}].path.xy.tolist())",
    ]


def _config_code(config: FieldConfig) -> str:
    """Code that makes these settings."""
    try:
        return _code(config)
    except KeyError:  # an estimator of the user's own, which is registered by its name
        return f"locplan.FieldConfig.from_json({json.loads(json.dumps(config.to_json()))!r})"


def _code(value: Any) -> str:
    """Code that makes a setting: the class with what is not by default; a KeyError of others."""
    if isinstance(value, Lidar) and value.model in PRESETS:
        preset = Lidar.preset(value.model)
        if preset == value:
            return f"locplan.Lidar.preset({value.model!r})"
    if not dataclasses.is_dataclass(value):
        return repr(value)
    kind = type(value)
    package = {name: home for home, names in EXPORTED.items() for name in names}[kind.__name__]
    if kind.__module__.partition(".")[0] != "locplan":
        raise KeyError(kind)
    given = []
    for each in dataclasses.fields(value):
        own, made = getattr(value, each.name), each.default_factory
        default = each.default if made is dataclasses.MISSING else made()
        if isinstance(value, FieldConfig) and each.name == "headings":
            default = value.estimator.headings
        if own != default:
            given.append(f"{each.name}={_code(own)}")
    return f"{package}.{kind.__name__}({', '.join(given)})"


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
